//! The short way round for continuous joints: distances between configurations, and the choice
//! among equivalent positions.
//!
//! For a robot without continuous joints, a distance is Euclidean, and a target is unchanged.

use mobee_contract::{Target, View};
use mobee_model::{Motor, Robot};
use std::f64::consts::TAU;

/// Distances in the joint space of a group of motors, rad.
#[derive(Clone, Debug, Default)]
pub struct JointMetric {
    /// For each coordinate the motor, if its full turns are ignored; empty if there is no such
    /// coordinate.
    turning: Vec<Option<Motor>>,
}

impl JointMetric {
    /// Creates the metric of these motors (indices into `Robot::motors`). A continuous joint with a
    /// range of one turn or less has two ends.
    pub fn of(motors: &[usize], robot: &Robot) -> JointMetric {
        Self::of_each(motors.iter().map(|m| robot.motors.get(*m)))
    }

    /// Creates the metric of these motors, as [`JointMetric::of`]; a missing one has two ends.
    pub fn of_each<'a>(motors: impl Iterator<Item = Option<&'a Motor>>) -> JointMetric {
        let passes = |m: &&Motor| m.continuous && m.max - m.min > TAU;
        let turning: Vec<_> = motors.map(|m| m.filter(passes).cloned()).collect();
        JointMetric { turning: if turning.iter().any(Option::is_some) { turning } else { Vec::new() } }
    }

    /// Returns whether it is the plain Euclidean metric.
    pub fn is_plain(&self) -> bool {
        self.turning.is_empty()
    }

    /// Computes the Euclidean distance over the coordinates that both have, ignoring full turns:
    /// symmetric, and at most half a turn for a continuous joint.
    pub fn distance(&self, a: &[f64], b: &[f64]) -> f64 {
        if self.is_plain() {
            return a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum::<f64>().sqrt();
        }
        let square = |(i, (x, y)): (usize, (&f64, &f64))| {
            let way = x - y;
            let way = if self.turning(i).is_some() { way - (way / TAU).round() * TAU } else { way };
            way * way
        };
        a.iter().zip(b).enumerate().map(square).sum::<f64>().sqrt()
    }

    /// Returns whether no motor has to move farther than `tolerance` (rad) from one configuration
    /// to the other. Unlike [`JointMetric::distance`] this respects the limits: positions on both
    /// sides of a limit are far apart, even if they are equal up to full turns.
    pub fn is_within(&self, from: &[f64], to: &[f64], tolerance: f64) -> bool {
        let way = |(i, (from, to)): (usize, (&f64, &f64))| self.turning(i).map_or(from - to, |m| m.way(*from, *to));
        from.iter().zip(to).enumerate().all(|pair| way(pair).abs() <= tolerance)
    }

    /// Returns whether full turns of this coordinate are ignored.
    pub fn turns(&self, i: usize) -> bool {
        self.turning(i).is_some()
    }

    fn turning(&self, i: usize) -> Option<&Motor> {
        self.turning.get(i)?.as_ref()
    }
}

/// Returns the target in the turns closest to the robot's configuration, within the limits of robot
/// and board.
pub fn nearest_target(view: &View, mut target: Target) -> Target {
    for (m, q) in target.motors.iter().zip(&mut target.q) {
        *q = nearest_position(view, *m, *q);
    }
    target
}

/// Returns the position of a motor, equivalent to `goal`, that is nearest to its current one,
/// within the limits of robot and board, rad.
pub fn nearest_position(view: &View, motor: usize, goal: f64) -> f64 {
    let model = view.scene.robots().get(view.robot).and_then(|robot| robot.motors.get(motor));
    let (Some(model), Some(here)) = (model.filter(|m| m.continuous), view.pose().get(motor)) else { return goal };
    let (min, max) = view.axes.get(motor).map_or((model.min, model.max), |axis| (axis.min, axis.max));
    let within = Motor { min: min.max(model.min), max: max.min(model.max), ..model.clone() };
    within.nearest_equivalent(*here, goal)
}
