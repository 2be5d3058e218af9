//! A motor that does not follow: something holds it that no model knows.
//!
//! Algorithm 6 acts on what the model sees coming near. A person in the way, a cable, a cup that no camera has seen are not in the
//! model; but a motor that meets them falls behind what it was told. So each motor of a motion has a *ghost*, which goes half as fast
//! as the motor itself does when it follows freely, and is never behind it. When the motor stands still, its ghost goes on:
//!
//! ```text
//! motor ●━━━━━━━━━━━━━━▶┃ held        ghost ○ ─ ─ ─ ─ ─ ─▶
//!                       ├──── lag ────┤  beyond a threshold, in three readings: a stall
//! ```
//! Nothing is believed of the board's profile but this: who comes to rest at a target does not brake harder than one whose speed is
//! in proportion to what is left of its way (a constant deceleration brakes half as hard, a minimum-jerk trajectory two thirds). So the ghost's
//! speed shrinks with what it has left, and neither a board's latency nor the way it brakes at its target is taken for a stall.
//!
//! How far a motor lags in its own free motions is learned: the threshold is twice that, and never below the bound that the settings give.
//! Until a motor has been seen to move freely a few times, three times the bound.
//!
//! What is not there is no stall: readings that are late, missing, or equal bit for bit to the ones before judge nothing.

mod told;

use crate::Rules;
use crate::pulse::Pulse;
use mobee_contract::{Command, Pose, Time};
use std::collections::VecDeque;
use std::time::Duration;
use told::{Errand, Moment, Way};

/// So many readings in a row must show it: noise shows it in one.
const READINGS: u32 = 3;
/// How many free motions a motor must have been seen in for its lag to be known.
const ENOUGH: u32 = 5;
/// By how much greater the threshold is until then.
const UNSURE: f64 = 3.0;
/// How many times the greatest lag of its free motions a motor must lag.
const FACTOR: f64 = 2.0;
/// How fast a great lag is forgotten, per motion.
const FORGETS: f64 = 0.98;
/// The greatest threshold, in bounds: a motor that needs more is in want of another bound, and its false stops are told.
const GREATEST: f64 = 10.0;
/// Lags below this share of the bound are noise.
const NOISE: f64 = 0.1;
/// A motion shorter than this, in bounds, shows nothing of how a motor follows.
const TELLING: f64 = 4.0;

/// Over how long speeds are measured: encoders are noisy, and slow motors are to be watched as well.
const SPEED_OVER: Duration = Duration::from_millis(150);

/// A motor that does not follow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stalled {
    /// The motor.
    pub motor: usize,
    /// How far its ghost is ahead of it, rad.
    pub by: f64,
}

/// What the motors of an open motion were told. Dropped with the motion: what a filter that was closed has told counts no more.
#[derive(Clone, Debug, Default)]
pub struct Errands(Vec<Option<Errand>>);

/// What is known of a motor over all motions.
#[derive(Clone, Copy, Debug, Default)]
struct Learned {
    /// The greatest lag in free motions of late, rad.
    most: f64,
    /// In how many it was seen.
    motions: u32,
    /// Where it stalled last, and in which direction.
    place: Option<(f64, f64)>,
}

/// Watches whether the motors of one robot follow what they are told.
#[derive(Clone, Debug)]
pub struct StallWatch {
    /// The least lag that counts, rad.
    bound: f64,
    /// The readings of [`SPEED_OVER`], oldest first.
    readings: VecDeque<(Time, Pose)>,
    motors: Vec<Learned>,
}

impl StallWatch {
    /// For a robot under these rules; `None` if it is not watched.
    pub fn new(rules: &Rules) -> Option<StallWatch> {
        let motors = vec![Learned::default(); rules.axes.len()];
        Some(StallWatch { bound: rules.stall?, readings: VecDeque::new(), motors })
    }

    /// How far a motor must lag to count as stalled, rad.
    pub fn threshold(&self, motor: usize) -> f64 {
        let learned = self.motors.get(motor).copied().unwrap_or_default();
        let unsure = if learned.motions < ENOUGH { UNSURE } else { 1.0 };
        (unsure * self.bound).max(FACTOR * learned.most).min(GREATEST * self.bound)
    }

    /// A command was let through at `now`.
    pub fn hear(&self, told: &mut Errands, command: &Command, now: Time, rules: &Rules) {
        let Some((_, here)) = self.readings.back() else { return };
        told.0.resize(rules.axes.len(), None);
        let mut set = |m: usize, way: Option<Way>| {
            if let (Some(slot), Some(q)) = (told.0.get_mut(m), here.get(m)) {
                *slot = way.map(|way| Errand::new(way, *q));
            }
        };
        match command {
            Command::Move(course) => {
                for (i, m) in course.motors.iter().enumerate() {
                    let from = here.get(*m).copied().unwrap_or_default();
                    set(*m, Way::to(course, i, (from, self.speed(*m)), now, rules));
                }
            }
            Command::Stop { motors } if motors.is_empty() => told.0.clear(),
            Command::Stop { motors } => motors.iter().for_each(|m| set(*m, None)),
            Command::Direct { motors, q: values } | Command::Velocity { motors, speed: values } => {
                let positions = matches!(command, Command::Direct { .. });
                for (m, value) in motors.iter().zip(values) {
                    let (Some(slot), Some(q)) = (told.0.get_mut(*m), here.get(*m)) else { continue };
                    let errand = slot.take().filter(|errand| errand.way.is_stream_of(positions));
                    let mut errand = errand.unwrap_or_else(|| Errand::new(Way::stream(positions, *q), *q));
                    errand.way.goes_on(*value, now);
                    *slot = Some(errand);
                }
            }
            Command::Reference { .. } | Command::Mode { .. } => {}
        }
    }

    /// A reading: whether one of the motors that were told something does not follow. To be given all readings that are fresh, those
    /// between motions as well.
    pub fn read(&mut self, told: &mut Errands, pulse: &Pulse, rules: &Rules) -> Option<Stalled> {
        let (at, q) = (pulse.sample.at, &pulse.sample.q);
        // who reads the same to the last bit has read nothing new: frozen encoders are another's matter (I26)
        if pulse.unchanged < at {
            return None;
        }
        let (before, last) = self.take(at, q, rules.fresh)?;
        // after a gap nobody knows what the board did meanwhile: it may have braked by itself
        let known = at > before && at <= before + rules.fresh && last.len() == q.len();
        let dt = at.since(before).as_secs_f64();
        let mut worst: Option<Stalled> = None;
        for (m, errand) in told.0.iter_mut().enumerate() {
            let (Some(errand), Some(axis)) = (errand, rules.axes.get(m)) else { continue };
            let (Some(q), Some(last)) = (q.get(m).copied(), last.get(m)) else { continue };
            if !known {
                errand.begin_anew(q);
                continue;
            }
            let moment = Moment { at, q, by: q - last, speed: self.speed(m), dt, noise: NOISE * self.bound };
            let by = errand.lag(&moment, axis, rules);
            let beyond = by > self.threshold(m);
            errand.beyond = if beyond { errand.beyond + 1 } else { 0 };
            if errand.beyond >= READINGS && worst.is_none_or(|worst| by > worst.by) {
                worst = Some(Stalled { motor: m, by });
            }
        }
        if let Some(Stalled { motor, .. }) = worst
            && let (Some(learned), Some(Some(errand)), Some(q)) =
                (self.motors.get_mut(motor), told.0.get(motor), q.get(motor))
        {
            learned.place = Some((*q, errand.way.direction()));
        }
        worst
    }

    /// Keeps a reading, and gives the one before; after a gap nothing is left of what was before it.
    fn take(&mut self, at: Time, q: &Pose, fresh: Duration) -> Option<(Time, Pose)> {
        let before = self.readings.back().cloned();
        if before.as_ref().is_some_and(|(before, last)| at > *before + fresh || last.len() != q.len()) {
            self.readings.clear();
        }
        self.readings.push_back((at, q.clone()));
        while self.readings.get(1).is_some_and(|(first, _)| *first + SPEED_OVER <= at) {
            self.readings.pop_front();
        }
        before
    }

    /// How fast a motor is, rad/s; zero as long as nobody knows.
    fn speed(&self, motor: usize) -> f64 {
        let (Some((t0, a)), Some((t1, b))) = (self.readings.front(), self.readings.back()) else { return 0.0 };
        let over = t1.since(*t0);
        let known = over >= SPEED_OVER / 2;
        let way = a.get(motor).zip(b.get(motor)).filter(|_| known).map_or(0.0, |(a, b)| b - a);
        way / over.as_secs_f64().max(1e-3)
    }

    /// A motion has ended as it should: how far its motors lagged is what free motors do.
    pub fn learn(&mut self, told: &Errands) {
        let Some((_, q)) = self.readings.back() else { return };
        let telling = TELLING * self.bound;
        for ((errand, learned), q) in told.0.iter().zip(&mut self.motors).zip(q.iter()) {
            let Some(errand) = errand.as_ref().filter(|errand| (q - errand.from).abs() > telling) else { continue };
            learned.most = errand.most.max(FORGETS * learned.most);
            learned.motions = learned.motions.saturating_add(1);
        }
    }

    /// Whether a motor passes where it has stalled before: what held it is gone, or held it never. Each is told once.
    pub fn passes(&mut self) -> Option<usize> {
        let (_, q) = self.readings.back()?;
        let beyond = |place: &(f64, f64), q: f64| (q - place.0) * place.1 > TELLING * self.bound;
        let mut motors = self.motors.iter_mut().zip(q.iter()).enumerate();
        motors.find_map(|(m, (learned, q))| learned.place.take_if(|place| beyond(place, *q)).map(|_| m))
    }
}

#[cfg(test)]
mod tests;
