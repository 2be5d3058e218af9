//! Hands and fingers: subtrees that are small at every pose, so that each is tested as a whole.

use crate::chain::LaneFrame;
use crate::solids::Sized;
use crate::sweep::Sphere;
use std::ops::Range;

/// A subtree becomes a region, placed only if something is near, if the ball that contains it at every pose is smaller
/// than this fraction of the robot's: true for a hand, false for an arm. It affects only speed. Of 0, 0.08, 0.12, 0.16
/// and 0.2 this one was the best along lines, at twice the speed of 0; 0.08 was slightly better at random poses.
const MAX_REGION_SHARE: f64 = 0.12;
/// Minimum number of frames with solids in a region.
const MIN_REGION_FRAMES: usize = 3;

/// A subtree that is small at every pose: a hand, or one of its fingers, which is placed on demand.
#[derive(Clone, Debug)]
pub(crate) struct SubtreeRegion {
    /// The frame nearest to the base in a hand, which is always placed.
    pub root: usize,
    /// Per frame of the scene: true if it is in the region. A hand includes the root, a finger does not.
    pub has: Vec<bool>,
    /// Ball that contains it at every pose; in the root's frame.
    pub ball: Sphere,
}

/// Finds subtrees that are small at every pose and have no pairs within themselves.
pub(crate) fn regions(
    frames: &[LaneFrame],
    groups: &[Range<usize>],
    order: &[usize],
    sized: &[Sized],
    pairs: &[(usize, usize)],
) -> Vec<SubtreeRegion> {
    let mut regions: Vec<SubtreeRegion> = Vec::new();
    let mut taken = vec![false; frames.len()];
    let mut whole = 0.0;
    for (root, frame) in frames.iter().enumerate() {
        if frame.carried.is_none() {
            whole = Sphere::around(&balls_of(frames, root, &below(frames, root), order, sized)).radius;
            continue;
        }
        let has = below(frames, root);
        let solid_frames = groups.iter().filter(|g| has[sized[order[g.start]].frame]).count();
        if solid_frames < MIN_REGION_FRAMES || taken[root] {
            continue;
        }
        let own_pairs = pairs.iter().any(|(a, b)| has[sized[*a].frame] && has[sized[*b].frame]);
        let inside = balls_of(frames, root, &has, order, sized);
        // Most subtrees are far larger, which two of the balls show.
        let wide = |ball: &Sphere| (ball.center - inside[0].center).norm() + ball.radius + inside[0].radius;
        if inside.iter().any(|ball| wide(ball) > 2.0 * MAX_REGION_SHARE * whole) {
            continue;
        }
        if own_pairs || Sphere::around(&inside).radius > MAX_REGION_SHARE * whole {
            continue;
        }
        taken.iter_mut().zip(&has).for_each(|(taken, has)| *taken |= has);
        let Some(root) = branching_frame(frames, root, order, sized) else { continue };
        let has = below(frames, root);
        let ball = Sphere::around(&balls_of(frames, root, &has, order, sized));
        regions.push(SubtreeRegion { root, has, ball });
    }
    regions
}

/// The frame at or below a root that carries several fingers, if any does: this common part is always placed.
fn branching_frame(frames: &[LaneFrame], mut root: usize, order: &[usize], sized: &[Sized]) -> Option<usize> {
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

/// The subtrees that are attached to a region's root by one joint: the fingers of a hand, each with a ball in the
/// root's frame, so that it is placed only if something is near.
pub(crate) fn branches(
    frames: &[LaneFrame],
    regions: &[SubtreeRegion],
    order: &[usize],
    sized: &[Sized],
) -> Vec<SubtreeRegion> {
    let branch = |region: &SubtreeRegion, root: usize| {
        frames[root].carried.as_ref().filter(|c| c.parent == region.root)?;
        let has = below(frames, root);
        let inside = balls_of(frames, region.root, &has, order, sized);
        (!inside.is_empty()).then(|| SubtreeRegion { root: region.root, has, ball: Sphere::around(&inside) })
    };
    regions.iter().flat_map(|region| (0..frames.len()).filter_map(move |root| branch(region, root))).collect()
}

/// Per frame: true if it is in the subtree of `root`, `root` included.
fn below(frames: &[LaneFrame], root: usize) -> Vec<bool> {
    let mut has = vec![false; frames.len()];
    has[root] = true;
    for f in root + 1..frames.len() {
        has[f] = frames[f].carried.as_ref().is_some_and(|c| has[c.parent]);
    }
    has
}

/// Balls that contain each solid of a subtree at every pose; in its root's frame.
fn balls_of(frames: &[LaneFrame], root: usize, has: &[bool], order: &[usize], sized: &[Sized]) -> Vec<Sphere> {
    let inside = order.iter().map(|s| &sized[*s]).filter(|s| has[s.frame]);
    inside.map(|s| s.ball().swept(frames, s.frame, root)).collect()
}
