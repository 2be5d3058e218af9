//! Comparison of configurations, with one meaning for the controller and for the judge of its journal.

use mobee_model::JointMotion;
use std::time::Duration;

/// Displacement of a prismatic joint, a gripper's finger, by the arm's acceleration, m.
const PLAY_M: f64 = 0.002;
/// Longest gap that is bridged: the pauses of a busy laptop take up to 0.3 s. In half a second a motion is still the
/// commanded one; an obstacle that stops or deflects it within that time shows at the next reading.
pub const MAX_BRIDGED_TIME: Duration = Duration::from_millis(500);

/// Play of a joint, rad of encoder: zero for a revolute joint, 2 mm for a prismatic joint.
pub fn play(motion: JointMotion) -> f64 {
    if motion.is_turn() { 0.0 } else { motion.encoder(PLAY_M) }
}

/// Greatest difference of any motor between two configurations, rad. Infinite if their lengths differ, so that
/// neither counts as reached.
pub fn distance(a: &[f64], b: &[f64]) -> f64 {
    if a.len() != b.len() {
        return f64::INFINITY;
    }
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}
