//! The random poses at which shapes touch falsely.

use super::Subject;
use crate::{Surfaces, random_poses};
use std::collections::BTreeMap;

/// What stays nearer than this at every pose can't be told from a contact, meters: the reflex acts at a centimeter, and lets go of a
/// contact 2 mm farther out.
pub(super) const NEAR: f64 = 0.012;
/// At so many poses it is looked whether the meshes of two links are near each other: at those at which the shapes are farthest apart,
/// and at others.
const LOOKS: (usize, usize) = (32, 64);
/// So many motors between two links at the most, and thousands of poses cover all that these two can do against each other.
pub(super) const COVERED: usize = 3;

/// Two nodes.
pub(super) type NodePair = (usize, usize);

/// A pose at which no meshes meet.
#[derive(Clone)]
pub(super) struct Falsely {
    /// The motors' positions, rad or meters.
    pub(super) q: Vec<f64>,
    /// The pairs of nodes whose shapes touch.
    pub(super) pairs: Vec<NodePair>,
}

/// The random poses that are free by the meshes, with the pairs whose shapes touch falsely, as far as they need a test; and the pairs
/// whose shapes are near each other at all poses, by no fault of their meshes.
pub(super) fn falsely_touching(
    subject: &Subject<'_>,
    surfaces: &Surfaces,
    (poses, seed): (usize, u64),
    progress: &mut dyn FnMut(f64),
) -> (Vec<Falsely>, Vec<NodePair>) {
    let (mut all, mut met) = (Vec::new(), BTreeMap::<NodePair, usize>::new());
    let mut near = BTreeMap::<NodePair, Vec<f64>>::new();
    for (done, q) in random_poses(subject.robot, seed).take(poses).enumerate() {
        let (placed, frames) = (subject.place(&q), surfaces.frames(subject.robot, &q));
        let mut touching = Vec::new();
        for pair in &subject.tested {
            if let Some(distance) = subject.distance(&placed, *pair, NEAR) {
                near.entry(*pair).or_default().push(distance);
                touching.extend((distance <= 0.0).then_some(*pair));
            }
        }
        // A pose at which meshes meet is none of those that are looked for: of a pair that is known to meet at times nothing is left to
        // ask there. Who meets most often is asked first.
        touching.sort_by_key(|pair| std::cmp::Reverse(met.get(pair).copied()));
        let (mut meeting, mut falsely, mut blocked) = (Vec::new(), Vec::new(), false);
        for pair in touching {
            let ever_near = near.get(&pair).is_some_and(|distances| distances.len() == done + 1);
            if blocked && !ever_near && met.contains_key(&pair) {
                continue;
            }
            // the shapes hold the meshes: where they are apart, so are these
            if subject.surfaces(pair).is_none_or(|(a, b)| surfaces.meet(&frames, a, b)) {
                *met.entry(pair).or_default() += 1;
                blocked |= !ever_near;
                meeting.push(pair);
            } else {
                falsely.push(pair);
            }
        }
        falsely.sort_unstable();
        all.push((Falsely { q, pairs: falsely }, meeting));
        if done % 64 == 0 {
            progress(done as f64 / poses.max(1) as f64);
        }
    }
    near.retain(|_, distances| distances.len() == poses);
    // what the meshes do now and then, and the shapes always, is the shapes' fault, unless the meshes are always near as well
    let at_times = |pair: &NodePair| met.get(pair).is_some_and(|count| *count < poses);
    let (joined, at_fault): (Vec<NodePair>, Vec<NodePair>) = near.keys().copied().filter(at_times).partition(|pair| {
        let mut looks = looks(&near[pair]).map(|pose| surfaces.frames(subject.robot, &all[pose].0.q));
        subject.surfaces(*pair).is_none_or(|links| looks.all(|frames| surfaces.near(&frames, links, NEAR)))
    });
    // what is always near is left out later, and blocks nothing then
    let free = |meeting: &[NodePair]| meeting.iter().all(|pair| near.contains_key(pair));
    let needs_test = |pair: &NodePair| {
        !joined.contains(pair)
            && (met.contains_key(pair) || subject.robot.movers(Some(pair.0), Some(pair.1)).len() > COVERED)
    };
    let mut falsely: Vec<Falsely> = all.into_iter().filter(|(_, meeting)| free(meeting)).map(|(f, _)| f).collect();
    falsely.iter_mut().for_each(|f| f.pairs.retain(needs_test));
    (falsely, at_fault)
}

/// The poses, by their numbers, at which it is looked whether meshes are near each other, given the distance of their shapes at all.
fn looks(distances: &[f64]) -> impl Iterator<Item = usize> {
    let mut farthest: Vec<usize> = (0..distances.len()).collect();
    farthest.sort_by(|a, b| distances[*b].total_cmp(&distances[*a]));
    let others = (0..distances.len()).step_by(distances.len().div_ceil(LOOKS.1).max(1));
    farthest.into_iter().take(LOOKS.0).chain(others)
}
