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
    pub(super) q: Vec<f64>,
    /// The pairs of nodes whose shapes touch.
    pub(super) pairs: Vec<NodePair>,
}

/// The random poses that are free by the meshes, with the pairs whose shapes touch falsely, as far as they need a test.
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
        // the shapes hold the meshes: where they are apart, so are these
        let meet = |pair: &(usize, usize)| subject.surfaces(*pair).is_none_or(|(a, b)| surfaces.meet(&frames, a, b));
        let (meeting, falsely): (Vec<NodePair>, Vec<NodePair>) = touching.into_iter().partition(meet);
        meeting.iter().for_each(|pair| *met.entry(*pair).or_default() += 1);
        all.push((Falsely { q, pairs: falsely }, meeting));
        if done % 64 == 0 {
            progress(done as f64 / poses.max(1) as f64);
        }
    }
    near.retain(|_, distances| distances.len() == poses);
    // what the meshes do now and then, and the shapes always, is the shapes' fault, unless the meshes are always near as well
    let at_times = |pair: &NodePair| met.get(pair).is_some_and(|count| *count < poses);
    let joined = |(pair, distances): &(NodePair, &Vec<f64>)| {
        let mut by_distance: Vec<usize> = (0..poses).collect();
        by_distance.sort_by(|a, b| distances[*b].total_cmp(&distances[*a]));
        let mut looks = by_distance.into_iter().take(LOOKS.0).chain((0..poses).step_by(poses.div_ceil(LOOKS.1).max(1)));
        let near = |(a, b), pose: usize| surfaces.near(&surfaces.frames(subject.robot, &all[pose].0.q), (a, b), NEAR);
        subject.surfaces(*pair).is_none_or(|links| looks.all(|pose| near(links, pose)))
    };
    let always_near = near.iter().map(|(pair, distances)| (*pair, distances)).filter(|(pair, _)| at_times(pair));
    let (joined, at_fault): (Vec<_>, Vec<_>) = always_near.partition(joined);
    let [joined, at_fault] =
        [joined, at_fault].map(|pairs| pairs.into_iter().map(|(pair, _)| pair).collect::<Vec<_>>());
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
