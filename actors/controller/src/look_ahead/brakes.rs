//! Stopping distance of a robot: as its board states it at first, then as measured.

use super::course::{CurrentMotion, MovingMotor};
use crate::reflex::HALT_ACCELERATION_SHARE;
use crate::{Rules, within};
use mobee_contract::{Axis, Pose};

/// Plausible range of a measured stopping distance, as a ratio to the predicted one: outside of it, the stop was
/// lost.
const PLAUSIBLE_RATIO: (f64, f64) = (0.8, 3.0);
/// Share by which a shorter stop lowers the estimate.
const DECAY_PER_STOP: f64 = 0.1;
/// Least predicted stopping distance of a measurement, in seconds at the rest speed: well above encoder noise.
const MIN_STOP_TIME: f64 = 0.5;

/// Factor on predicted stopping distances: while its acceleration changes, a motor's speed is known to two percent,
/// and stopping distances grow with its square.
const SAFETY_FACTOR: f64 = 1.04;

/// Braking behavior of the motors.
#[derive(Clone, Debug, Default)]
pub(super) struct Brakes {
    /// Ratio of each motor's measured stopping distance to the one stated by its board.
    factors: Vec<f64>,
    /// Last configuration with an open filter, and the stopping distance of each motor as stated by its board.
    last: Option<(Pose, Vec<f64>)>,
    /// The same at the beginning of the stop, while the robot brakes.
    stopping: Option<(Pose, Vec<f64>)>,
}

impl Brakes {
    /// Predicts the configurations of the robot at these shares of the time to rest, if it were stopped at this
    /// reading; each motor brakes by itself. `open`: by a stop command; else the robot may be retreating, and halts
    /// on its path.
    pub fn ahead(&self, q: &Pose, motion: &CurrentMotion, open: bool, rules: &Rules, parts: &[f64]) -> Vec<Pose> {
        let stops: Vec<PredictedStop> = if open { stops(motion, rules) } else { halts(motion, rules) };
        if stops.iter().all(PredictedStop::is_none) {
            return vec![q.clone(); parts.len()];
        }
        let rest = stops.iter().map(PredictedStop::time).fold(0.0, f64::max);
        let factor = |m: usize| self.factors.get(m).copied().unwrap_or(1.0);
        let at = |part: f64| -> Pose {
            let end = |(m, ((q, axis), stop)): (usize, ((&f64, &Axis), &PredictedStop))| match stop.is_none() {
                true => *q,
                // No motor goes beyond its limits.
                false => within(q + stop.way(part * rest) * factor(m) * SAFETY_FACTOR, axis),
            };
            q.iter().zip(rules.axes.iter()).zip(&stops).enumerate().map(end).collect()
        };
        parts.iter().map(|part| at(*part)).collect()
    }

    /// Measures a stop: from the reading at which the filter was closed to the first reading at rest.
    pub fn learn(&mut self, q: &Pose, motion: &CurrentMotion, open: bool, rules: &Rules) {
        if open {
            let ways = stops(motion, rules).iter().map(|stop| stop.way(f64::INFINITY)).collect();
            self.last = Some((q.clone(), ways));
            self.stopping = None;
            return;
        }
        self.stopping = self.last.take().or(self.stopping.take());
        let rests = motion.motors.iter().all(|m| m.speed.abs() < rules.rest_speed);
        let Some((from, ways)) = self.stopping.take_if(|_| rests) else { return };
        self.factors.resize(q.len(), 1.0);
        for (factor, ((from, q), way)) in self.factors.iter_mut().zip(from.iter().zip(q.iter()).zip(&ways)) {
            if way.abs() > MIN_STOP_TIME * rules.rest_speed {
                let measured = ((q - from) / way).clamp(PLAUSIBLE_RATIO.0, PLAUSIBLE_RATIO.1);
                // A longer stop raises the estimate at once; shorter stops lower it gradually.
                *factor = measured.max(*factor + DECAY_PER_STOP * (measured - *factor));
            }
        }
    }
}

/// Predicts the stop of each motor as stated by its board.
fn stops(motion: &CurrentMotion, rules: &Rules) -> Vec<PredictedStop> {
    // If the stop is not sent at this reading, it is sent at the next one.
    stops_after(rules.latency.as_secs_f64() + motion.period, 1.0, motion, rules)
}

/// Predicts the halt of each motor of a retreat: the board lags its set-points by a control period, and the
/// set-points brake less hard than the board can.
fn halts(motion: &CurrentMotion, rules: &Rules) -> Vec<PredictedStop> {
    stops_after(rules.follows().as_secs_f64() + motion.period, HALT_ACCELERATION_SHARE, motion, rules)
}

/// Predicts the stop of each motor that moves on for `reaction`, s, then brakes by this share of its greatest
/// acceleration.
fn stops_after(reaction: f64, share: f64, motion: &CurrentMotion, rules: &Rules) -> Vec<PredictedStop> {
    let stop = |(m, axis): (&MovingMotor, &Axis)| match m.speed.abs() < rules.rest_speed {
        true => PredictedStop::default(),
        false => PredictedStop::new(*m, reaction, share * axis.max_acceleration, axis.max_speed),
    };
    motion.motors.iter().zip(rules.axes.iter()).map(stop).collect()
}

/// Predicted stop of a motor: it accelerates as now until the stop takes effect, then brakes as hard as it can.
#[derive(Clone, Copy, Debug, Default)]
struct PredictedStop {
    sign: f64,
    /// Speed, and acceleration until the stop takes effect at `time`; rad/s, rad/s^2, s.
    speed: f64,
    gain: f64,
    time: f64,
    /// Speed at that time, and deceleration.
    then: f64,
    brakes: f64,
}

impl PredictedStop {
    fn new(moving: MovingMotor, reaction: f64, brakes: f64, max_speed: f64) -> PredictedStop {
        let sign = moving.speed.signum();
        let brakes = brakes.max(1e-6);
        let speed = moving.speed.abs();
        let gain = (moving.gain * sign).clamp(-brakes, brakes);
        // A decelerating motor comes to rest and does not reverse.
        let time = if gain < 0.0 { reaction.min(-speed / gain) } else { reaction };
        let then = (speed + gain * time).clamp(0.0, max_speed.max(speed));
        PredictedStop { sign, speed, gain: (then - speed) / time.max(1e-9), time, then, brakes }
    }

    fn is_none(&self) -> bool {
        self.sign == 0.0
    }

    /// Time to rest, s.
    fn time(&self) -> f64 {
        if self.is_none() { 0.0 } else { self.time + self.then / self.brakes }
    }

    /// Distance covered after this time, rad: `v t + g t^2 / 2`, and then `u t - a t^2 / 2`.
    fn way(&self, after: f64) -> f64 {
        if self.is_none() {
            return 0.0;
        }
        let goes = after.min(self.time);
        let brakes = (after - self.time).clamp(0.0, self.then / self.brakes);
        let way = self.speed * goes + 0.5 * self.gain * goes * goes + self.then * brakes
            - 0.5 * self.brakes * brakes * brakes;
        self.sign * way
    }
}
