//! How far a robot goes on after it is told to stop: as its board says at first, then as it was measured.

use super::course::{Motion, Moving};
use crate::reflex::HALT_BRAKES;
use crate::{Rules, within};
use mobee_contract::{Axis, Pose};

/// The share of what was foreseen below which a measured way is not believed, and above: a stop that was lost is no braking.
const BELIEVED: (f64, f64) = (0.8, 3.0);
/// How fast a way that turned out shorter is forgotten to have been longer, per stop.
const FORGETS: f64 = 0.1;
/// How far a motor must have been about to go for its stop to be a measurement, in seconds at the speed that counts as rest: well
/// above the noise of encoders.
const TELLING: f64 = 0.5;

/// By how much longer a way is taken to be than foreseen: while its acceleration changes, a motor's speed is known to two percent, and
/// ways grow with its square.
const UNSURE: f64 = 1.04;

/// How the motors brake.
#[derive(Clone, Debug, Default)]
pub(super) struct Brakes {
    /// Per motor how many times as far it goes on as by what its board says.
    factors: Vec<f64>,
    /// Where the robot was when it was last seen open, and how far each motor would have gone on, by the board's word.
    last: Option<(Pose, Vec<f64>)>,
    /// The same as it was told to stop, while it brakes.
    told: Option<(Pose, Vec<f64>)>,
}

impl Brakes {
    /// Where the robot would be after these parts of the time to rest if it were told to stop at this reading, each motor braking by itself.
    /// `open`: by a stop; else it may be on its way back, and halts on its path.
    pub fn ahead(&self, q: &Pose, motion: &Motion, open: bool, rules: &Rules, parts: &[f64]) -> Vec<Pose> {
        let stops: Vec<Stop> = if open { stops(motion, rules) } else { halts(motion, rules) };
        if stops.iter().all(Stop::is_none) {
            return vec![q.clone(); parts.len()];
        }
        let rest = stops.iter().map(Stop::time).fold(0.0, f64::max);
        let factor = |m: usize| self.factors.get(m).copied().unwrap_or(1.0);
        let at = |part: f64| -> Pose {
            let end = |(m, ((q, axis), stop)): (usize, ((&f64, &Axis), &Stop))| match stop.is_none() {
                true => *q,
                // no motor goes beyond its limits
                false => within(q + stop.way(part * rest) * factor(m) * UNSURE, axis),
            };
            q.iter().zip(rules.axes.iter()).zip(&stops).enumerate().map(end).collect()
        };
        parts.iter().map(|part| at(*part)).collect()
    }

    /// Measures a stop: from the reading at which the filter was closed to the first at which the robot rests.
    pub fn learn(&mut self, q: &Pose, motion: &Motion, open: bool, rules: &Rules) {
        if open {
            let ways = stops(motion, rules).iter().map(|stop| stop.way(f64::INFINITY)).collect();
            (self.last, self.told) = (Some((q.clone(), ways)), None);
            return;
        }
        self.told = self.last.take().or(self.told.take());
        let rests = motion.motors.iter().all(|m| m.speed.abs() < rules.rest_speed);
        let Some((from, ways)) = self.told.take_if(|_| rests) else { return };
        self.factors.resize(q.len(), 1.0);
        for (factor, ((from, q), way)) in self.factors.iter_mut().zip(from.iter().zip(q.iter()).zip(&ways)) {
            if way.abs() > TELLING * rules.rest_speed {
                let measured = ((q - from) / way).clamp(BELIEVED.0, BELIEVED.1);
                // longer counts at once, shorter by and by
                *factor = measured.max(*factor + FORGETS * (measured - *factor));
            }
        }
    }
}

/// How each motor stops by its board's word.
fn stops(motion: &Motion, rules: &Rules) -> Vec<Stop> {
    // a stop that is not told at this reading is told at the next one
    stops_after(rules.latency.as_secs_f64() + motion.period, 1.0, motion, rules)
}

/// How each motor of a retreat halts: the board is a control period behind its set-points, which brake less hard than it can.
fn halts(motion: &Motion, rules: &Rules) -> Vec<Stop> {
    stops_after(rules.follows().as_secs_f64() + motion.period, HALT_BRAKES, motion, rules)
}

/// How each motor stops that goes on for so long, s, and brakes by this share of its greatest acceleration.
fn stops_after(reaction: f64, share: f64, motion: &Motion, rules: &Rules) -> Vec<Stop> {
    let stop = |(m, axis): (&Moving, &Axis)| match m.speed.abs() < rules.rest_speed {
        true => Stop::default(),
        false => Stop::new(*m, reaction, share * axis.max_acceleration, axis.max_speed),
    };
    motion.motors.iter().zip(rules.axes.iter()).map(stop).collect()
}

/// A motor that goes on as it does until the stop takes effect, and then brakes as hard as it can.
#[derive(Clone, Copy, Debug, Default)]
struct Stop {
    sign: f64,
    /// Its speed, and what it gains, until the stop takes effect at `time`; rad/s, rad/s^2, s.
    speed: f64,
    gain: f64,
    time: f64,
    /// Its speed then, and how it brakes.
    then: f64,
    brakes: f64,
}

impl Stop {
    fn new(moving: Moving, reaction: f64, brakes: f64, max_speed: f64) -> Stop {
        let (sign, brakes) = (moving.speed.signum(), brakes.max(1e-6));
        let (speed, gain) = (moving.speed.abs(), (moving.gain * sign).clamp(-brakes, brakes));
        // one that gets slower comes to rest, and does not turn round
        let time = if gain < 0.0 { reaction.min(-speed / gain) } else { reaction };
        let then = (speed + gain * time).clamp(0.0, max_speed.max(speed));
        Stop { sign, speed, gain: (then - speed) / time.max(1e-9), time, then, brakes }
    }

    fn is_none(&self) -> bool {
        self.sign == 0.0
    }

    /// How long it takes, s.
    fn time(&self) -> f64 {
        if self.is_none() { 0.0 } else { self.time + self.then / self.brakes }
    }

    /// How far it has gone after a time, rad: `v t + g t^2 / 2`, and then `u t - a t^2 / 2`.
    fn way(&self, after: f64) -> f64 {
        if self.is_none() {
            return 0.0;
        }
        let (goes, brakes) = (after.min(self.time), (after - self.time).clamp(0.0, self.then / self.brakes));
        let way = self.speed * goes + 0.5 * self.gain * goes * goes + self.then * brakes
            - 0.5 * self.brakes * brakes * brakes;
        self.sign * way
    }
}
