//! Hands and fingers: subtrees that are small at every pose, and so are asked as a whole.

use crate::chain::LaneFrame;
use crate::compile::Sized;
use crate::sweep::Sphere;
use std::ops::Range;

/// A subtree is a region of its own, placed only when something comes near, if the ball that holds it at every pose is
/// smaller than this share of the robot's: a hand is, an arm is not. A matter of speed alone. Of 0, 0.08, 0.12, 0.16
/// and 0.2 this one was the best along lines, at twice the speed of none, and 0.08 a little better at random poses.
const REGION: f64 = 0.12;
/// A region has at least so many frames with solids.
const REGION_FRAMES: usize = 3;

/// A subtree that is small at every pose: a hand, or a finger of it, which is placed on demand.
#[derive(Clone, Debug)]
pub(crate) struct Region {
    /// A hand's uppermost frame, which is always placed.
    pub root: usize,
    /// Per frame of the scene: whether it is in the region; in the hand the root included, in none of its fingers.
    pub has: Vec<bool>,
    /// Holds it at every pose; in the root's frame.
    pub ball: Sphere,
}

/// Subtrees that are small at every pose and have no pairs of their own.
pub(crate) fn regions(
    frames: &[LaneFrame],
    groups: &[Range<usize>],
    order: &[usize],
    sized: &[Sized],
    pairs: &[(usize, usize)],
) -> Vec<Region> {
    let mut regions: Vec<Region> = Vec::new();
    let mut taken = vec![false; frames.len()];
    let mut whole = 0.0;
    for (root, frame) in frames.iter().enumerate() {
        if frame.carried.is_none() {
            whole = Sphere::around(&balls_of(frames, root, &below(frames, root), order, sized)).radius;
            continue;
        }
        let has = below(frames, root);
        let solid_frames = groups.iter().filter(|g| has[sized[order[g.start]].frame]).count();
        if solid_frames < REGION_FRAMES || taken[root] {
            continue;
        }
        let own_pairs = pairs.iter().any(|(a, b)| has[sized[*a].frame] && has[sized[*b].frame]);
        let inside = balls_of(frames, root, &has, order, sized);
        // Most are far larger, which two of the balls show.
        let wide = |ball: &Sphere| (ball.center - inside[0].center).norm() + ball.radius + inside[0].radius;
        if inside.iter().any(|ball| wide(ball) > 2.0 * REGION * whole) {
            continue;
        }
        if own_pairs || Sphere::around(&inside).radius > REGION * whole {
            continue;
        }
        taken.iter_mut().zip(&has).for_each(|(taken, has)| *taken |= has);
        let Some(root) = where_it_branches(frames, root, order, sized) else { continue };
        let has = below(frames, root);
        let ball = Sphere::around(&balls_of(frames, root, &has, order, sized));
        regions.push(Region { root, has, ball });
    }
    regions
}

/// From a root down to the frame that carries several fingers, if any does: what all of them hang on is always placed.
fn where_it_branches(frames: &[LaneFrame], mut root: usize, order: &[usize], sized: &[Sized]) -> Option<usize> {
    let carries = |f: usize| {
        let has = below(frames, f);
        order.iter().any(|s| has[sized[*s].frame])
    };
    loop {
        let hangs = |f: &usize| frames[*f].carried.as_ref().is_some_and(|c| c.parent == root) && carries(*f);
        let mut children = (0..frames.len()).filter(hangs);
        let only = children.next()?;
        if children.next().is_some() {
            return Some(root);
        }
        root = only;
    }
}

/// What hangs on a region's root by one joint: the fingers of a hand, each in a ball of the root's frame, so that nothing
/// of it is placed until something is near.
pub(crate) fn branches(frames: &[LaneFrame], regions: &[Region], order: &[usize], sized: &[Sized]) -> Vec<Region> {
    let of = |region: &Region, root: usize| {
        frames[root].carried.as_ref().filter(|c| c.parent == region.root)?;
        let has = below(frames, root);
        let inside = balls_of(frames, region.root, &has, order, sized);
        (!inside.is_empty()).then(|| Region { root: region.root, has, ball: Sphere::around(&inside) })
    };
    regions.iter().flat_map(|region| (0..frames.len()).filter_map(move |root| of(region, root))).collect()
}

/// Per frame: whether it is in the subtree of this one, itself included.
fn below(frames: &[LaneFrame], root: usize) -> Vec<bool> {
    let mut has = vec![false; frames.len()];
    has[root] = true;
    for f in root + 1..frames.len() {
        has[f] = frames[f].carried.as_ref().is_some_and(|c| has[c.parent]);
    }
    has
}

/// What holds each solid of a subtree at every pose; in its root's frame.
fn balls_of(frames: &[LaneFrame], root: usize, has: &[bool], order: &[usize], sized: &[Sized]) -> Vec<Sphere> {
    let inside = order.iter().map(|s| &sized[*s]).filter(|s| has[s.frame]);
    inside.map(|s| s.ball().swept(frames, s.frame, root)).collect()
}
