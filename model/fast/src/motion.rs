//! Bound of the relative motion of two things on an interval, from its midpoint to either end.
//!
//! The smaller of two bounds is used; `h` are the motors' steps from the midpoint to an end:
//!
//! ```text
//! coarse   sum over the joints between the two of  reach · |h|                      at every pose (`levers.rs`)
//! fine     | relative velocity at the midpoint |  +  sum of  reach_k |h_k| (|h_k| / 2 + sum of |h_j|)
//! ```
//! with j over the joints that carry joint k. The second term bounds the remainder of the first-order Taylor expansion:
//! a point that is carried by joints of constant speed `w` has an acceleration of at most the sum of `w_k² r_k + 2 w_j
//! w_k r_k`. In the first term opposite motions cancel, for example if an arm moves about its elbow while the hand
//! stays in place.

use crate::kernel::{Block, moved};
use crate::lanes::{Lanes, Row};
use crate::program::{Motion, Program, Relative};
use crate::vector::{LaneVector, Rows3};

/// Motions that result from the motors' steps.
#[derive(Clone, Debug, Default)]
pub(crate) struct Motions {
    /// Per motor: its step from the midpoint to the end, rad of encoder.
    pub steps: Vec<Row>,
    /// Per frame: rotation and translation of its origin due to the steps, to first order, world frame.
    twists: Vec<[Rows3; 2]>,
    /// Per sum of levers: the coarse bound, and the second-order term of the fine one.
    sums: Vec<[Row; 2]>,
    /// True if the sum has been computed for these steps.
    summed: Vec<bool>,
    /// Bound of rounding in a fine bound.
    slip: Row,
}

impl Motions {
    pub fn new(program: &Program) -> Self {
        Motions {
            steps: vec![Row::default(); program.limits.len()],
            twists: vec![Default::default(); program.frames],
            sums: vec![Default::default(); program.sums.len()],
            summed: vec![false; program.sums.len()],
            slip: Row::default(),
        }
    }

    /// Resets the twists: frames that do not move from now on have none.
    pub fn forget(&mut self) {
        self.twists.fill(Default::default());
    }
}

/// Starts with new steps.
#[inline(always)]
pub(crate) fn start<L: Lanes>(program: &Program, motions: &mut Motions) {
    motions.summed.fill(false);
    let mut slip = L::splat(0.0);
    for (step, slips) in motions.steps.iter().zip(&program.slips) {
        slip = L::load(step).abs().mul_add(L::splat(*slips), slip);
    }
    slip.store(&mut motions.slip);
}

/// Computes the twists of a region after its frames are placed.
#[inline(always)]
pub(crate) fn place_twists<L: Lanes>(program: &Program, block: &Block, motions: &mut Motions, region: usize) {
    for joint in &program.joints[program.regions[region].clone()] {
        if block.unchanged[joint.frame] {
            continue;
        }
        let [turn, way] = &motions.twists[joint.parent];
        let (mut turn, mut way) = (LaneVector::<L>::load(turn), LaneVector::<L>::load(way));
        let [parent, frame] = [&block.frames[joint.parent], &block.frames[joint.frame]];
        way = way.plus(turn.cross(LaneVector::load(&frame[3]).minus(LaneVector::load(&parent[3]))));
        let step = L::load(&motions.steps[joint.motor]) * L::splat(joint.gain as f32);
        match joint.motion {
            Motion::Turn { .. } => turn = turn.along(LaneVector::load(&frame[2]), step),
            Motion::Slide { along } => {
                let zero = LaneVector { x: L::splat(0.0), y: L::splat(0.0), z: L::splat(0.0) };
                let axes = [LaneVector::load(&parent[0]), LaneVector::load(&parent[1]), LaneVector::load(&parent[2])];
                way = way.along(moved(zero, axes, along), step);
            }
        }
        let twist = &mut motions.twists[joint.frame];
        turn.store(&mut twist[0]);
        way.store(&mut twist[1]);
    }
}

/// Computes the sums of levers of two things, unless they are up to date.
#[inline(always)]
pub(crate) fn sum_up<L: Lanes>(program: &Program, motions: &mut Motions, between: &Relative) {
    for sum in between.sums {
        if std::mem::replace(&mut motions.summed[sum as usize], true) {
            continue;
        }
        let (mut all, mut second, mut turned) = (L::splat(0.0), L::splat(0.0), L::splat(0.0));
        for lever in &program.levers[program.sums[sum as usize].clone()] {
            let step = L::load(&motions.steps[lever.motor]).abs();
            let (way, turn) = (step * L::splat(lever.reach), step * L::splat(lever.turn));
            all = all + way;
            second = way.mul_add(turn.mul_add(L::splat(0.5), turned), second);
            turned = turned + turn;
        }
        let rows = &mut motions.sums[sum as usize];
        all.store(&mut rows[0]);
        second.store(&mut rows[1]);
    }
}

/// The coarse bound.
#[inline(always)]
pub(crate) fn coarse<L: Lanes>(motions: &Motions, between: &Relative) -> L {
    let [a, b] = between.sums.map(|sum| sum as usize);
    L::load(&motions.sums[a][0]) + L::load(&motions.sums[b][0])
}

/// The smaller of both bounds, for two balls or solids numbered as in the steps.
#[inline(always)]
pub(crate) fn fine<L: Lanes>(
    program: &Program,
    block: &Block,
    motions: &Motions,
    between: &Relative,
    a: usize,
    b: usize,
) -> L {
    let coarse = coarse::<L>(motions, between);
    let common = LaneVector::<L>::load(&motions.twists[between.common as usize][0]);
    let (one, other) = (LaneVector::load(&block.centers[a]), LaneVector::load(&block.centers[b]));
    let (turn_a, way_a) = at::<L>(program, block, motions, a, one);
    let (turn_b, way_b) = at::<L>(program, block, motions, b, other);
    let way = way_a.minus(way_b).minus(common.cross(one.minus(other)));
    let mut bound = way.squared().sqrt();
    // Motion of the farthest point of each core about its center.
    if program.extents[a] > 0.0 {
        bound = turn_a.minus(common).squared().sqrt().mul_add(L::splat(program.extents[a]), bound);
    }
    if program.extents[b] > 0.0 {
        bound = turn_b.minus(common).squared().sqrt().mul_add(L::splat(program.extents[b]), bound);
    }
    let [a, b] = between.sums.map(|sum| sum as usize);
    let second = L::load(&motions.sums[a][1]) + L::load(&motions.sums[b][1]);
    // A fraction of the coarse bound covers the sums' own rounding.
    let slip = coarse.mul_add(L::splat(1.0 / 8192.0), L::load(&motions.slip));
    coarse.min(bound + second + slip)
}

/// Rotation of a thing, and translation of its center.
#[inline(always)]
fn at<L: Lanes>(
    program: &Program,
    block: &Block,
    motions: &Motions,
    index: usize,
    center: LaneVector<L>,
) -> (LaneVector<L>, LaneVector<L>) {
    let frame = match index.checked_sub(program.balls.len()) {
        Some(solid) => program.solids[solid].frame,
        None => program.balls[index].frame,
    };
    let [turn, way] = &motions.twists[frame];
    let (turn, way) = (LaneVector::<L>::load(turn), LaneVector::<L>::load(way));
    (turn, way.plus(turn.cross(center.minus(LaneVector::load(&block.frames[frame][3])))))
}
