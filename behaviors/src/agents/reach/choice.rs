//! Where the hand goes: the vertex of the map that is nearest to the pre-grasp posture, and the two last lines from there.
//!
//! ```text
//! object's middle ──> places of the hand before the grasp, and at it
//!    nearest vertices ──damped least squares──> pre-grasp posture ──> grasp posture ──> lines certified ──> the nearest one
//! ```

use super::aim::Hand;
use crate::planners::JointSpace;
use crate::roadmap::Roadmap;
use mobee_contract::View;
use mobee_fast::EdgeVerdict;
use nalgebra::Vector3;
use std::collections::BTreeSet;

/// So many vertices near the place are begun from; if none of them leads there freely, so many more, and so on. There is an end to it:
/// some seconds is what an agent may think.
pub(super) const VERTICES: [usize; 4] = [24, 120, 600, 6000];
/// For what must be decided while the hand moves.
pub(super) const FEW: [usize; 1] = [24];
/// A posture is one if the hand is so near, meters, and its palm points so near to where it should, rad.
const PLACE: f64 = 0.002;
const ANGLE: f64 = std::f64::consts::PI / 12.0;

/// Two postures of a hand, and the vertex that they are reached from.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Choice {
    /// An index into the agent's hands.
    pub hand: usize,
    /// The vertex that the first posture was begun from, and whether the line from there is free; if not, the way is to be planned.
    pub vertex: u32,
    pub is_joined: bool,
    /// Positions of the map's motors, rad.
    pub pre: Vec<f64>,
    pub grasp: Vec<f64>,
}

/// Why there is none.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum NoChoice {
    /// The hand can't be brought there.
    OutOfReach,
    /// It can, but not freely; what is in the way, in words.
    NotFree(String),
}

/// Where the hand is to be, in the world, meters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Places {
    pub pre: Vector3<f64>,
    pub grasp: Vector3<f64>,
}

/// Chooses postures for a hand at these places, from where the robot is; of those that are free, the one that is nearest, and one that a
/// free line leads to before all others. The vertices near the place are begun from, but for those that were tried in vain, so many of each
/// hand at once until there is one.
pub(super) fn choose(
    map: &Roadmap,
    hands: &[Hand],
    space: &mut JointSpace,
    view: &View,
    (places, vertices, tried): (&Places, &[usize], &BTreeSet<u32>),
) -> Result<Choice, NoChoice> {
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

/// Which hand a pose is one of: the first whose others rest.
pub(super) fn side(hands: &[Hand], pose: &[f64]) -> Option<usize> {
    hands.iter().position(|hand| hand.is_alone(pose))
}

/// The best choice of those that these vertices begin.
fn best_of(
    map: &Roadmap,
    hands: &[Hand],
    space: &mut JointSpace,
    view: &View,
    (places, near): (&Places, &[(f64, u32)]),
) -> Result<Choice, NoChoice> {
    let posture = |hand: &Hand, from: &[f64], to: Vector3<f64>| {
        let pose = hand.group.whole(from, &hand.bring(from, to));
        let (off, angle) = hand.off(&pose, to);
        (off <= PLACE && angle <= ANGLE).then_some(pose)
    };
    let choice = |(_, vertex): &(f64, u32)| {
        let from = map.whole(view.pose(), &map.group(&map.vertex(*vertex)?.q));
        let index = side(hands, &from)?;
        let hand = hands.get(index)?;
        let pre = posture(hand, &from, places.pre)?;
        let grasp = posture(hand, &pre, places.grasp)?;
        let [from, pre, grasp] = [from, pre, grasp].map(|pose| map.group(&pose));
        Some((from, Choice { hand: index, vertex: *vertex, is_joined: false, pre, grasp }))
    };
    let choices: Vec<(Vec<f64>, Choice)> = near.iter().filter_map(choice).collect();
    if choices.is_empty() {
        return Err(NoChoice::OutOfReach);
    }
    let lines = choices.iter().flat_map(|(from, c)| [(from, &c.pre), (&c.pre, &c.grasp)]);
    let lines: Vec<(Vec<f64>, Vec<f64>)> = lines.map(|(a, b)| (space.within(a), b.clone())).collect();
    let verdicts = space.certify(lines.iter().map(|(a, b)| (a.as_slice(), b.as_slice()))).to_vec();
    let here = map.group(view.pose());
    let judged = choices.into_iter().zip(verdicts.chunks(2)).filter_map(|((_, choice), verdicts)| {
        let [first, last] = verdicts else { return None };
        // the last line begins at the first posture, which is therefore free as well
        let is_joined = *first == EdgeVerdict::Free;
        (*last == EdgeVerdict::Free).then_some(Choice { is_joined, ..choice })
    });
    let nearest = judged.min_by(|a, b| {
        let way = |c: &Choice| space.metric().distance(&here, &c.pre);
        b.is_joined.cmp(&a.is_joined).then(way(a).total_cmp(&way(b))).then(a.vertex.cmp(&b.vertex))
    });
    nearest.ok_or_else(|| NoChoice::NotFree(obstruction(&verdicts, view)))
}

/// The first thing that is in the way of a line, in words.
fn obstruction(verdicts: &[EdgeVerdict], view: &View) -> String {
    let pair = verdicts.iter().find_map(|v| if let EdgeVerdict::Blocked(found) = v { found.pair } else { None });
    pair.map_or_else(
        || "a limit or constraint".to_owned(),
        |(a, b)| format!("{} and {}", view.scene.shape_name(a), view.scene.shape_name(b)),
    )
}
