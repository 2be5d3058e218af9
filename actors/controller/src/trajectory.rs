//! Reference trajectory of a motion under forces, as the controller kind `fields` streams it: the target attracts;
//! limits, constraints and fields push.
//!
//! ```text
//! torques of the fields ─┐
//! target ────────────────┴─> law of each part ─> velocities ─> share of speed, acceleration ─> positions within limits
//! ```
//! The law acts on a reference that the robot follows, not on its readings, so that the board's noise and latency do
//! not make it oscillate. The reference never runs far ahead of the robot.

use crate::{FieldRules, Rules};
use mobee_contract::Pose;
use mobee_model::{ForceLaw, Influences};
use std::ops::Range;
use std::time::Duration;

/// Greatest lead of the reference over the robot, in time at its greatest speed. With a longer one, a robot that was
/// held would jump when released.
const MAX_LEAD: Duration = Duration::from_millis(150);
/// Share of the tolerance within which a slow reference goes straight to its target.
const ARRIVAL_SHARE: f64 = 0.5;
/// Speed of that last motion, rad/s.
const ARRIVAL_SPEED: f64 = 0.01;
/// Rate at which the reference settles where the law has come to rest, 1/s.
const SETTLE_RATE: f64 = 5.0;
/// Gain that draws the robot to the reference if only velocities can be streamed, 1/s.
const VELOCITY_GAIN: f64 = 4.0;

/// State of a reference trajectory.
#[derive(Clone, Debug)]
pub struct ReferenceTrajectory {
    /// Motors and force law of each body part, with the target set.
    laws: Vec<(Range<usize>, ForceLaw)>,
    /// Target, rad.
    target: Pose,
    /// True if each motor moves to the target; the others stay.
    moves: Vec<bool>,
    /// Greatest speed of each motor in this motion, rad/s.
    caps: Vec<f64>,
    /// Position of the reference, rad.
    q: Vec<f64>,
    /// Velocity of the reference, rad/s.
    v: Vec<f64>,
}

impl ReferenceTrajectory {
    /// A motion from rest at `here`; no motor moves before [`ReferenceTrajectory::aim`].
    pub fn new(here: &[f64]) -> ReferenceTrajectory {
        let n = here.len();
        ReferenceTrajectory {
            laws: Vec::new(),
            target: here.into(),
            moves: vec![false; n],
            caps: vec![0.0; n],
            q: here.to_vec(),
            v: vec![0.0; n],
        }
    }

    /// Sets the target of these motors, each with its greatest speed (rad/s). Motors that were moving before go on to
    /// their value in `target`.
    pub fn aim(&mut self, fields: &FieldRules, target: &Pose, motors: &[(usize, f64)]) {
        for (m, cap) in motors {
            if let (Some(moves), Some(slot)) = (self.moves.get_mut(*m), self.caps.get_mut(*m)) {
                *moves = true;
                *slot = *cap;
            }
        }
        self.target = target.clone();
        let degrees: Vec<f64> = target.iter().map(|q| q.to_degrees()).collect();
        let aimed = |(range, law): &(Range<usize>, ForceLaw)| {
            let of = |list: &[bool]| list.get(range.clone()).map(<[bool]>::to_vec).unwrap_or_default();
            (range.clone(), law.aimed(degrees.get(range.clone()).unwrap_or_default(), &of(&self.moves)))
        };
        self.laws = fields.laws.iter().map(aimed).collect();
    }

    /// Position of the reference, rad.
    pub fn q(&self) -> &[f64] {
        &self.q
    }

    /// Motors that move.
    pub fn motors(&self) -> Vec<usize> {
        self.moves.iter().enumerate().filter(|(_, moves)| **moves).map(|(m, _)| m).collect()
    }

    /// Returns whether the reference has reached its target.
    pub fn is_there(&self) -> bool {
        self.q.iter().zip(self.target.iter()).zip(&self.moves).all(|((q, x), moves)| !moves || q == x)
    }

    /// Velocities with which a robot at `here` follows the reference, rad/s.
    pub fn velocities(&self, here: &[f64]) -> Vec<f64> {
        let moving = self.q.iter().zip(&self.v).zip(here).zip(&self.moves);
        moving.map(|(((q, v), here), moves)| if *moves { v + VELOCITY_GAIN * (q - here) } else { 0.0 }).collect()
    }

    /// Advances the reference by a period of `secs` seconds under the forces. `here`: newest reading of the robot;
    /// `torques`: effect of the fields on its motors.
    pub fn step(&mut self, here: &[f64], torques: &[f64], rules: &Rules, secs: f64) {
        if self.is_there() || here.len() != self.q.len() || secs <= 0.0 {
            self.v.fill(0.0);
            return;
        }
        let wanted = self.wanted(torques, secs);
        // All motors slow down together, so that the direction of motion is preserved.
        let moving = wanted.iter().zip(&self.caps).zip(&self.moves).filter(|(_, moves)| **moves);
        let share = moving.map(|((v, cap), _)| if v.abs() > *cap { cap / v.abs() } else { 1.0 }).fold(1.0, f64::min);
        let motors = self.q.iter_mut().zip(&mut self.v).zip(wanted).zip(here).zip(rules.axes.iter()).zip(&self.moves);
        for (((((q, v), wanted), here), axis), _) in motors.filter(|(_, moves)| **moves) {
            let push = axis.max_acceleration * secs;
            let next = (share * wanted).clamp(*v - push, *v + push).clamp(-axis.max_speed, axis.max_speed);
            let low = axis.min.min(axis.max);
            let high = axis.max.max(axis.min);
            let to = (*q + next * secs).clamp(low, high);
            // A reference that is far ahead waits for the robot.
            let waits = (to - here).abs() > (axis.max_speed * MAX_LEAD.as_secs_f64()).max((*q - here).abs());
            let to = if waits { *q } else { to };
            *v = if to == *q + next * secs { next } else { (to - *q) / secs };
            *q = to;
        }
        self.arrive(rules, secs);
    }

    /// Velocities requested by the force laws, rad/s.
    fn wanted(&self, torques: &[f64], secs: f64) -> Vec<f64> {
        let degrees = |list: &[f64], range: &Range<usize>| -> Vec<f64> {
            list.get(range.clone()).unwrap_or_default().iter().map(|x| x.to_degrees()).collect()
        };
        let mut wanted = vec![0.0; self.q.len()];
        for (range, law) in &self.laws {
            let q = degrees(&self.q, range);
            let v = degrees(&self.v, range);
            let to = degrees(&self.target, range);
            let influences =
                Influences { to: &to, field: torques.get(range.clone()).unwrap_or_default(), outside: &[] };
            // Where the law rests, a small distance to the target remains.
            let velocities = law.velocities(&q, &v, influences, secs);
            let velocities =
                velocities.unwrap_or_else(|| q.iter().zip(&to).map(|(q, x)| SETTLE_RATE * (x - q)).collect());
            for (slot, v) in wanted.iter_mut().skip(range.start).zip(velocities) {
                *slot = if v.is_finite() { v.to_radians() } else { 0.0 };
            }
        }
        wanted
    }

    /// Completes a step: near its target and slow, the reference goes straight there, since springs would take for
    /// ever.
    fn arrive(&mut self, rules: &Rules, secs: f64) {
        let near = ARRIVAL_SHARE * rules.tolerance;
        let mut ways = self.q.iter().zip(self.target.iter()).zip(&self.v).zip(&self.moves).filter(|(_, moves)| **moves);
        if ways.all(|(((q, x), v), _)| (x - q).abs() <= near && v.abs() <= rules.rest_speed) {
            for ((q, x), moves) in self.q.iter_mut().zip(self.target.iter()).zip(&self.moves) {
                if *moves {
                    let most = ARRIVAL_SPEED * secs;
                    *q = if (x - *q).abs() <= most { *x } else { *q + (x - *q).clamp(-most, most) };
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
