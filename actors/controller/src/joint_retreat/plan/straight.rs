//! The straight line with which a robot leaves something that no model knows: it has stopped the robot, bent its joints and shaken them, and
//! what was recorded meanwhile is no path to be gone back on.

use super::{Participant, RetreatPath};
use crate::distance;
use crate::history::Recorded;
use mobee_contract::{Axis, Pose};
use std::time::Duration;

/// How far from its stop a robot that pushes something unknown leaves its recorded path for the straight line, rad: what was recorded there
/// is how it was braked, bent and shaken.
const LEAVES: f64 = 3.0 * std::f64::consts::PI / 180.0;
/// The share of its motors' acceleration with which it sets out on that line.
const SETS_OUT: f64 = 0.5;

impl Participant {
    /// Replaces what was recorded within three degrees of where the robot is now by the straight line from there, gone as fast as the motion
    /// was at most: a robot that something unknown has stopped is not to push it for as long as it has been stopped by it.
    ///
    /// Left as it is where joints don't give way, where that line is not free in the model, and beside other robots, which pass only where
    /// they were recorded.
    pub fn leave_straight(&mut self) {
        if !self.rules.gives() {
            return;
        }
        let (Some(here), 1) = (self.past.last().map(|r| r.q.clone()), self.scene.robots().len()) else { return };
        let leaves = self.past.iter().enumerate().rev().take_while(|(i, _)| *i >= self.end);
        let Some((from, joins)) = leaves.into_iter().find(|(_, r)| distance(&r.q, &here) >= LEAVES) else { return };
        let joins = joins.clone();
        let at = |share: f64| -> Pose { here.iter().zip(joins.q.iter()).map(|(a, b)| a + (b - a) * share).collect() };
        let way = distance(&joins.q, &here);
        let fits = |(axis, (a, b)): (&Axis, (&f64, &f64))| axis.max_acceleration * way / (a - b).abs().max(1e-9);
        let gains = self.rules.axes.iter().zip(here.iter().zip(joins.q.iter())).map(fits).fold(f64::INFINITY, f64::min);
        let driven = self.past.get(self.end..=from).unwrap_or_default().iter().map(|r| r.speed);
        let fastest = driven.filter(|speed| speed.is_finite()).fold(self.rules.rest_speed.max(1e-3), f64::max);
        let gains = (SETS_OUT * gains).max(1e-3);
        // it gains speed, and goes on at it
        let ramp = (fastest / gains).min((2.0 * way / gains).sqrt());
        let speed = gains * ramp;
        let secs = ramp + (way - 0.5 * speed * ramp) / speed;
        let period = self.rules.period.as_secs_f64().max(1e-3);
        let steps = (secs / period).ceil().clamp(1.0, 1000.0) as usize;
        let share = |t: f64| (0.5 * gains * t.min(ramp).powi(2) + speed * (t - ramp).max(0.0)) / way;
        let line: Vec<Recorded> = (0..steps)
            .rev()
            .map(|k| {
                let left = secs * k as f64 / steps as f64;
                Recorded::next(joins.at + Duration::from_secs_f64(secs - left), at(share(left)), speed)
            })
            .collect();
        let free = |q: &Pose| self.near(q, &self.poses, self.rules.margin).is_empty() && self.bears(q);
        if line.iter().step_by(4).all(|r| free(&r.q)) {
            self.past.truncate(from + 1);
            self.past.extend(line);
            self.pressed = true;
        }
    }
}

impl RetreatPath {
    /// Whether a set-point is on the straight line off what the robot pushes: joints that this has bent or hooked are not waited for there.
    pub fn takes_off(&self, set_point: &[f64]) -> bool {
        let leaves = |(_, stop): &(f64, Pose)| self.pressed && distance(&self.of(stop), set_point) < LEAVES;
        self.points.first().is_some_and(leaves)
    }
}
