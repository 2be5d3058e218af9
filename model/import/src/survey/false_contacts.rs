//! Random poses with false contacts.

use super::Subject;
use crate::Surfaces;
use mobee_model::random_poses;
use std::collections::BTreeMap;

/// Distance, meters, below which a pair that stays near at every pose can't be distinguished from a contact: the reflex
/// triggers at 10 mm, and a contact is released 2 mm farther out.
pub(super) const NEAR_M: f64 = 0.012;
/// Number of poses at which the distance between the meshes of two links is checked: those at which the shapes are
/// farthest apart, and others.
const CHECKED_POSES: (usize, usize) = (32, 64);
/// Maximum number of motors between two links for which thousands of poses cover their relative motion.
pub(super) const MAX_COVERED_MOTORS: usize = 3;

/// Two nodes.
pub(super) type NodePair = (usize, usize);

/// A pose at which no meshes intersect.
#[derive(Clone)]
pub(super) struct FalseContacts {
    /// The motors' positions, rad or meters.
    pub(super) q: Vec<f64>,
    /// The pairs of nodes whose shapes touch.
    pub(super) pairs: Vec<NodePair>,
}

/// Returns the random poses that are free by the meshes, each with the pairs in false contact that need a test, and the
/// pairs whose shapes, but not whose meshes, are near each other at all poses.
pub(super) fn find_false_contacts(
    subject: &Subject<'_>,
    surfaces: &Surfaces,
    (poses, seed): (usize, u64),
    progress: &mut dyn FnMut(f64),
) -> (Vec<FalseContacts>, Vec<NodePair>) {
    let mut all = Vec::new();
    let mut met = BTreeMap::<NodePair, usize>::new();
    let mut near = BTreeMap::<NodePair, Vec<f64>>::new();
    for (done, q) in random_poses(subject.robot, seed).take(poses).enumerate() {
        let placed = subject.place(&q);
        let frames = surfaces.frames(subject.robot, &q);
        let mut touching = Vec::new();
        for pair in &subject.tested {
            if let Some(distance) = subject.distance(&placed, *pair, NEAR_M) {
                near.entry(*pair).or_default().push(distance);
                touching.extend((distance <= 0.0).then_some(*pair));
            }
        }
        // A pose at which meshes intersect is dropped, so pairs that have intersected at other poses need not be tested
        // there. The pairs that intersect most often are tested first.
        touching.sort_by_key(|pair| std::cmp::Reverse(met.get(pair).copied()));
        let mut meeting = Vec::new();
        let mut falsely = Vec::new();
        let mut blocked = false;
        for pair in touching {
            let ever_near = near.get(&pair).is_some_and(|distances| distances.len() == done + 1);
            if blocked && !ever_near && met.contains_key(&pair) {
                continue;
            }
            // The shapes contain the meshes: if the shapes are apart, so are the meshes.
            if subject.surfaces(pair).is_none_or(|(a, b)| surfaces.meet(&frames, a, b)) {
                *met.entry(pair).or_default() += 1;
                blocked |= !ever_near;
                meeting.push(pair);
            } else {
                falsely.push(pair);
            }
        }
        falsely.sort_unstable();
        all.push((FalseContacts { q, pairs: falsely }, meeting));
        if done % 64 == 0 {
            progress(done as f64 / poses.max(1) as f64);
        }
    }
    near.retain(|_, distances| distances.len() == poses);
    // If shapes are always near and their meshes intersect only sometimes, the shapes are at fault, unless the meshes
    // are always near as well.
    let sometimes = |pair: &NodePair| met.get(pair).is_some_and(|count| *count < poses);
    let (joined, at_fault): (Vec<NodePair>, Vec<NodePair>) = near.keys().copied().filter(sometimes).partition(|pair| {
        let mut checked = checked_poses(&near[pair]).map(|pose| surfaces.frames(subject.robot, &all[pose].0.q));
        subject.surfaces(*pair).is_none_or(|links| checked.all(|frames| surfaces.near(&frames, links, NEAR_M)))
    });
    // Pairs that are always near are disabled later, and then block nothing.
    let free = |meeting: &[NodePair]| meeting.iter().all(|pair| near.contains_key(pair));
    let needs_test = |pair: &NodePair| {
        !joined.contains(pair)
            && (met.contains_key(pair) || subject.robot.movers(Some(pair.0), Some(pair.1)).len() > MAX_COVERED_MOTORS)
    };
    let mut falsely: Vec<FalseContacts> =
        all.into_iter().filter(|(_, meeting)| free(meeting)).map(|(f, _)| f).collect();
    falsely.iter_mut().for_each(|f| f.pairs.retain(needs_test));
    (falsely, at_fault)
}

/// The indices of the poses at which the distance of meshes is checked, given the distances of their shapes at all
/// poses.
fn checked_poses(distances: &[f64]) -> impl Iterator<Item = usize> {
    let mut farthest: Vec<usize> = (0..distances.len()).collect();
    farthest.sort_by(|a, b| distances[*b].total_cmp(&distances[*a]));
    let others = (0..distances.len()).step_by(distances.len().div_ceil(CHECKED_POSES.1).max(1));
    farthest.into_iter().take(CHECKED_POSES.0).chain(others)
}
