//! Straight beginning of a retreat from an obstacle that is not in the model. The obstacle has stopped the robot,
//! bent its joints and shaken them, so the recording of that time is no path to retreat on.

use super::{Participant, RetreatPath};
use crate::history::Recorded;
use mobee_contract::{Axis, Pose, distance};
use std::time::Duration;

/// Distance from the stop within which a robot that pushes an unknown obstacle retreats on a straight line, rad:
/// there, the recording shows how the robot was braked, bent and shaken.
const STRAIGHT_RADIUS: f64 = 3.0 * std::f64::consts::PI / 180.0;
/// Acceleration at the beginning of that line, as a share of the motors' acceleration.
const START_SHARE: f64 = 0.5;

impl Participant {
    /// Replaces the recording within three degrees of the present configuration by the straight line from there, at
    /// the greatest speed of the motion: the robot must not push the unknown obstacle for as long as it was being
    /// stopped by it.
    ///
    /// No-op if the joints don't deflect, if the line is not free in the model, or if there are other robots, which
    /// pass only where they were recorded.
    pub fn leave_straight(&mut self) {
        if !self.rules.gives() {
            return;
        }
        let (Some(here), 1) = (self.past.last().map(|r| r.q.clone()), self.scene.robots().len()) else { return };
        let leaves = self.past.iter().enumerate().rev().take_while(|(i, _)| *i >= self.end);
        let Some((from, joins)) = leaves.into_iter().find(|(_, r)| distance(&r.q, &here) >= STRAIGHT_RADIUS) else {
            return;
        };
        let joins = joins.clone();
        let at = |share: f64| -> Pose { here.iter().zip(joins.q.iter()).map(|(a, b)| a + (b - a) * share).collect() };
        let travel = distance(&joins.q, &here);
        let fits = |(axis, (a, b)): (&Axis, (&f64, &f64))| axis.max_acceleration * travel / (a - b).abs().max(1e-9);
        let gains = self.rules.axes.iter().zip(here.iter().zip(joins.q.iter())).map(fits).fold(f64::INFINITY, f64::min);
        let driven = self.past.get(self.end..=from).unwrap_or_default().iter().map(|r| r.speed);
        let fastest = driven.filter(|speed| speed.is_finite()).fold(self.rules.rest_speed.max(1e-3), f64::max);
        let gains = (START_SHARE * gains).max(1e-3);
        // The robot accelerates on the ramp, then moves at constant speed.
        let ramp = (fastest / gains).min((2.0 * travel / gains).sqrt());
        let speed = gains * ramp;
        let secs = ramp + (travel - 0.5 * speed * ramp) / speed;
        let period = self.rules.period.as_secs_f64().max(1e-3);
        let steps = (secs / period).ceil().clamp(1.0, 1000.0) as usize;
        let share = |t: f64| (0.5 * gains * t.min(ramp).powi(2) + speed * (t - ramp).max(0.0)) / travel;
        let line: Vec<Recorded> = (0..steps)
            .rev()
            .map(|k| {
                let left = secs * k as f64 / steps as f64;
                Recorded::next(joins.at + Duration::from_secs_f64(secs - left), at(share(left)), speed)
            })
            .collect();
        let free = |q: &Pose| self.near(q, &self.poses, self.rules.margin).is_empty() && self.satisfies_constraints(q);
        if line.iter().step_by(4).all(|r| free(&r.q)) {
            self.past.truncate(from + 1);
            self.past.extend(line);
            self.pressed = true;
        }
    }
}

impl RetreatPath {
    /// Returns whether a set-point is on the straight line away from the pushed obstacle: there, joints that are bent
    /// or hooked may be late.
    pub fn takes_off(&self, set_point: &[f64]) -> bool {
        let leaves = |(_, stop): &(f64, Pose)| self.pressed && distance(&self.of(stop), set_point) < STRAIGHT_RADIUS;
        self.points.first().is_some_and(leaves)
    }
}
