//! Check that a board's reference speeds are speeds, by timing its first moves.
//!
//! Two sections of a joint's path count, from a tenth to the half and from there to nine tenths. Boards that
//! move at a set speed, with trapezoidal or minimum-jerk profiles, reach 1 to 1.6 times their reference
//! there. On boards that use the reference as a gain, such as iCub_SIM, the speed grows with the distance:
//! too fast at first, too slow at the end, or both.
//!
//! A measurement counts once the reference has been read back and equals the one commanded, because another
//! program may have set its own.

use std::collections::BTreeSet;

/// Boundaries of the sections, as shares of the distance.
const MARKS: [f64; 3] = [0.1, 0.5, 0.9];
/// Shortest distance that is timed, deg, and shortest expected time of a section, s: encoders are noisy and
/// late.
const LEAST: (f64, f64) = (3.0, 0.4);
/// Longest time between two readings, as a share of a section's time.
const GAP: f64 = 0.1;
/// Measured speed by reference speed of a joint that follows its reference.
const FAIR: std::ops::RangeInclusive<f64> = 0.5..=2.0;
/// Number of sections that are timed. If at least this many of them, in at least this many moves, are outside
/// the range, the references are not speeds. Several moves are required because a disturbance of one move
/// affects all its joints.
const MAX_SECTIONS: usize = 12;
const UNFAIR: (usize, usize) = (3, 2);
/// Relative difference beyond which two references differ.
const ROUNDING: f64 = 0.01;

/// Timing of the first moves of a board's joints.
#[derive(Clone, Debug)]
pub struct Gauge {
    joints: Vec<Option<TimedJoint>>,
    /// Measurements whose references have not been read back yet.
    pending: Vec<Pending>,
    /// Measured speeds by reference speeds.
    seen: Vec<f64>,
    /// Number of moves, and the moves with a section outside the range.
    moves: u64,
    unfair: BTreeSet<u64>,
}

/// A measurement.
#[derive(Clone, Copy, Debug)]
struct Pending {
    joint: usize,
    /// Number of the move.
    number: u64,
    /// Reference commanded, deg/s.
    commanded: f64,
    /// Measured speed by the reference.
    times: f64,
}

/// A joint in motion.
#[derive(Clone, Copy, Debug)]
struct TimedJoint {
    from: f64,
    way: f64,
    /// Number of the move.
    number: u64,
    /// Reference, deg/s.
    speed: f64,
    /// Expected time of a section, s.
    stretch: f64,
    /// Mark to pass next, and the time at which the one before was passed, unless readings were missing
    /// since.
    next: usize,
    since: Option<f64>,
    /// Time of the newest reading, and the share of the distance covered then.
    newest: Option<(f64, f64)>,
}

impl Gauge {
    /// Creates the check before any motion.
    pub fn new(axes: usize) -> Gauge {
        Gauge { joints: vec![None; axes], pending: Vec::new(), seen: Vec::new(), moves: 0, unfair: BTreeSet::new() }
    }

    /// Starts a move, whose joints follow.
    pub fn begin(&mut self) {
        self.moves += 1;
    }

    /// Starts timing a joint that was commanded from `from` to `to` (deg) at this speed (deg/s).
    pub fn commanded(&mut self, joint: usize, from: f64, to: f64, speed: f64) {
        let way = to - from;
        let stretch = (MARKS[1] - MARKS[0]) * way.abs() / speed;
        let counts =
            self.seen.len() < MAX_SECTIONS && way.abs() >= LEAST.0 && stretch >= LEAST.1 && stretch.is_finite();
        self.pending.retain(|pending| pending.joint != joint);
        if let Some(slot) = self.joints.get_mut(joint) {
            *slot = counts.then_some(TimedJoint {
                from,
                way,
                number: self.moves,
                speed,
                stretch,
                next: 0,
                since: None,
                newest: None,
            });
        }
    }

    /// Stops timing these joints, because something else happens to them.
    pub fn forget(&mut self, joints: &[usize]) {
        for j in joints {
            if let Some(slot) = self.joints.get_mut(*j) {
                *slot = None;
            }
        }
    }

    /// Adds a reading, s and deg.
    pub fn read(&mut self, at: f64, q: &[f64]) {
        for (joint, (slot, q)) in self.joints.iter_mut().zip(q).enumerate() {
            let Some(timed) = slot else { continue };
            let number = timed.number;
            let commanded = timed.speed;
            self.pending.extend(timed.read(at, *q).map(|times| Pending { joint, number, commanded, times }));
            if timed.next == MARKS.len() {
                *slot = None;
            }
        }
    }

    /// Records a joint much faster than commanded, which is enough evidence about its move.
    pub fn outran(&mut self, joint: usize, times: f64) {
        if let Some(timed) = self.joints.get_mut(joint).and_then(Option::take) {
            self.pending.push(Pending { joint, number: timed.number, commanded: timed.speed, times });
        }
    }

    /// True if references have to be read back.
    pub fn needs_references(&self) -> bool {
        !self.pending.is_empty()
    }

    /// Evaluates the references read back from all joints, deg/s (empty if the board does not report them).
    /// Returns true if they show for the first time that references are not speeds.
    pub fn answered(&mut self, references: &[f64]) -> bool {
        let was = self.is_unfair();
        for Pending { joint, number, commanded, times } in self.pending.drain(..) {
            let is_in_force = |read: &f64| (read - commanded).abs() <= ROUNDING * commanded;
            if self.seen.len() < MAX_SECTIONS && references.get(joint).is_none_or(is_in_force) {
                self.seen.push(times);
                if !FAIR.contains(&times) {
                    self.unfair.insert(number);
                }
            }
        }
        self.is_unfair() && !was
    }

    /// True if references are not speeds.
    pub fn is_unfair(&self) -> bool {
        let stretches = self.seen.iter().filter(|times| !FAIR.contains(*times)).count();
        stretches >= UNFAIR.0 && self.unfair.len() >= UNFAIR.1
    }

    /// Measured speeds by reference speeds.
    pub fn seen(&self) -> &[f64] {
        &self.seen
    }

    /// Description of the measurements, for the operator.
    pub fn in_words(&self, port: &str) -> String {
        let least = self.seen.iter().copied().fold(f64::INFINITY, f64::min);
        let most = self.seen.iter().copied().fold(0.0, f64::max);
        format!(
            "joints of {port} moved at {least:.1} to {most:.1} times the speeds that they were told: its reference speeds mean no speeds"
        )
    }
}

impl TimedJoint {
    /// Adds a reading. Returns measured by reference speed if a section has ended.
    fn read(&mut self, at: f64, q: f64) -> Option<f64> {
        let share = (q - self.from) / self.way;
        let (before, gone) = self.newest.replace((at, share))?;
        if at - before > GAP * self.stretch {
            self.since = None;
        }
        let mut seen = None;
        while let Some(mark) = MARKS.get(self.next).filter(|mark| share >= **mark) {
            let part = (mark - gone) / (share - gone).max(1e-9);
            let passed = before + part.clamp(0.0, 1.0) * (at - before);
            seen = self.since.map(|since| self.stretch / (passed - since).max(1e-3)).or(seen);
            self.since = Some(passed).filter(|_| at - before <= GAP * self.stretch);
            self.next += 1;
        }
        seen
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Makes one move by `way`, deg, at a reference of 10 deg/s, with the position given as a function of time
    /// in units of the expected duration.
    fn moved(gauge: &mut Gauge, way: f64, period: f64, at: impl Fn(f64) -> f64) -> bool {
        gauge.begin();
        gauge.commanded(0, 20.0, 20.0 + way, 10.0);
        let whole = way.abs() / 10.0;
        for k in 0..(40.0 * whole / period) as usize {
            gauge.read(k as f64 * period, &[20.0 + way * at(k as f64 * period / whole)]);
        }
        gauge.answered(&[10.0])
    }

    #[test]
    fn boards_that_go_by_speeds_are_taken_at_their_word() {
        let even = |t: f64| t.min(1.0);
        let eased = |t: f64| t.min(1.0).powi(3) * (10.0 - 15.0 * t.min(1.0) + 6.0 * t.min(1.0).powi(2));
        for (way, period) in [(15.0, 0.02), (-40.0, 0.02), (30.0, 0.1)] {
            let mut gauge = Gauge::new(1);
            for _ in 0..4 {
                assert!(!moved(&mut gauge, way, period, even) && !moved(&mut gauge, way, period, eased));
            }
            assert_eq!(gauge.seen.len(), MAX_SECTIONS, "no more than enough");
            assert!(gauge.seen.iter().all(|times| (0.9..1.7).contains(times)), "{:?}", gauge.seen);
        }
    }

    #[test]
    fn a_board_that_takes_them_for_gains_is_found_out() {
        // 10 deg/s means a gain of 6 * 0.175 / s, so the duration does not depend on the distance
        let gain = 6.0 * 10f64.to_radians();
        for way in [10.0, -12.0, 80.0] {
            let mut gauge = Gauge::new(1);
            let found =
                (0..4).position(|_| moved(&mut gauge, way, 0.02, |t| 1.0 - (-gain * t * way.abs() / 10.0).exp()));
            assert!(found.is_some_and(|moves| moves <= 3), "{way}: {found:?} {:?}", gauge.seen);
            assert!(gauge.is_unfair());
            assert!(!moved(&mut gauge, way, 0.02, |t| t.min(1.0)), "it is said once");
        }
        let mut gauge = Gauge::new(1);
        let outran = |gauge: &mut Gauge| {
            gauge.begin();
            gauge.commanded(0, 0.0, 90.0, 10.0);
            gauge.outran(0, 4.0);
            gauge.outran(0, 4.0);
            gauge.answered(&[])
        };
        assert_eq!([0; 4].map(|_| outran(&mut gauge)), [false, false, true, false], "once a move");
        assert_eq!(
            gauge.in_words("/arm"),
            "joints of /arm moved at 4.0 to 4.0 times the speeds that they were told: its reference speeds mean no speeds"
        );
    }

    /// Nothing is concluded from moves under the references of another program.
    #[test]
    fn only_moves_under_our_references_count() {
        let mut gauge = Gauge::new(1);
        for _ in 0..5 {
            gauge.commanded(0, 0.0, 90.0, 10.0);
            gauge.outran(0, 5.0);
            assert!(gauge.needs_references() && !gauge.answered(&[60.0]) && !gauge.needs_references());
        }
        gauge.commanded(0, 0.0, 90.0, 10.0);
        gauge.outran(0, 5.0);
        gauge.commanded(0, 0.0, 90.0, 20.0);
        assert!(!gauge.needs_references() && gauge.seen.is_empty(), "its reference is gone");
    }

    /// Nothing is concluded from missing readings or interrupted moves.
    #[test]
    fn missing_readings_and_short_ways_do_not_count() {
        let mut gauge = Gauge::new(2);
        assert!(!moved(&mut gauge, 2.0, 0.02, |t| (0.1 * t).min(1.0)), "too short");
        assert!(!moved(&mut gauge, 10.0, 0.1, |t| (0.1 * t).min(1.0)), "too few readings");
        for k in 0..20 {
            gauge.commanded(1, 0.0, 10.0, 10.0);
            gauge.read(f64::from(k), &[0.0, 0.0]);
            gauge.read(f64::from(k) + 0.05, &[0.0, 2.0]);
            gauge.forget(&[1]);
            gauge.read(f64::from(k) + 0.9, &[0.0, 6.0]);
            assert!(!gauge.needs_references() && !gauge.answered(&[10.0, 10.0]));
        }
        assert!(gauge.seen.is_empty(), "{:?}", gauge.seen);
    }
    /// Moves to 12.5 deg at 10 deg/s, read at these times, s, and positions, deg. Returns the speeds measured,
    /// relative to the reference.
    fn timed(read: &[(f64, f64)]) -> Vec<f64> {
        let mut gauge = Gauge::new(1);
        gauge.begin();
        gauge.commanded(0, 0.0, 12.5, 10.0);
        read.iter().for_each(|(at, q)| gauge.read(*at, &[*q]));
        gauge.answered(&[]);
        gauge.seen().to_vec()
    }

    /// The time at a mark is interpolated between two readings. Readings a tenth of a section apart are
    /// sufficient; a single longer pause invalidates the section.
    #[test]
    fn a_stretch_is_timed_between_its_marks() {
        let steady: Vec<(f64, f64)> = (0..40).map(|k| (0.037 * f64::from(k), 0.37 * f64::from(k))).collect();
        let seen = timed(&steady);
        assert!(seen.len() == 2 && seen.iter().all(|times| (times - 1.0).abs() < 1e-9), "{seen:?}");
        let pause = |from: f64, secs: f64| {
            let half = [(-0.04, 0.05), (0.0, 0.15), (from, 0.3), (from + secs, 0.45), (from + secs + 0.04, 0.55)];
            timed(&half.map(|(at, share)| (at, 12.5 * share))).len()
        };
        assert_eq!((pause(0.05, 0.05), pause(0.04, 0.06), pause(0.04, 0.2)), (1, 0, 0));
        let mark_in_a_pause = [(-0.4, 0.05), (0.0, 0.15), (0.04, 0.3), (0.08, 0.45), (0.12, 0.55)];
        assert!(
            timed(&mark_in_a_pause.map(|(at, share)| (at, 12.5 * share))).is_empty(),
            "nobody knows when it was passed"
        );
    }

    /// Joints with too short a distance, too short a duration or no speed are not timed, nor are joints that
    /// get another command.
    #[test]
    fn only_long_ways_are_timed_and_to_their_end() {
        let needs_references = |way: f64, speed: f64, forgotten: bool| {
            let mut gauge = Gauge::new(1);
            gauge.begin();
            gauge.commanded(0, 0.0, way, speed);
            for k in 0..=100 {
                if forgotten && k == 30 {
                    gauge.forget(&[0]);
                }
                gauge.read(0.01 * f64::from(k), &[0.01 * way * f64::from(k)]);
            }
            gauge.needs_references()
        };
        assert!(needs_references(10.0, 10.0, false) && !needs_references(10.0, 10.0, true));
        assert!(
            !needs_references(2.0, 1.0, false)
                && !needs_references(10.0, 100.0, false)
                && !needs_references(10.0, 0.0, false)
        );
    }

    /// Measurements count if the reference read back agrees to a hundredth, until there are enough of them.
    #[test]
    fn enough_is_enough() {
        let mut gauge = Gauge::new(1);
        let outran = |gauge: &mut Gauge, read: f64| {
            gauge.begin();
            gauge.commanded(0, 0.0, 90.0, 10.0);
            gauge.outran(0, 1.0);
            gauge.answered(&[read]);
            gauge.seen().len()
        };
        assert_eq!([9.85, 10.05, 10.2, 18.0].map(|read| outran(&mut gauge, read)), [0, 1, 1, 1]);
        while gauge.seen().len() < MAX_SECTIONS - 1 {
            outran(&mut gauge, 10.0);
        }
        // both sections of one move
        moved(&mut gauge, 30.0, 0.02, |t| t.min(1.0));
        assert_eq!(gauge.seen().len(), MAX_SECTIONS);
        gauge.commanded(0, 0.0, 90.0, 10.0);
        gauge.outran(0, 1.0);
        assert!(!gauge.needs_references(), "nobody is asked for what is known");
    }
}
