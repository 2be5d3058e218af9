//! The retreat of a motion, by the measured poses (I22).
//!
//! It runs along what was measured from the commit to the stop, backwards and in order, and at that rate: the robot is nowhere earlier
//! than it was on its way there, and is in motion about as long. Who goes back with others may have to wait for them, and rests
//! meanwhile, so only time in motion counts, there and back. An encoder that jumps says nothing of its motor.

use mobee_contract::{MotorUnits, Pose, Time};
use std::collections::VecDeque;
use std::time::Duration;

/// How a violation about the duration of a retreat begins.
pub const SLOW_RETREAT: &str = "was in motion for";
/// How far beside the path that was measured a motor may be, rad: a degree, and half of one for overshooting. A path that ends in a
/// stop begins, backwards, with the motors' greatest acceleration. Who is one set-point late then catches up faster than it came, and
/// where set-points brake just as hard, at the beginning of the motion, it can't lose that speed before them.
const BESIDE: f64 = 1.5 * std::f64::consts::PI / 180.0;
/// By how much more a motor may be behind the others than it was on the way there, s: each starts and brakes by itself.
const LAG: f64 = 0.12;
/// How much of the way may have been made before its time, s: readings and events are told by different threads.
const EARLY: f64 = 0.1;
/// How much longer the robot may be in motion, as a share and in seconds: it is made to wait, and catches up. So many seconds more each
/// time it has to make a halt.
const LONGER: (f64, f64) = (1.25, 0.5);
/// For as many halts an arm that sags counts as it settles at the end.
const SETTLES: u32 = 2;
/// By so many times more it may be before its time: how far it sags differs on the way back.
const SAGS: f64 = 3.0;
/// A kink of the readings that is no motion, rad.
const JUMP: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// How many readings tell motion from rest.
const WINDOW: usize = 8;
/// After a pause of so many control periods nobody knows how the robot came on.
const PAUSE: u32 = 8;
/// A retreat is stepped by readings, and goes no farther by one of them than in so many control periods: where readings are missing it is
/// slower than it came.
const STEP: u32 = 2;
/// A motion of more readings is not judged.
const KEPT: usize = 1 << 14;

/// A reading, and how long the robot had been in motion by then, s.
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
    back: Option<Back>,
    /// How often it waited for a robot that was in its way.
    halts: u32,
    /// How much of the way may have been made before its time, s.
    early: f64,
    /// How far beside its path it may be, rad.
    beside: f64,
    /// A count of its encoders, rad: one that flickers is no motion.
    count: f64,
    /// Whether a board is known to be late, so that the retreat waits for it again and again.
    late: bool,
    /// Set once the way there, or the retreat, can't be told.
    lost: bool,
}

/// The retreat so far.
struct Back {
    began: Time,
    /// Where on the way there the robot is now.
    here: usize,
    newest: VecDeque<Passed>,
    /// Whether set-points are streamed, so that its rate is told.
    streamed: bool,
}

impl RetreatPace {
    /// Of these motors of a robot that rests below this speed, rad/s, and is controlled with this period, s.
    pub fn new(motors: &[(usize, f64)], rest_speed: f64, period: f64, units: &MotorUnits) -> RetreatPace {
        let pause = Duration::try_from_secs_f64(period).unwrap_or_default() * PAUSE;
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
            lost: false,
        };
        way.join(motors);
        way
    }

    /// More motors take part.
    pub fn join(&mut self, motors: &[(usize, f64)]) {
        let new: Vec<usize> = motors.iter().map(|(m, _)| *m).filter(|m| !self.motors.contains(m)).collect();
        self.motors.extend(new);
    }

    /// The retreat begins. Another one after a failed one is not judged: it leaves out detours.
    pub fn turn(&mut self, at: Time) {
        if self.back.is_some() {
            return self.forget();
        }
        // the board is later than its `latency_ms`: stopped before it showed any motion, it sets out after all until the stop reaches
        // it, and nothing was measured that it could retrace. Where it ends is judged all the same (I3)
        if self.there.back().is_none_or(|last| last.moved <= 0.0) {
            return self.forget();
        }
        let newest = self.there.range(self.there.len().saturating_sub(WINDOW)..).cloned().collect();
        self.back = Some(Back { began: at, here: self.there.len().saturating_sub(1), newest, streamed: true });
    }

    /// Where the robot was on the way there, at the instant of one of its readings.
    pub fn was_at(&self, at: Time) -> Option<&Pose> {
        self.there.iter().find(|passed| passed.at == at).map(|passed| &passed.q)
    }

    /// It is driven by moves from way-point to way-point, each of which the board starts and ends.
    pub fn is_moved(&mut self) {
        self.back.iter_mut().for_each(|back| back.streamed = false);
    }

    /// It makes a halt: another robot is in its way.
    pub fn halts(&mut self) {
        self.halts += 1;
    }

    /// Its arm sags, by so much at most, rad: it is commanded higher, beside its path, and settles, once or twice.
    pub fn sags(&mut self, by: f64) {
        self.beside += by;
        self.halts += SETTLES;
        self.early = SAGS * EARLY;
    }

    /// Its encoders have counts of so much, rad.
    pub fn counts(&mut self, count: f64) {
        self.count = count;
    }

    /// A board heeds late what it is told: how long the retreat takes is not judged.
    pub fn is_late(&mut self) {
        self.late = true;
    }

    /// The path, or what comes next, is not known.
    pub fn forget(&mut self) {
        self.lost = true;
    }

    /// Takes the next reading. Returns what is wrong with the retreat, in words, once.
    pub fn take(&mut self, at: Time, q: &Pose) -> Option<String> {
        let newest = self.back.as_ref().map_or(&self.there, |back| &back.newest);
        let last = newest.back().map_or((at, 0.0), |last| (last.at, last.moved));
        if self.lost || !newest.is_empty() && at <= last.0 {
            return None;
        }
        let pause = at.since(last.0);
        let mut next = Passed { at, q: q.clone(), moved: last.1 };
        if self.moves(newest, &next) {
            let counts = if self.back.is_some() { pause.min(self.pause / PAUSE * STEP) } else { pause };
            next.moved += counts.as_secs_f64();
        }
        self.lost = pause > self.pause || self.jumps(newest, &next) || self.there.len() == KEPT;
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

    /// Whether the way there is what it was: the place that is nearest to the beginning, in order, and when the robot was there.
    fn compare(&mut self, now: &Passed) -> Option<String> {
        let back = self.back.as_ref()?;
        let (all, was) = (self.there.back()?.moved, back.here);
        let Some(here) = (0..=was).rev().find(|i| self.beside(*i, &now.q) <= self.beside) else {
            let nearest = (0..=was).map(|i| self.beside(i, &now.q)).fold(f64::INFINITY, f64::min);
            let beside = self.units.told(nearest, 2);
            return Some(format!("is {beside} beside the way that it came, or not on it in order, at {}", now.at));
        };
        let gone = all - self.there.get(here)?.moved;
        let (secs, streamed) = (now.at.since(back.began).as_secs_f64(), back.streamed);
        self.back.iter_mut().for_each(|back| back.here = here);
        (streamed && gone > secs + self.early)
            .then(|| format!("has gone {gone:.2} s of its retreat in {secs:.2} s at {}", now.at))
    }

    /// The robot is back. Returns what is wrong with how long it took, in words.
    pub fn over(&self) -> Option<String> {
        let back = self.back.as_ref().filter(|back| back.streamed && !self.late && !self.lost)?;
        let there = self.there.back()?.moved;
        let took = back.newest.back()?.moved - there;
        let gone = there - self.there.get(back.here)?.moved;
        (took > LONGER.0 * there + LONGER.1 * f64::from(1 + self.halts))
            .then(|| format!("{SLOW_RETREAT} {took:.2} s on {gone:.2} s of its retreat"))
    }

    /// How far a pose is from the path about one of its readings, rad: at most half a step from the nearest of them, and what the
    /// motors go in their lag.
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

    /// Whether a reading is off the line through the two before it.
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

    /// Whether the robot is in motion: by the means of the two halves of the newest readings, as for encoders with noise.
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
