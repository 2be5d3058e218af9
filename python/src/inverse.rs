//! Inverse kinematics of a frame: damped least squares from a seed, then from random starts. No Python here.

use crate::chain::Chain;
use mobee_model::{Robot, random_poses};
use mobee_planning::inverse_kinematics::{MotorGroup, PER_METER};
use nalgebra::{UnitQuaternion, Vector3};

/// Two solutions are one if no motor is farther apart than this, rad of encoder.
const SAME: f64 = 1e-3;

/// The pose to reach, and the effort.
#[derive(Clone, Debug)]
pub(crate) struct FrameGoal {
    /// Position of the frame's origin in the base frame, meters.
    pub at: Vector3<f64>,
    /// Orientation of the frame in the base frame; `None`: any.
    pub turn: Option<UnitQuaternion<f64>>,
    /// Largest residuals of a solution, meters and rad.
    pub tolerance: (f64, f64),
    /// Starts at most, the seed included.
    pub attempts: usize,
    /// Solutions at most.
    pub solutions: usize,
    /// Seed of the random starts.
    pub random_seed: u64,
}

/// A pose of the motors that reaches the goal.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Solution {
    /// All motors, rad of encoder.
    pub pose: Vec<f64>,
    /// Residuals, meters and rad.
    pub off: (f64, f64),
}

/// Poses that reach the goal and are accepted, those nearest to the seed first; motors that do not move the frame stay at the seed.
///
/// # Arguments
/// * `seed`: a pose of all motors within their limits, rad of encoder.
/// * `accept`: whether a pose that reaches the goal counts.
/// * `stop`: whether to end now, with what was found so far.
pub(crate) fn solve(
    robot: &Robot,
    chain: &Chain,
    seed: &[f64],
    goal: &FrameGoal,
    mut accept: impl FnMut(&[f64]) -> bool,
    stop: impl Fn() -> bool,
) -> Vec<Solution> {
    let motors = chain.motors();
    let limits = motors.iter().filter_map(|m| robot.motors.get(*m)).map(|m| (m.min, m.max)).collect();
    let group = MotorGroup { motors, limits };
    let starts = std::iter::once(seed.to_vec()).chain(random_poses(robot, goal.random_seed)).take(goal.attempts);
    let mut found: Vec<Solution> = Vec::new();
    for start in starts {
        if found.len() >= goal.solutions || stop() {
            break;
        }
        // only the group is drawn
        let start = group.whole(seed, &group.share(&start));
        let pose = group.whole(seed, &group.solve(&start, |pose| residual(chain, goal, pose)));
        let off = off(chain, goal, &pose);
        let is_new = || found.iter().all(|f| f.pose.iter().zip(&pose).any(|(a, b)| (a - b).abs() > SAME));
        if off.0 <= goal.tolerance.0 && off.1 <= goal.tolerance.1 && is_new() && accept(&pose) {
            found.push(Solution { pose, off });
        }
    }
    let far = |s: &Solution| s.pose.iter().zip(seed).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
    found.sort_by(|a, b| far(a).total_cmp(&far(b)));
    found
}

/// The vector that is minimized: a meter counts [`PER_METER`] radians.
fn residual(chain: &Chain, goal: &FrameGoal, pose: &[f64]) -> Vec<f64> {
    let frame = chain.forward(pose);
    let place = (frame.translation.vector - goal.at) * PER_METER;
    let turn = goal.turn.map(|wanted| (frame.rotation * wanted.inverse()).scaled_axis());
    place.iter().chain(turn.iter().flat_map(|turn| turn.iter())).copied().collect()
}

/// Residuals of a pose, meters and rad.
fn off(chain: &Chain, goal: &FrameGoal, pose: &[f64]) -> (f64, f64) {
    let frame = chain.forward(pose);
    let turn = goal.turn.map_or(0.0, |wanted| frame.rotation.angle_to(&wanted));
    ((frame.translation.vector - goal.at).norm(), turn)
}
