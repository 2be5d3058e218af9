//! Pairs of links that need no test.

use super::Subject;
use super::falsely::{COVERED, NEAR};
use crate::{LeftOut, Robot, SceneError, Surfaces, random_poses};

/// What is known of a pair that is near at all poses so far, or whose meshes have not met.
struct Tried {
    nodes: (usize, usize),
    /// Whether the poses cover what the two can do against each other.
    covered: bool,
    /// At how many poses its shapes were near.
    near: usize,
    /// Whether the meshes ever met.
    met: bool,
    /// Whether the meshes were ever apart.
    apart: bool,
}

impl Tried {
    /// Whether further poses may still show that it needs no test.
    fn is_open(&self, poses: usize) -> bool {
        self.near == poses || (self.covered && !self.met)
    }

    /// Why it needs no test, if so.
    fn reason(&self, poses: usize) -> Option<String> {
        if self.near == 0 {
            return None;
        }
        if self.near == poses {
            let unwatched =
                if self.met && self.apart { "; contacts that their meshes make at times are not seen" } else { "" };
            return Some(format!("never farther apart than {:.0} mm at {poses} poses{unwatched}", NEAR * 1e3));
        }
        Some(format!("near, but never in contact at {poses} poses"))
    }
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
    let covered = |(a, b): (usize, usize)| robot.movers(Some(a), Some(b)).len() <= COVERED;
    let all = subject.tested.iter();
    let mut open: Vec<Tried> =
        all.map(|nodes| Tried { nodes: *nodes, covered: covered(*nodes), near: 0, met: false, apart: false }).collect();
    for (done, q) in random_poses(robot, seed).take(poses).enumerate() {
        let (placed, frames) = (subject.place(&q), surfaces.frames(robot, &q));
        open.retain_mut(|pair| {
            let near = |margin: f64| subject.touching(&placed, pair.nodes, margin).next().is_some();
            if near(NEAR) {
                pair.near += 1;
                // The shapes hold the meshes: where they are apart, so are these. Without meshes the shapes are all there is.
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
