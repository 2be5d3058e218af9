//! Pairs of links that need no test.

use super::Subject;
use super::falsely::{COVERED, NEAR};
use crate::{LeftOut, Robot, SceneError, Surfaces, random_poses};
use std::collections::BTreeMap;

/// What is known of a pair that was tried.
#[derive(Clone, Copy, Default)]
struct Tried {
    /// At how many poses its shapes were near.
    near: usize,
    /// Whether the meshes ever met.
    met: bool,
    /// Whether the meshes were ever apart.
    apart: bool,
}

/// The pairs of links that random poses show to need no test, each with its reason. Add them with [`Robot::leave_out`].
///
/// * Pairs that are never farther apart than 12 mm: joined more closely than the reflex can tell. Where their meshes meet at some
///   poses and not at others, nothing watches over these contacts any more, and the reason says so.
/// * Pairs whose shapes come near, though their meshes never meet, and which at most three motors move against each other, so that
///   the poses cover what there is.
///
/// A pair that touches often is never left out for that. Nor is one that was never seen near and that many motors move: ten thousand
/// poses of thirty motors are few, and a test that costs a little is cheaper than a contact that nobody looks for.
///
/// # Arguments
/// * `poses`: how many are tried; 10,000 or more.
/// * `progress`: is told the share that is done, 0 to 1.
///
/// # Errors
/// If the robot can't stand in a scene.
pub fn spared_pairs(
    robot: &Robot,
    surfaces: &Surfaces,
    (poses, seed): (usize, u64),
    progress: &mut dyn FnMut(f64),
) -> Result<Vec<LeftOut>, SceneError> {
    let subject = Subject::new(robot, surfaces)?;
    let mut tried: BTreeMap<(usize, usize), Tried> = BTreeMap::new();
    for (done, q) in random_poses(robot, seed).take(poses).enumerate() {
        let near = subject.near(&q, NEAR);
        let frames = surfaces.frames(robot, &q);
        for (pair, distance) in near {
            let known = tried.entry(pair).or_default();
            known.near += 1;
            // The shapes hold the meshes: where they are apart, so are these. Without meshes the shapes are all there is.
            let meet = |(a, b)| surfaces.meet(&frames, a, b);
            if !(known.met && known.apart) {
                let met = distance <= 0.0 && subject.surfaces(pair).is_none_or(meet);
                *(if met { &mut known.met } else { &mut known.apart }) = true;
            }
        }
        if done % 64 == 0 {
            progress(done as f64 / poses.max(1) as f64);
        }
    }
    let reason = |pair: (usize, usize), t: &Tried| {
        if t.near == poses {
            let unwatched =
                if t.met && t.apart { "; contacts that their meshes make at times are not seen" } else { "" };
            return Some(format!("never farther apart than {:.0} mm at {poses} poses{unwatched}", NEAR * 1e3));
        }
        let few = || robot.movers(Some(pair.0), Some(pair.1)).len() <= COVERED;
        (!t.met && few()).then(|| format!("near, but never in contact at {poses} poses"))
    };
    Ok(tried.iter().filter_map(|(pair, t)| Some(LeftOut { nodes: *pair, reason: reason(*pair, t)? })).collect())
}
