//! A motion under forces, as the controller kind `fields` streams it: the target attracts, limits, constraints and
//! fields push.
//!
//! ```text
//! torques of the fields ─┐
//! target ────────────────┴─> law of each part ─> velocities ─> share of speed, acceleration ─> positions within limits
//! ```
//! The law acts upon a reference that the robot follows, not upon its readings, so that noise and latency of the board
//! do not make it tremble; the reference never runs far ahead of the robot.

use crate::{FieldRules, Rules};
use mobee_contract::Pose;
use mobee_model::{ForceLaw, Influences};
use std::ops::Range;
use std::time::Duration;

/// How far the reference may be ahead of the robot, in time at its greatest speed. Farther, a robot that
/// was held up would be let go with a jump.
const AHEAD: Duration = Duration::from_millis(150);
/// Share of the tolerance within which a slow reference goes straight to its target.
const ARRIVED: f64 = 0.5;
/// How quickly it does that, rad/s.
const LAST: f64 = 0.01;
/// How quickly it settles where the law has come to rest, 1/s.
const SETTLE: f64 = 5.0;
/// How strongly the robot is drawn to the reference where only velocities can be streamed, 1/s.
const DRAW: f64 = 4.0;

/// The state of a motion.
#[derive(Clone, Debug)]
pub struct ReferenceTrajectory {
    /// The motors of each body part, and their law, aimed.
    laws: Vec<(Range<usize>, ForceLaw)>,
    /// Where it is to come to, rad.
    target: Pose,
    /// Whether each motor is to go there; the others stay.
    moves: Vec<bool>,
    /// Greatest speed of each motor in this motion, rad/s.
    caps: Vec<f64>,
    /// Where the reference is, rad.
    q: Vec<f64>,
    /// How fast it moves, rad/s.
    v: Vec<f64>,
}

impl ReferenceTrajectory {
    /// A motion from rest at `here`; nothing moves before it is [`ReferenceTrajectory::aim`]ed.
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

    /// Gives it its target: these motors are to go there, none faster than its cap (rad/s). Motors that were moving
    /// before go on to theirs in `target`.
    pub fn aim(&mut self, fields: &FieldRules, target: &Pose, motors: &[(usize, f64)]) {
        for (m, cap) in motors {
            if let (Some(moves), Some(slot)) = (self.moves.get_mut(*m), self.caps.get_mut(*m)) {
                (*moves, *slot) = (true, *cap);
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

    /// Where it leads now, rad.
    pub fn q(&self) -> &[f64] {
        &self.q
    }

    /// The motors that move.
    pub fn motors(&self) -> Vec<usize> {
        self.moves.iter().enumerate().filter(|(_, moves)| **moves).map(|(m, _)| m).collect()
    }

    /// Whether the reference has come to its target.
    pub fn is_there(&self) -> bool {
        self.q.iter().zip(self.target.iter()).zip(&self.moves).all(|((q, x), moves)| !moves || q == x)
    }

    /// The velocities at which a robot at `here` follows, rad/s.
    pub fn velocities(&self, here: &[f64]) -> Vec<f64> {
        let moving = self.q.iter().zip(&self.v).zip(here).zip(&self.moves);
        moving.map(|(((q, v), here), moves)| if *moves { v + DRAW * (q - here) } else { 0.0 }).collect()
    }

    /// One period of `secs` seconds: the forces act, and the reference moves on. `here` is the robot's newest reading,
    /// `torques` what the fields do to its motors.
    pub fn step(&mut self, here: &[f64], torques: &[f64], rules: &Rules, secs: f64) {
        if self.is_there() || here.len() != self.q.len() || secs <= 0.0 {
            self.v.fill(0.0);
            return;
        }
        let wanted = self.wanted(torques, secs);
        // all motors slow down together, so that the way keeps its direction
        let moving = wanted.iter().zip(&self.caps).zip(&self.moves).filter(|(_, moves)| **moves);
        let share = moving.map(|((v, cap), _)| if v.abs() > *cap { cap / v.abs() } else { 1.0 }).fold(1.0, f64::min);
        let motors = self.q.iter_mut().zip(&mut self.v).zip(wanted).zip(here).zip(rules.axes.iter()).zip(&self.moves);
        for (((((q, v), wanted), here), axis), _) in motors.filter(|(_, moves)| **moves) {
            let push = axis.max_acceleration * secs;
            let next = (share * wanted).clamp(*v - push, *v + push).clamp(-axis.max_speed, axis.max_speed);
            let (low, high) = (axis.min.min(axis.max), axis.max.max(axis.min));
            let to = (*q + next * secs).clamp(low, high);
            // a reference that is far ahead waits for the robot
            let waits = (to - here).abs() > (axis.max_speed * AHEAD.as_secs_f64()).max((*q - here).abs());
            let to = if waits { *q } else { to };
            *v = if to == *q + next * secs { next } else { (to - *q) / secs };
            *q = to;
        }
        self.arrive(rules, secs);
    }

    /// What the laws want, rad/s.
    fn wanted(&self, torques: &[f64], secs: f64) -> Vec<f64> {
        let degrees = |list: &[f64], range: &Range<usize>| -> Vec<f64> {
            list.get(range.clone()).unwrap_or_default().iter().map(|x| x.to_degrees()).collect()
        };
        let mut wanted = vec![0.0; self.q.len()];
        for (range, law) in &self.laws {
            let (q, v, to) = (degrees(&self.q, range), degrees(&self.v, range), degrees(&self.target, range));
            let influences =
                Influences { to: &to, field: torques.get(range.clone()).unwrap_or_default(), outside: &[] };
            // where the law rests, the last bit of the way is left
            let velocities = law.velocities(&q, &v, influences, secs);
            let velocities = velocities.unwrap_or_else(|| q.iter().zip(&to).map(|(q, x)| SETTLE * (x - q)).collect());
            for (slot, v) in wanted.iter_mut().skip(range.start).zip(velocities) {
                *slot = if v.is_finite() { v.to_radians() } else { 0.0 };
            }
        }
        wanted
    }

    /// Called at the end of a step. Near its target and slow, the reference goes straight there: springs would take for
    /// ever.
    fn arrive(&mut self, rules: &Rules, secs: f64) {
        let near = ARRIVED * rules.tolerance;
        let mut ways = self.q.iter().zip(self.target.iter()).zip(&self.v).zip(&self.moves).filter(|(_, moves)| **moves);
        if ways.all(|(((q, x), v), _)| (x - q).abs() <= near && v.abs() <= rules.rest_speed) {
            for ((q, x), moves) in self.q.iter_mut().zip(self.target.iter()).zip(&self.moves) {
                if *moves {
                    let most = LAST * secs;
                    *q = if (x - *q).abs() <= most { *x } else { *q + (x - *q).clamp(-most, most) };
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
