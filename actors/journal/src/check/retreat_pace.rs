//! Pace and path of the retreat of a motion, from the measured configurations (I22).
//!
//! The retreat follows the readings from the commit to the stop, backwards, in order and at the same rate. The
//! robot is at no point earlier than it took to get there, and is in motion about as long. A robot that
//! retreats in a group may have to wait for others and rests in between, so only time in motion counts, both
//! there and back. A motor whose encoder jumps is not judged.

use mobee_contract::{MotorUnits, Pose, Time};
use std::collections::VecDeque;
use std::time::Duration;

/// Start of the text of a violation about the duration of a retreat.
pub const SLOW_RETREAT: &str = "was in motion for";
/// Largest distance of a motor from the measured path, rad: one degree, and half a degree for overshoot.
/// Reversed, a path that ends in a stop begins with the motors' greatest acceleration. A motor that is one
/// set-point late then catches up faster than it came. Where the set-points brake as hard, at the beginning of
/// the motion, it can't lose that speed before them.
const BESIDE: f64 = 1.5 * std::f64::consts::PI / 180.0;
/// Additional lag of a motor behind the others in the retreat, s: each starts and brakes by itself.
const LAG: f64 = 0.12;
/// Lead that is allowed on the path, s: readings and events are recorded by different threads.
const EARLY: f64 = 0.1;
/// Longest duration of the retreat, as a factor and in seconds: the robot is made to wait, and catches up. The
/// seconds are allowed once more for each halt.
const LONGER: (f64, f64) = (1.25, 0.5);
/// Number of halts that are allowed for a sagging arm to settle at the end.
const SETTLES: u32 = 2;
/// Factor on [`EARLY`] for a sagging arm: it sags differently on the retreat path.
const SAGS: f64 = 3.0;
/// Smallest jump of the readings that is not motion, rad.
const JUMP: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// Readings in the window that distinguishes motion from rest.
const WINDOW: usize = 8;
/// Control periods after which a gap in the readings ends the comparison: the robot's progress is unknown.
const PAUSE_PERIODS: u32 = 8;
/// Control periods that one reading counts for in the retreat at most. The retreat advances with the readings,
/// so it is slower than the motion where readings are missing.
const STEP: u32 = 2;
/// Most readings of a motion; a longer one is not judged.
const MAX_READINGS: usize = 1 << 14;

/// A reading, and the time for which the robot had been in motion by then, s.
#[derive(Clone)]
struct Passed {
    at: Time,
    q: Pose,
    moved: f64,
}

/// A motion with a safe pose, and its retreat.
pub(super) struct RetreatPace {
    motors: Vec<usize>,
    units: MotorUnits,
    rest_speed: f64,
    pause: Duration,
    there: VecDeque<Passed>,
    back: Option<PacedRetreat>,
    /// Number of times it waited for a robot that blocked its path.
    halts: u32,
    /// Lead that is allowed on the path, s.
    early: f64,
    /// Largest distance from its path, rad.
    beside: f64,
    /// One count of its encoders, rad: a count that flickers is not motion.
    count: f64,
    /// True if a board responds late, so that the retreat waits for it repeatedly.
    late: bool,
    /// True if the gap before the next reading is bridged: the robot went there as it was commanded.
    bridged: bool,
    /// Set once the path there or the retreat can't be determined.
    lost: bool,
}

/// The retreat so far.
struct PacedRetreat {
    began: Time,
    /// Index of the reading on the way there that the robot has retreated to.
    here: usize,
    newest: VecDeque<Passed>,
    /// True if set-points are streamed, so that the retreat's rate is defined.
    streamed: bool,
}

impl RetreatPace {
    /// Creates the judge for these motors of a robot with this rest speed (rad/s) and control period (s).
    pub fn new(motors: &[(usize, f64)], rest_speed: f64, period: f64, units: &MotorUnits) -> RetreatPace {
        let pause = Duration::try_from_secs_f64(period).unwrap_or_default() * PAUSE_PERIODS;
        let there = VecDeque::new();
        let mut way = RetreatPace {
            motors: Vec::new(),
            units: units.clone(),
            rest_speed,
            pause,
            there,
            back: None,
            halts: 0,
            early: EARLY,
            beside: BESIDE,
            count: 0.0,
            late: false,
            bridged: false,
            lost: false,
        };
        way.join(motors);
        way
    }

    /// Adds the motors that take part.
    pub fn join(&mut self, motors: &[(usize, f64)]) {
        let new: Vec<usize> = motors.iter().map(|(m, _)| *m).filter(|m| !self.motors.contains(m)).collect();
        self.motors.extend(new);
    }

    /// Starts the retreat. A second retreat after a failed one is not judged, because it leaves out detours.
    pub fn begin_retreat(&mut self, at: Time) {
        if self.back.is_some() {
            return self.forget();
        }
        // A board that is later than its `latency_ms` can be stopped before it shows any motion. It then starts
        // after all, until the stop reaches it, and no path was measured that it could retrace. I3 still judges
        // where it ends.
        if self.there.back().is_none_or(|last| last.moved <= 0.0) {
            return self.forget();
        }
        let newest = self.there.range(self.there.len().saturating_sub(WINDOW)..).cloned().collect();
        self.back = Some(PacedRetreat { began: at, here: self.there.len().saturating_sub(1), newest, streamed: true });
    }

    /// Configuration on the way there at the time of one of its readings.
    pub fn was_at(&self, at: Time) -> Option<&Pose> {
        self.there.iter().find(|passed| passed.at == at).map(|passed| &passed.q)
    }

    /// Records that the retreat is driven by moves between way-points, each started and ended by the board.
    pub fn is_moved(&mut self) {
        self.back.iter_mut().for_each(|back| back.streamed = false);
    }

    /// Counts a halt for a robot that blocks the path.
    pub fn halts(&mut self) {
        self.halts += 1;
    }

    /// Allows for an arm that sags by at most `by`, rad: it is commanded higher, beside its path, and settles
    /// once or twice.
    pub fn sags(&mut self, by: f64) {
        self.beside += by;
        self.halts += SETTLES;
        self.early = SAGS * EARLY;
    }

    /// Sets the size of an encoder count, rad.
    pub fn counts(&mut self, count: f64) {
        self.count = count;
    }

    /// Records that the history bridges the gap before the next reading.
    pub fn bridge(&mut self) {
        self.bridged = true;
    }

    /// Records that a board responds late: the duration of the retreat is not judged.
    pub fn is_late(&mut self) {
        self.late = true;
    }

    /// Ends the comparison, because the path, or its continuation, is unknown.
    pub fn forget(&mut self) {
        self.lost = true;
    }

    /// Takes the next reading. Returns a violation of the retreat as a phrase, once.
    pub fn take(&mut self, at: Time, q: &Pose) -> Option<String> {
        let newest = self.back.as_ref().map_or(&self.there, |back| &back.newest);
        let last = newest.back().map_or((at, 0.0), |last| (last.at, last.moved));
        if self.lost || !newest.is_empty() && at <= last.0 {
            return None;
        }
        let pause = at.since(last.0);
        let mut next = Passed { at, q: q.clone(), moved: last.1 };
        if self.moves(newest, &next) {
            let counts = if self.back.is_some() { pause.min(self.pause / PAUSE_PERIODS * STEP) } else { pause };
            next.moved += counts.as_secs_f64();
        }
        let bridged = std::mem::take(&mut self.bridged);
        self.lost = (pause > self.pause && !bridged) || self.jumps(newest, &next) || self.there.len() == MAX_READINGS;
        let Some(back) = &mut self.back else {
            self.there.push_back(next);
            return None;
        };
        back.newest.push_back(next.clone());
        if back.newest.len() > WINDOW {
            back.newest.pop_front();
        }
        let wrong = if self.lost { None } else { self.compare(&next) };
        self.lost |= wrong.is_some();
        wrong
    }

    /// Compares a reading of the retreat with the path there: position, order and time. Takes the last matching
    /// reading before the current one.
    fn compare(&mut self, now: &Passed) -> Option<String> {
        let back = self.back.as_ref()?;
        let all = self.there.back()?.moved;
        let was = back.here;
        let Some(here) = (0..=was).rev().find(|i| self.beside(*i, &now.q) <= self.beside) else {
            let nearest = (0..=was).map(|i| self.beside(i, &now.q)).fold(f64::INFINITY, f64::min);
            let beside = self.units.told(nearest, 2);
            return Some(format!("is {beside} beside the way that it came, or not on it in order, at {}", now.at));
        };
        let gone = all - self.there.get(here)?.moved;
        let secs = now.at.since(back.began).as_secs_f64();
        let streamed = back.streamed;
        self.back.iter_mut().for_each(|back| back.here = here);
        (streamed && gone > secs + self.early)
            .then(|| format!("has gone {gone:.2} s of its retreat in {secs:.2} s at {}", now.at))
    }

    /// Ends the retreat. Returns a violation of its duration as a phrase.
    pub fn end(&self) -> Option<String> {
        let back = self.back.as_ref().filter(|back| back.streamed && !self.late && !self.lost)?;
        let there = self.there.back()?.moved;
        let took = back.newest.back()?.moved - there;
        let gone = there - self.there.get(back.here)?.moved;
        (took > LONGER.0 * there + LONGER.1 * f64::from(1 + self.halts))
            .then(|| format!("{SLOW_RETREAT} {took:.2} s on {gone:.2} s of its retreat"))
    }

    /// Distance of a configuration from the path about one of its readings, rad, less half a step to the
    /// previous reading and the distance that the motors travel in their lag.
    fn beside(&self, index: usize, q: &Pose) -> f64 {
        let Some(here) = self.there.get(index) else { return f64::INFINITY };
        let before = index.checked_sub(1).and_then(|i| self.there.get(i));
        let allowed = before.map_or(0.0, |before| {
            let secs = here.at.since(before.at).as_secs_f64().max(1e-9);
            self.apart(&here.q, &before.q) * (0.5 + LAG / secs)
        });
        self.apart(&here.q, q) - allowed
    }

    fn apart(&self, a: &Pose, b: &Pose) -> f64 {
        let of = |m: &usize| Some((a.get(*m)? - b.get(*m)?).abs());
        self.motors.iter().filter_map(of).fold(0.0, f64::max)
    }

    /// True if a reading is off the line through the two before it by more than [`JUMP`].
    fn jumps(&self, newest: &VecDeque<Passed>, next: &Passed) -> bool {
        let Some(i) = newest.len().checked_sub(2) else { return false };
        let (Some(a), Some(b)) = (newest.get(i), newest.back()) else { return false };
        let share = next.at.since(b.at).as_secs_f64() / b.at.since(a.at).as_secs_f64().max(1e-9);
        let kink = |m: &usize| {
            let (a, b, c) = (a.q.get(*m)?, b.q.get(*m)?, next.q.get(*m)?);
            Some((c - b - (b - a) * share).abs())
        };
        self.motors.iter().filter_map(kink).any(|kink| kink > JUMP)
    }

    /// True if the robot is in motion, by the means of the two halves of the newest readings, as for noisy
    /// encoders.
    fn moves(&self, newest: &VecDeque<Passed>, next: &Passed) -> bool {
        let half = WINDOW / 2;
        let Some(start) = (newest.len() + 1).checked_sub(WINDOW) else { return false };
        let window: Vec<&Passed> = newest.range(start..).chain([next]).collect();
        let Some(first) = window.first() else { return false };
        let secs = next.at.since(first.at).as_secs_f64() * half as f64 / (WINDOW - 1) as f64;
        let way = |m: &usize| {
            let sum = |part: &[&Passed]| part.iter().filter_map(|p| p.q.get(*m)).sum::<f64>();
            let (older, newer) = window.split_at(half.min(window.len()));
            (sum(newer) - sum(older)).abs() / half as f64
        };
        self.motors.iter().map(way).fold(0.0, f64::max) >= self.rest_speed * secs + self.count
    }
}
