//! How far a robot goes on after it is told to stop: as its board says at first, then as it was measured.

use super::course::{Motion, Moving};
use crate::{Rules, within};
use mobee_contract::{Axis, Pose};

/// The share of what was foreseen below which a measured way is not believed, and above: a stop that was lost is no braking.
const BELIEVED: (f64, f64) = (0.8, 3.0);
/// How fast a way that turned out shorter is forgotten to have been longer, per stop.
const FORGETS: f64 = 0.1;
/// How far a motor must have been about to go for its stop to be a measurement, in seconds at the speed that counts as rest: well
/// above the noise of encoders.
const TELLING: f64 = 0.5;

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
    /// Where the robot comes to rest if it is told to stop at this reading.
    pub fn rest(&self, q: &Pose, motion: &Motion, rules: &Rules) -> Pose {
        let ways = ways(motion, rules).into_iter().enumerate();
        let factor = |m: usize| self.factors.get(m).copied().unwrap_or(1.0);
        let end = |((m, way), (q, axis)): ((usize, f64), (&f64, &Axis))| match way == 0.0 {
            true => *q,
            // no motor goes beyond its limits
            false => within(q + way * factor(m), axis),
        };
        ways.zip(q.iter().zip(rules.axes.iter())).map(end).collect()
    }

    /// Measures a stop: from the reading at which the filter was closed to the first at which the robot rests.
    pub fn learn(&mut self, q: &Pose, motion: &Motion, open: bool, rules: &Rules) {
        if open {
            (self.last, self.told) = (Some((q.clone(), ways(motion, rules))), None);
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

/// How far each motor goes on by its board's word, rad.
fn ways(motion: &Motion, rules: &Rules) -> Vec<f64> {
    // a stop that is not told at this reading is told at the next one
    let reaction = rules.latency.as_secs_f64() + motion.period;
    let way = |(m, axis): (&Moving, &Axis)| match m.speed.abs() < rules.rest_speed {
        true => 0.0,
        false => way(*m, reaction, axis),
    };
    motion.motors.iter().zip(rules.axes.iter()).map(way).collect()
}

/// As it goes until the stop takes effect, and then braking as hard as it can: `v t + g t^2 / 2 + u^2 / 2a`, `u = v + g t`.
fn way(moving: Moving, reaction: f64, axis: &Axis) -> f64 {
    let (sign, most) = (moving.speed.signum(), axis.max_acceleration);
    let (speed, gain) = (moving.speed.abs(), (moving.gain * sign).clamp(-most, most));
    // one that gets slower comes to rest, and does not turn round
    let time = if gain < 0.0 { reaction.min(-speed / gain) } else { reaction };
    let then = (speed + gain * time).clamp(0.0, axis.max_speed.max(speed));
    let brakes = if most > 0.0 { then * then / (2.0 * most) } else { 0.0 };
    sign * (0.5 * (speed + then) * time + brakes)
}
