//! Stall detection: a motor that does not follow its commands is held by something that is not in the model.
//!
//! Algorithm 6 acts on what the model predicts. A person, a cable, or a cup that no camera has detected is not in the
//! model; but a motor that meets it falls behind its commands. Therefore each motor of a motion has a *ghost*, which
//! moves half as fast as the motor does when it follows freely, and is never behind it. When the motor stands still,
//! its ghost moves on:
//!
//! ```text
//! motor ●━━━━━━━━━━━━━━▶┃ held        ghost ○ ─ ─ ─ ─ ─ ─▶
//!                       ├──── lag ────┤  beyond a threshold, in three readings: a stall
//! ```
//! The only assumption about the board's profile is: a motor that stops at a target does not brake harder than one
//! whose speed is proportional to its remaining distance (a constant deceleration brakes half as hard, a minimum-jerk
//! trajectory two thirds). So the ghost's speed decreases with its remaining distance, and neither a board's latency
//! nor its braking at the target is taken for a stall.
//!
//! The lag of a motor in its own free motions is learned: the threshold is twice that, and never below the bound of the
//! settings. Until a few free motions of a motor were seen, the threshold is three times the bound.
//!
//! Late, missing or bit-identical readings never indicate a stall.

mod lag;

use crate::pulse::Pulse;
use crate::{FRESH_PERIODS, Rules};
use lag::{CommandedMotion, Moment, TrackedCommand};
use mobee_contract::{Command, Pose, Time};
use std::collections::VecDeque;
use std::time::Duration;

/// Number of consecutive readings that must show a stall: noise shows it in one.
const READINGS: u32 = 3;
/// Number of free motions from which the lag of a motor counts as known.
const MIN_MOTIONS: u32 = 5;
/// Factor on the bound until then.
const UNKNOWN_LAG_FACTOR: f64 = 3.0;
/// Ratio of the threshold to the greatest lag in free motions.
const THRESHOLD_RATIO: f64 = 2.0;
/// Decay of the greatest lag per motion.
const DECAY_PER_MOTION: f64 = 0.98;
/// Greatest threshold, in bounds: a motor that needs more needs another bound, and its false stops are reported.
const MAX_THRESHOLD: f64 = 10.0;
/// Share of the bound below which lags are noise.
const NOISE: f64 = 0.1;
/// Least length of a motion that shows how a motor follows, in bounds.
const MIN_TRAVEL: f64 = 4.0;

/// Time over which speeds are measured: encoders are noisy, and slow motors are to be watched as well.
const SPEED_WINDOW: Duration = Duration::from_millis(150);

/// Motor that does not follow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stalled {
    /// Index of the motor.
    pub motor: usize,
    /// Lead of its ghost, rad.
    pub by: f64,
}

/// Commands that the motors of an open motion track. Dropped with the motion: commands from before a closing of the
/// filter no longer count.
#[derive(Clone, Debug, Default)]
pub struct TrackedCommands(Vec<Option<TrackedCommand>>);

/// Knowledge of a motor from all its motions.
#[derive(Clone, Copy, Debug, Default)]
struct Learned {
    /// Recent greatest lag in free motions, rad.
    most: f64,
    /// Number of these motions.
    motions: u32,
    /// Position of the last stall, rad, and the direction of motion.
    place: Option<(f64, f64)>,
}

/// Watches whether the motors of one robot follow their commands.
#[derive(Clone, Debug)]
pub struct StallWatch {
    /// Least lag that counts, rad.
    bound: f64,
    /// Readings of the last [`SPEED_WINDOW`], oldest first.
    readings: VecDeque<(Time, Pose)>,
    motors: Vec<Learned>,
}

impl StallWatch {
    /// Creates the watch of a robot under these rules; `None` if stalls are not detected.
    pub fn new(rules: &Rules) -> Option<StallWatch> {
        let motors = vec![Learned::default(); rules.axes.len()];
        Some(StallWatch { bound: rules.stall?, readings: VecDeque::new(), motors })
    }

    /// Lag from which a motor counts as stalled, rad.
    pub fn threshold(&self, motor: usize) -> f64 {
        let learned = self.motors.get(motor).copied().unwrap_or_default();
        let unsure = if learned.motions < MIN_MOTIONS { UNKNOWN_LAG_FACTOR } else { 1.0 };
        (unsure * self.bound).max(THRESHOLD_RATIO * learned.most).min(MAX_THRESHOLD * self.bound)
    }

    /// Records a command that was admitted at `now`.
    pub fn track(&self, commands: &mut TrackedCommands, command: &Command, now: Time, rules: &Rules) {
        let Some((_, here)) = self.readings.back() else { return };
        commands.0.resize(rules.axes.len(), None);
        let mut set = |m: usize, motion: Option<CommandedMotion>| {
            if let (Some(slot), Some(q)) = (commands.0.get_mut(m), here.get(m)) {
                *slot = motion.map(|motion| TrackedCommand::new(motion, *q));
            }
        };
        match command {
            Command::Move(course) => {
                for (i, m) in course.motors.iter().enumerate() {
                    let from = here.get(*m).copied().unwrap_or_default();
                    set(*m, CommandedMotion::to(course, i, (from, self.speed(*m)), now, rules));
                }
            }
            Command::Stop { motors } if motors.is_empty() => commands.0.clear(),
            Command::Stop { motors } => motors.iter().for_each(|m| set(*m, None)),
            Command::Direct { motors, q: values } | Command::Velocity { motors, speed: values } => {
                let positions = matches!(command, Command::Direct { .. });
                for (m, value) in motors.iter().zip(values) {
                    let (Some(slot), Some(q)) = (commands.0.get_mut(*m), here.get(*m)) else { continue };
                    let tracked = slot.take().filter(|tracked| tracked.motion.is_stream_of(positions));
                    let mut tracked =
                        tracked.unwrap_or_else(|| TrackedCommand::new(CommandedMotion::stream(positions, *q), *q));
                    tracked.motion.add_set_point(*value, now);
                    *slot = Some(tracked);
                }
            }
            Command::Reference { .. } | Command::Mode { .. } => {}
        }
    }

    /// Processes a reading. Returns a motor that does not follow its command. Must be called with all fresh readings,
    /// also those between motions.
    pub fn read(&mut self, commands: &mut TrackedCommands, pulse: &Pulse, rules: &Rules) -> Option<Stalled> {
        let at = pulse.sample.at;
        let q = &pulse.sample.q;
        // A reading that is equal to the last bit is no new reading; frozen encoders are detected elsewhere (I26).
        if pulse.unchanged < at {
            return None;
        }
        let (before, last) = self.take(at, q, rules.fresh)?;
        // The board's motion during a gap is unknown: it may have braked by itself.
        let known = at > before && at <= before + rules.fresh && last.len() == q.len();
        // During missing readings the board may have waited as well, as on a busy machine: the ghost does not run on.
        let pauses = at > before + rules.period * FRESH_PERIODS;
        let dt = at.since(before).as_secs_f64();
        let mut worst: Option<Stalled> = None;
        for (m, tracked) in commands.0.iter_mut().enumerate() {
            let (Some(tracked), Some(axis)) = (tracked, rules.axes.get(m)) else { continue };
            let (Some(q), Some(last)) = (q.get(m).copied(), last.get(m)) else { continue };
            if !known {
                tracked.restart(q);
                continue;
            }
            if pauses {
                tracked.wait((before, at), q, rules);
                continue;
            }
            let moment = Moment { at, q, by: q - last, speed: self.speed(m), dt, noise: NOISE * self.bound };
            let by = tracked.lag(&moment, axis, rules);
            let beyond = by > self.threshold(m);
            tracked.beyond = if beyond { tracked.beyond + 1 } else { 0 };
            if tracked.beyond >= READINGS && worst.is_none_or(|worst| by > worst.by) {
                worst = Some(Stalled { motor: m, by });
            }
        }
        if let Some(Stalled { motor, .. }) = worst
            && let (Some(learned), Some(Some(tracked)), Some(q)) =
                (self.motors.get_mut(motor), commands.0.get(motor), q.get(motor))
        {
            learned.place = Some((*q, tracked.motion.direction()));
        }
        worst
    }

    /// Stores a reading and returns the previous one. After a gap, the readings before it are dropped.
    fn take(&mut self, at: Time, q: &Pose, fresh: Duration) -> Option<(Time, Pose)> {
        let before = self.readings.back().cloned();
        if before.as_ref().is_some_and(|(before, last)| at > *before + fresh || last.len() != q.len()) {
            self.readings.clear();
        }
        self.readings.push_back((at, q.clone()));
        while self.readings.get(1).is_some_and(|(first, _)| *first + SPEED_WINDOW <= at) {
            self.readings.pop_front();
        }
        before
    }

    /// Speed of a motor, rad/s; zero until there are enough readings.
    fn speed(&self, motor: usize) -> f64 {
        let (Some((t0, a)), Some((t1, b))) = (self.readings.front(), self.readings.back()) else { return 0.0 };
        let over = t1.since(*t0);
        let known = over >= SPEED_WINDOW / 2;
        let travel = a.get(motor).zip(b.get(motor)).filter(|_| known).map_or(0.0, |(a, b)| b - a);
        travel / over.as_secs_f64().max(1e-3)
    }

    /// Learns from a motion that ended as it should: the lag of its motors is that of free motors.
    pub fn learn(&mut self, commands: &TrackedCommands) {
        let Some((_, q)) = self.readings.back() else { return };
        let min_travel = MIN_TRAVEL * self.bound;
        for ((tracked, learned), q) in commands.0.iter().zip(&mut self.motors).zip(q.iter()) {
            let Some(tracked) = tracked.as_ref().filter(|tracked| (q - tracked.from).abs() > min_travel) else {
                continue;
            };
            learned.most = tracked.most.max(DECAY_PER_MOTION * learned.most);
            learned.motions = learned.motions.saturating_add(1);
        }
    }

    /// Returns a motor that passes the position of its last stall: the obstacle is gone, or there was none. Each is
    /// returned once.
    pub fn passes(&mut self) -> Option<usize> {
        let (_, q) = self.readings.back()?;
        let beyond = |place: &(f64, f64), q: f64| (q - place.0) * place.1 > MIN_TRAVEL * self.bound;
        let mut motors = self.motors.iter_mut().zip(q.iter()).enumerate();
        motors.find_map(|(m, (learned, q))| learned.place.take_if(|place| beyond(place, *q)).map(|_| m))
    }
}

#[cfg(test)]
mod tests;
