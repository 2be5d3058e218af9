//! The short way round: distances between poses, and which of many equal positions a motor that turns without end goes to.
//!
//! For a robot whose motors all have ends, a distance is Euclidean, and a target is what it was.

use mobee_contract::{Target, View};
use mobee_model::{Motor, Robot};
use std::f64::consts::TAU;

/// Distances in the joint space of a group of motors, rad.
#[derive(Clone, Debug, Default)]
pub struct JointMetric {
    /// Per coordinate the motor, if it passes from one turn to the next; nothing at all if none does.
    turning: Vec<Option<Motor>>,
}

impl JointMetric {
    /// The metric of these motors (indices into `Robot::motors`). A motor whose limits leave it one turn has two ends all the same.
    pub fn of(motors: &[usize], robot: &Robot) -> JointMetric {
        Self::of_each(motors.iter().map(|m| robot.motors.get(*m)))
    }

    /// The metric of these motors, as [`JointMetric::of`]; what is missing has two ends.
    pub fn of_each<'a>(motors: impl Iterator<Item = Option<&'a Motor>>) -> JointMetric {
        let passes = |m: &&Motor| m.continuous && m.max - m.min > TAU;
        let turning: Vec<_> = motors.map(|m| m.filter(passes).cloned()).collect();
        JointMetric { turning: if turning.iter().any(Option::is_some) { turning } else { Vec::new() } }
    }

    /// Whether it is the plain Euclidean one.
    pub fn is_plain(&self) -> bool {
        self.turning.is_empty()
    }

    /// Euclidean distance over the coordinates both have, where turns don't count: symmetric, and at most half a turn for a motor that
    /// has no end.
    pub fn distance(&self, a: &[f64], b: &[f64]) -> f64 {
        let square = |(i, (x, y)): (usize, (&f64, &f64))| {
            let way = x - y;
            let way = if self.turning(i).is_some() { way - (way / TAU).round() * TAU } else { way };
            way * way
        };
        a.iter().zip(b).enumerate().map(square).sum::<f64>().sqrt()
    }

    /// Whether no motor has farther than `tolerance` (rad) to go from one pose to the other. Unlike [`JointMetric::distance`] this
    /// minds the limits: across one, positions are apart however near they look.
    pub fn is_within(&self, from: &[f64], to: &[f64], tolerance: f64) -> bool {
        let way = |(i, (from, to)): (usize, (&f64, &f64))| self.turning(i).map_or(from - to, |m| m.way(*from, *to));
        from.iter().zip(to).enumerate().all(|pair| way(pair).abs() <= tolerance)
    }

    /// Whether turns of this coordinate don't count.
    pub fn turns(&self, i: usize) -> bool {
        self.turning(i).is_some()
    }

    fn turning(&self, i: usize) -> Option<&Motor> {
        self.turning.get(i)?.as_ref()
    }
}

/// The target in the turn that its motors have the shortest way to, within the limits of robot and board.
pub fn nearest_target(view: &View, mut target: Target) -> Target {
    for (m, q) in target.motors.iter().zip(&mut target.q) {
        *q = nearest_position(view, *m, *q);
    }
    target
}

/// Of the positions of a motor that are the same as `goal`, the nearest to where it is, within the limits of robot and board, rad.
pub fn nearest_position(view: &View, motor: usize, goal: f64) -> f64 {
    let model = view.scene.robots().get(view.robot).and_then(|robot| robot.motors.get(motor));
    let (Some(model), Some(here)) = (model.filter(|m| m.continuous), view.pose().get(motor)) else { return goal };
    let (min, max) = view.axes.get(motor).map_or((model.min, model.max), |axis| (axis.min, axis.max));
    let within = Motor { min: min.max(model.min), max: max.min(model.max), ..model.clone() };
    within.nearest_equivalent(*here, goal)
}
