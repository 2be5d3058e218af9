//! Target of the hand: the vertex of the map that is closest to the pre-grasp posture, and the two
//! last lines from there.
//!
//! ```text
//! center of the object ──> positions of the hand before the grasp, and at it
//!    nearest vertices ──damped least squares──> pre-grasp posture ──> grasp posture ──> lines certified ──> the nearest one
//! ```

use super::aim::ReachHand;
use mobee_contract::View;
use mobee_fast::EdgeVerdict;
use mobee_planning::planners::JointSpace;
use mobee_planning::roadmap::Roadmap;
use nalgebra::Vector3;
use std::collections::BTreeSet;

/// Batch sizes of start vertices, nearest first: the next batch is tried if none of the last one
/// leads there freely. Bounded, because an agent has only seconds to decide.
pub(super) const BATCHES_AT_REST: [usize; 4] = [24, 120, 600, 6000];
/// Batch size for a decision while the hand moves.
pub(super) const BATCHES_MOVING: [usize; 1] = [24];
/// Maximum distance of a posture's hand from its goal, meters.
const MAX_HAND_ERROR_M: f64 = 0.002;
/// Maximum angle of a posture's palm from its goal, rad.
const MAX_PALM_ERROR_RAD: f64 = std::f64::consts::PI / 12.0;

/// Two postures of a hand, and the vertex from which they are reached.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct HandChoice {
    /// Index of the hand among the agent's.
    pub hand: usize,
    /// Vertex from which the search for the first posture started.
    pub vertex: u32,
    /// True if the line from there is free; otherwise a path must be planned.
    pub is_joined: bool,
    /// Pre-grasp posture: positions of the map's motors, rad.
    pub pre: Vec<f64>,
    /// Grasp posture: positions of the map's motors, rad.
    pub grasp: Vec<f64>,
}

/// Reason why no postures were found.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum NoChoice {
    /// The hand can't be brought there.
    OutOfReach,
    /// It can, but not without a collision; the text names the obstacle.
    NotFree(String),
}

/// Goal positions of the hand, world frame, meters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct HandPositions {
    pub pre: Vector3<f64>,
    pub grasp: Vector3<f64>,
}

/// Chooses postures for a hand at these positions. Of the free ones it prefers one that a free line
/// leads to, then the nearest to the robot's configuration. The search starts from the vertices
/// near the pre-grasp position, except those already tried; batches are per hand, and the first
/// batch with a result ends it.
pub(super) fn choose(
    map: &Roadmap,
    hands: &[ReachHand],
    space: &mut JointSpace,
    view: &View,
    (places, vertices, tried): (&HandPositions, &[usize], &BTreeSet<u32>),
) -> Result<HandChoice, NoChoice> {
    let far = |at: [f64; 3]| (Vector3::from(at) - places.pre).norm();
    let untried = map.vertices().filter(|(id, _)| !tried.contains(id));
    let mut near: Vec<(f64, u32)> = untried.map(|(id, v)| (far(v.at), id)).collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut rest = near.as_slice();
    let mut found = Err(NoChoice::OutOfReach);
    for count in vertices {
        let (now, later) = rest.split_at((*count * hands.len()).min(rest.len()));
        rest = later;
        match best_of(map, hands, space, view, (places, now)) {
            Ok(choice) => return Ok(choice),
            Err(NoChoice::OutOfReach) => {}
            Err(why) => found = Err(why),
        }
    }
    found
}

/// Returns the index of the hand that a configuration belongs to: the first for which all other
/// hands rest.
pub(super) fn side(hands: &[ReachHand], pose: &[f64]) -> Option<usize> {
    hands.iter().position(|hand| hand.is_alone(pose))
}

/// Returns the best choice that starts from one of these vertices.
fn best_of(
    map: &Roadmap,
    hands: &[ReachHand],
    space: &mut JointSpace,
    view: &View,
    (places, near): (&HandPositions, &[(f64, u32)]),
) -> Result<HandChoice, NoChoice> {
    let posture = |hand: &ReachHand, from: &[f64], to: Vector3<f64>| {
        let pose = hand.group.whole(from, &hand.bring(from, to));
        let (off, angle) = hand.off(&pose, to);
        (off <= MAX_HAND_ERROR_M && angle <= MAX_PALM_ERROR_RAD).then_some(pose)
    };
    let choice = |(_, vertex): &(f64, u32)| {
        let from = map.whole(view.pose(), &map.group(&map.vertex(*vertex)?.q));
        let index = side(hands, &from)?;
        let hand = hands.get(index)?;
        let pre = posture(hand, &from, places.pre)?;
        let grasp = posture(hand, &pre, places.grasp)?;
        let [from, pre, grasp] = [from, pre, grasp].map(|pose| map.group(&pose));
        Some((from, HandChoice { hand: index, vertex: *vertex, is_joined: false, pre, grasp }))
    };
    let choices: Vec<(Vec<f64>, HandChoice)> = near.iter().filter_map(choice).collect();
    if choices.is_empty() {
        return Err(NoChoice::OutOfReach);
    }
    let lines = choices.iter().flat_map(|(from, c)| [(from, &c.pre), (&c.pre, &c.grasp)]);
    let lines: Vec<(Vec<f64>, Vec<f64>)> = lines.map(|(a, b)| (space.within(a), b.clone())).collect();
    let verdicts = space.certify(lines.iter().map(|(a, b)| (a.as_slice(), b.as_slice()))).to_vec();
    let here = map.group(view.pose());
    let judged = choices.into_iter().zip(verdicts.chunks(2)).filter_map(|((_, choice), verdicts)| {
        let [first, last] = verdicts else { return None };
        // The last line begins at the first posture, so that is free as well.
        let is_joined = *first == EdgeVerdict::Free;
        (*last == EdgeVerdict::Free).then_some(HandChoice { is_joined, ..choice })
    });
    let nearest = judged.min_by(|a, b| {
        let way = |c: &HandChoice| space.metric().distance(&here, &c.pre);
        b.is_joined.cmp(&a.is_joined).then(way(a).total_cmp(&way(b))).then(a.vertex.cmp(&b.vertex))
    });
    nearest.ok_or_else(|| NoChoice::NotFree(obstruction(&verdicts, view)))
}

/// Describes the first obstacle on a line.
fn obstruction(verdicts: &[EdgeVerdict], view: &View) -> String {
    let pair = verdicts.iter().find_map(|v| if let EdgeVerdict::Blocked(found) = v { found.pair } else { None });
    pair.map_or_else(
        || "a limit or constraint".to_owned(),
        |(a, b)| format!("{} and {}", view.scene.shape_name(a), view.scene.shape_name(b)),
    )
}
