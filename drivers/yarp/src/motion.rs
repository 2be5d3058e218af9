//! Detection of the end of motions, joint by joint, from commands, answers of the board, and encoders.
//!
//! ```text
//! order ──> Ordered ──given──> Moving ──board reports done, then a state──> Rest
//!                        └───> Settling ──encoders rest for a while──────> Rest
//! ```
//! A position move ends when the board reports it. Boards report no end of stops, setpoints and velocities;
//! there, and on boards that don't answer the query, the encoders decide.

use super::encoder::Encoder;
use std::collections::VecDeque;

/// Time for which encoders must rest, s.
pub const REST_TIME_S: f64 = 0.1;
/// Drift of the mean readings from one half of that time to the other below which a joint is steady, that is,
/// at rest except for noise, deg.
const DRIFT: f64 = 0.1;
/// Largest number of states stored for this.
const MAX_STATES: usize = 256;

/// Source of the end of a motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// The board reports it.
    Reported,
    /// The encoders rest.
    Seen,
}

/// Joint speeds over a short time.
#[derive(Clone, Debug, PartialEq)]
pub enum MeasuredSpeeds {
    /// Too few or too old states.
    Unknown,
    /// All joints rest, except for encoder noise.
    Rest,
    /// At least one moves, deg/s; negative where readings decrease.
    At(Vec<f64>),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum JointActivity {
    Rest,
    /// Commanded, or on its way to the board.
    Busy {
        end: End,
        ticket: u64,
        /// Time at which the board received it.
        given: Option<f64>,
        /// True if the board reported the end.
        arrived: bool,
    },
}

/// Motions of one board. Times in seconds, positions in degrees.
#[derive(Clone, Debug)]
pub struct BoardMotions {
    joints: Vec<JointActivity>,
    window: VecDeque<(f64, Vec<f64>)>,
    encoders: Vec<Encoder>,
    /// Number of states received.
    states: u64,
    board_reports: bool,
    tickets: u64,
}

impl BoardMotions {
    /// Creates the motions of a board with `axes` joints at rest.
    pub fn new(axes: usize) -> BoardMotions {
        BoardMotions {
            joints: vec![JointActivity::Rest; axes],
            window: VecDeque::new(),
            encoders: vec![Encoder::default(); axes],
            states: 0,
            board_reports: true,
            tickets: 0,
        }
    }

    /// Marks these joints as commanded; the ticket identifies the command.
    pub fn order(&mut self, joints: &[usize], end: End) -> u64 {
        self.tickets += 1;
        let end = if self.board_reports { end } else { End::Seen };
        for j in joints {
            if let Some(slot) = self.joints.get_mut(*j) {
                *slot = JointActivity::Busy { end, ticket: self.tickets, given: None, arrived: false };
            }
        }
        self.tickets
    }

    /// Marks everything up to this ticket as received by the board, or as dropped.
    pub fn given(&mut self, upto: u64, now: f64) {
        for slot in &mut self.joints {
            if let JointActivity::Busy { ticket, given, .. } = slot
                && *ticket <= upto
                && given.is_none()
            {
                *given = Some(now);
            }
        }
    }

    /// Joints whose end only the board can report and which are due for a query, with the ticket for its
    /// answer.
    pub fn due_query(&self) -> Option<(Vec<usize>, u64)> {
        let waits = |(j, doing): (usize, &JointActivity)| match doing {
            JointActivity::Busy { end: End::Reported, given: Some(_), arrived: false, .. } => Some(j),
            _ => None,
        };
        let joints: Vec<usize> = self.joints.iter().enumerate().filter_map(waits).collect();
        (!joints.is_empty()).then_some((joints, self.tickets))
    }

    /// Stores the board's answer for these joints.
    pub fn answered(&mut self, joints: &[usize], upto: u64, done: bool) {
        for j in joints {
            if let Some(JointActivity::Busy { ticket, given: Some(_), arrived, .. }) = self.joints.get_mut(*j)
                && *ticket <= upto
            {
                *arrived = done;
            }
        }
    }

    /// Switches to the encoders, because the board can't report the end of its motions.
    pub fn use_encoders_only(&mut self) {
        self.board_reports = false;
        for slot in &mut self.joints {
            if let JointActivity::Busy { end, .. } = slot {
                *end = End::Seen;
            }
        }
    }

    /// Adds a state of the board.
    pub fn read(&mut self, at: f64, q: &[f64]) {
        self.window.push_back((at, q.to_vec()));
        // keeps one state older than the window, so that the window is covered
        while self.window.len() > MAX_STATES || self.window.get(1).is_some_and(|(t, _)| *t <= at - REST_TIME_S) {
            self.window.pop_front();
        }
        let covered = is_covered(&self.window);
        self.states += 1;
        for (j, (encoder, q)) in self.encoders.iter_mut().zip(q).enumerate() {
            encoder.read(*q, covered && is_steady(&self.window, j));
        }
        for (j, slot) in self.joints.iter_mut().enumerate() {
            let JointActivity::Busy { end, given: Some(given), arrived, .. } = *slot else { continue };
            let over = match end {
                End::Reported => arrived,
                End::Seen => covered && at >= given + REST_TIME_S && rests(&self.window, &self.encoders, j),
            };
            if over {
                *slot = JointActivity::Rest;
            }
        }
    }

    /// Discards the states, which belong to an earlier connection of the board.
    pub fn forget(&mut self) {
        self.window.clear();
        self.encoders.iter_mut().for_each(Encoder::forget);
    }

    /// Number of states received so far.
    pub fn states(&self) -> u64 {
        self.states
    }

    /// Error of a single reading of each joint, deg.
    pub fn resolutions(&self) -> impl Iterator<Item = f64> + '_ {
        self.encoders.iter().map(Encoder::resolution)
    }

    /// Joints to stop: those that move, or were commanded to. `None`, for all, if the states are
    /// insufficient.
    pub fn to_stop(&self, now: f64) -> Option<Vec<usize>> {
        let fresh = self.window.back().is_some_and(|(at, _)| *at >= now - REST_TIME_S);
        let moves = |j: &usize| !self.rests(*j);
        (fresh && is_covered(&self.window)).then(|| (0..self.joints.len()).filter(moves).collect())
    }

    /// True where the motion is done, per joint.
    pub fn done(&self) -> impl Iterator<Item = bool> + '_ {
        self.joints.iter().map(|d| *d == JointActivity::Rest)
    }

    /// Joint speeds, provided that the newest state is no older than `since`.
    pub fn speeds(&self, since: f64) -> MeasuredSpeeds {
        let (Some((begun, from)), Some((ended, to))) = (self.window.front(), self.window.back()) else {
            return MeasuredSpeeds::Unknown;
        };
        let secs = ended - begun;
        if *ended < since || secs < 0.5 * REST_TIME_S {
            return MeasuredSpeeds::Unknown;
        }
        if (0..to.len()).all(|j| rests(&self.window, &self.encoders, j)) {
            return MeasuredSpeeds::Rest;
        }
        MeasuredSpeeds::At(from.iter().zip(to).map(|(a, b)| (b - a) / secs).collect())
    }

    /// True if a joint has no motion in progress and its encoder shows that it rests.
    pub fn rests(&self, joint: usize) -> bool {
        let over = self.joints.get(joint) == Some(&JointActivity::Rest);
        over && is_covered(&self.window) && rests(&self.window, &self.encoders, joint)
    }

    /// True if any motion is in progress.
    pub fn is_busy(&self) -> bool {
        self.joints.iter().any(|d| *d != JointActivity::Rest)
    }
}

/// True if the states go back far enough to detect a rest.
fn is_covered(window: &VecDeque<(f64, Vec<f64>)>) -> bool {
    window.front().zip(window.back()).is_some_and(|((begun, _), (ended, _))| *begun <= ended - REST_TIME_S)
}

/// True if the readings of a joint drift no more than noise does.
fn is_steady(window: &VecDeque<(f64, Vec<f64>)>, joint: usize) -> bool {
    let half = window.len() / 2;
    let mean = |skipped: usize| {
        let readings = window.iter().skip(skipped).take(half).filter_map(|(_, q)| q.get(joint));
        readings.sum::<f64>() / half as f64
    };
    half >= 2 && (mean(window.len() - half) - mean(0)).abs() <= DRIFT
}

fn rests(window: &VecDeque<(f64, Vec<f64>)>, encoders: &[Encoder], joint: usize) -> bool {
    let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
    for (_, q) in window {
        let v = q.get(joint).copied().unwrap_or(f64::NAN);
        if !v.is_finite() {
            return false;
        }
        (least, most) = (least.min(v), most.max(v));
    }
    encoders.get(joint).is_some_and(|encoder| most - least <= encoder.play())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn done(m: &BoardMotions) -> Vec<bool> {
        m.done().collect()
    }

    #[test]
    fn a_move_is_done_after_the_boards_report_and_a_newer_state() {
        let mut m = BoardMotions::new(2);
        let ticket = m.order(&[1], End::Reported);
        assert_eq!((done(&m), m.due_query()), (vec![true, false], None), "the board has not got it yet");
        m.given(ticket, 1.0);
        let (joints, upto) = m.due_query().unwrap();
        assert_eq!(joints, [1]);
        m.answered(&joints, upto, false);
        m.read(1.02, &[0.0, 0.0]);
        assert!(m.is_busy());
        m.answered(&joints, upto, true);
        assert!(m.is_busy(), "no state yet");
        m.read(1.04, &[0.0, 5.0]);
        assert_eq!(done(&m), [true, true]);
    }

    #[test]
    fn an_answer_to_an_older_question_ends_nothing_newer() {
        let mut m = BoardMotions::new(1);
        let first = m.order(&[0], End::Reported);
        m.given(first, 0.0);
        let (joints, upto) = m.due_query().unwrap();
        let second = m.order(&[0], End::Reported);
        m.given(second, 0.1);
        m.answered(&joints, upto, true);
        m.read(0.2, &[1.0]);
        assert!(m.is_busy());
    }

    #[test]
    fn set_points_end_when_the_encoders_rest() {
        let mut m = BoardMotions::new(1);
        let mut at = 0.0;
        for i in 0..50 {
            at = 0.02 * f64::from(i);
            let ticket = m.order(&[0], End::Seen);
            m.given(ticket, at);
            m.read(at, &[f64::from(i)]);
            assert!(m.is_busy());
        }
        let mut states = 0;
        while m.is_busy() {
            at += 0.02;
            states += 1;
            m.read(at, &[49.0]);
            assert!(states < 20);
        }
        assert!((5..=7).contains(&states), "{states}");
    }

    /// Rest before the board got the setpoint does not count.
    #[test]
    fn rest_counts_from_the_time_the_board_got_the_order() {
        let mut m = BoardMotions::new(1);
        (0..50).for_each(|i| m.read(0.02 * f64::from(i), &[0.0]));
        let ticket = m.order(&[0], End::Seen);
        m.given(ticket, 1.0);
        let over = (50..70).map(|i| 0.02 * f64::from(i)).find(|at| {
            m.read(*at, &[0.0]);
            !m.is_busy()
        });
        assert!(over.is_some_and(|at| (1.099..1.121).contains(&at)), "{over:?}");
    }

    #[test]
    fn speeds_require_enough_recent_states() {
        let mut m = BoardMotions::new(2);
        assert_eq!(m.speeds(0.0), MeasuredSpeeds::Unknown);
        m.read(0.0, &[0.0, 0.0]);
        m.read(0.5 * REST_TIME_S, &[1.0, 0.0]);
        assert_eq!(m.speeds(0.0), MeasuredSpeeds::At(vec![20.0, 0.0]));
        m.forget();
        m.read(2.0, &[0.0, 0.0]);
        m.read(2.04, &[1.0, 0.0]);
        assert_eq!(m.speeds(2.0), MeasuredSpeeds::Unknown, "not half of the time over which they are told");
        m.read(2.0625, &[1.25, 0.0]);
        assert_eq!(m.speeds(2.0625), MeasuredSpeeds::At(vec![20.0, 0.0]));
        assert_eq!(m.speeds(2.0626), MeasuredSpeeds::Unknown, "the newest state is older");
        (0..10).for_each(|i| m.read(2.1 + 0.02 * f64::from(i), &[1.25, 0.05]));
        assert_eq!(m.speeds(2.2), MeasuredSpeeds::Rest);
    }

    /// An encoder of 4,096 counts between two counts, and an encoder with noise, count as rest; a creeping
    /// joint does not.
    #[test]
    fn coarse_and_noisy_encoders_rest() {
        let count = 360.0 / 4096.0;
        let flickers = |i: u32| if i.is_multiple_of(3) { count } else { 0.0 };
        // simple pseudo-random noise of 0.03 deg: the fractional part of a multiple of an irrational number
        let noise = |i: u32| 0.1 * ((f64::from(i) * 0.754_877_666) % 1.0 - 0.5);
        for (q, rests) in [(&flickers as &dyn Fn(u32) -> f64, true), (&noise, true), (&|i| 0.1 * f64::from(i), false)] {
            let mut m = BoardMotions::new(1);
            let read =
                |m: &mut BoardMotions, n: std::ops::Range<u32>| n.for_each(|i| m.read(0.01 * f64::from(i), &[q(i)]));
            read(&mut m, 0..100);
            let ticket = m.order(&[0], End::Seen);
            m.given(ticket, 1.0);
            read(&mut m, 100..130);
            assert_eq!(!m.is_busy(), rests);
            assert_eq!(m.to_stop(1.29), Some(if rests { vec![] } else { vec![0] }));
        }
    }

    /// States before the restart of a board do not count: a joint rests once it was observed at rest for a
    /// while since.
    #[test]
    fn a_rest_is_seen_anew_in_each_life_of_a_board() {
        let mut m = BoardMotions::new(2);
        let ticket = m.order(&[0], End::Seen);
        m.given(ticket, 4.0);
        (0..10).for_each(|i| m.read(4.0 + 0.02 * f64::from(i), &[f64::from(i), 0.0]));
        assert!(m.is_busy() && m.rests(1) && !m.rests(0));
        m.forget();
        for at in [5.0, 5.03, 5.06, 5.09] {
            m.read(at, &[9.0, 0.0]);
            assert!(m.is_busy() && !m.rests(1), "{at}");
        }
        m.read(5.125, &[9.0, 0.0]);
        assert!(!m.is_busy() && m.rests(1) && m.rests(0));
    }

    #[test]
    fn a_board_in_a_hurry_takes_no_more_room() {
        let mut m = BoardMotions::new(1);
        (0..1000).for_each(|i| m.read(1e-4 * f64::from(i), &[0.0]));
        assert_eq!(m.window.len(), MAX_STATES);
    }

    #[test]
    fn what_never_reached_the_board_stays_busy_and_a_silent_board_is_watched() {
        let mut m = BoardMotions::new(1);
        m.order(&[0], End::Reported);
        for i in 0..100 {
            m.read(0.02 * f64::from(i), &[0.0]);
        }
        assert!(m.is_busy());
        m.given(1, 2.0);
        m.use_encoders_only();
        assert_eq!(m.due_query(), None);
        for i in 100..110 {
            m.read(0.02 * f64::from(i), &[0.0]);
        }
        assert!(!m.is_busy());
        m.order(&[0], End::Reported);
        m.given(2, 2.2);
        assert_eq!(m.due_query(), None, "it is not asked again");
    }
}
