//! Pairs of links that need no test.

use super::Subject;
use super::false_contacts::{MAX_COVERED_MOTORS, NEAR_M};
use crate::{LeftOut, Robot, SceneError, Surfaces, random_poses};

/// Observations about a pair that has been near at all poses so far, or whose meshes have not intersected.
struct PairObservation {
    nodes: (usize, usize),
    /// True if the poses cover the relative motion of the two.
    covered: bool,
    /// Number of poses at which its shapes were near.
    near: usize,
    /// True if the meshes intersected at any pose.
    met: bool,
    /// True if the meshes were apart at any pose.
    apart: bool,
}

impl PairObservation {
    /// True if further poses may still show that the pair can be disabled.
    fn is_open(&self, poses: usize) -> bool {
        self.near == poses || (self.covered && !self.met)
    }

    /// Reason for disabling the pair, if it can be disabled.
    fn reason(&self, poses: usize) -> Option<String> {
        if self.near == 0 {
            return None;
        }
        if self.near == poses {
            let unwatched =
                if self.met && self.apart { "; contacts that their meshes make at times are not seen" } else { "" };
            return Some(format!("never farther apart than {:.0} mm at {poses} poses{unwatched}", NEAR_M * 1e3));
        }
        Some(format!("near, but never in contact at {poses} poses"))
    }
}

/// The pairs of links that can be disabled according to random poses, each with its reason. Disable them with
/// [`Robot::leave_out`].
///
/// * Pairs that are never farther apart than 12 mm: the reflex can't resolve their distance. If their meshes intersect
///   at some poses and not at others, these contacts are no longer monitored, and the reason mentions this.
/// * Pairs whose shapes come near although their meshes never intersect, and whose relative motion depends on at most
///   three motors, so that the poses cover it.
///
/// A pair is never disabled because it touches often. Nor is a pair that was never near and that depends on many
/// motors: ten thousand poses of thirty motors are few, and a cheap test is better than an undetected contact.
///
/// # Arguments
/// * `poses`: number of poses; 10,000 or more.
/// * `progress`: called with the completed fraction, 0 to 1.
///
/// # Errors
/// If the robot can't be placed in a scene.
pub fn find_disabled_pairs(
    robot: &Robot,
    surfaces: &Surfaces,
    (poses, seed): (usize, u64),
    progress: &mut dyn FnMut(f64),
) -> Result<Vec<LeftOut>, SceneError> {
    let subject = Subject::new(robot, surfaces)?;
    let covered = |(a, b): (usize, usize)| robot.movers(Some(a), Some(b)).len() <= MAX_COVERED_MOTORS;
    let all = subject.tested.iter();
    let mut open: Vec<PairObservation> = all
        .map(|nodes| PairObservation { nodes: *nodes, covered: covered(*nodes), near: 0, met: false, apart: false })
        .collect();
    for (done, q) in random_poses(robot, seed).take(poses).enumerate() {
        let placed = subject.place(&q);
        let frames = surfaces.frames(robot, &q);
        open.retain_mut(|pair| {
            let near = |margin: f64| subject.touching(&placed, pair.nodes, margin).next().is_some();
            if near(NEAR_M) {
                pair.near += 1;
                // The shapes contain the meshes: if the shapes are apart, so are the meshes. Without meshes the shapes
                // alone decide.
                let meet = |(a, b)| surfaces.meet(&frames, a, b);
                if !(pair.met && pair.apart) {
                    let met = near(0.0) && subject.surfaces(pair.nodes).is_none_or(meet);
                    *(if met { &mut pair.met } else { &mut pair.apart }) = true;
                }
            }
            pair.is_open(done + 1)
        });
        if done % 64 == 0 {
            progress(done as f64 / poses.max(1) as f64);
        }
    }
    Ok(open.iter().filter_map(|pair| Some(LeftOut { nodes: pair.nodes, reason: pair.reason(poses)? })).collect())
}
