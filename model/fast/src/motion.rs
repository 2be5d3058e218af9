//! How far two things move against each other on an interval, at most: the way from its middle to either end.
//!
//! Two bounds, of which the smaller counts; `h` are the motors' steps from the middle to an end:
//!
//! ```text
//! coarse   sum over the joints between the two of  reach · |h|                      at every pose (`levers.rs`)
//! fine     | velocity of one against the other, at the middle |  +  sum of  reach_k |h_k| (|h_k| / 2 + sum of |h_j|)
//! ```
//! with j over the joints that carry joint k. The second term bounds what Taylor's first leaves out: a point that is
//! carried by joints of constant speed `w` is accelerated by no more than the sum of `w_k² r_k + 2 w_j w_k r_k`. In the
//! first term opposite motions cancel, as where an arm moves about its elbow and the hand stays in place.

use crate::kernel::{Block, moved};
use crate::lanes::{Lanes, Row};
use crate::program::{Motion, Program, Relative};
use crate::vector::{Rows3, V3};

/// What the steps of motors come to.
#[derive(Clone, Debug, Default)]
pub(crate) struct Motions {
    /// Per motor: its step from the middle to the end, rad of encoder.
    pub steps: Vec<Row>,
    /// Per frame: how far it turns and how far its origin goes by that, to first order, world frame.
    twists: Vec<[Rows3; 2]>,
    /// Per sum of levers: coarse bound, and what the fine one adds to the velocity.
    sums: Vec<[Row; 2]>,
    /// Whether it was summed up for these steps.
    summed: Vec<bool>,
    /// What rounding can add to a fine bound.
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

    /// Frames that do not move in what follows have no twist.
    pub fn forget(&mut self) {
        self.twists.fill(Default::default());
    }
}

/// For new steps.
#[inline(always)]
pub(crate) fn start<L: Lanes>(program: &Program, motions: &mut Motions) {
    motions.summed.fill(false);
    let mut slip = L::splat(0.0);
    for (step, slips) in motions.steps.iter().zip(&program.slips) {
        slip = L::load(step).abs().mul_add(L::splat(*slips), slip);
    }
    slip.store(&mut motions.slip);
}

/// Follows the joints of a region whose frames are placed.
#[inline(always)]
pub(crate) fn place_twists<L: Lanes>(program: &Program, block: &Block, motions: &mut Motions, region: usize) {
    for joint in &program.joints[program.regions[region].clone()] {
        if block.kept[joint.frame] {
            continue;
        }
        let [turn, way] = &motions.twists[joint.parent];
        let (mut turn, mut way) = (V3::<L>::load(turn), V3::<L>::load(way));
        let [parent, frame] = [&block.frames[joint.parent], &block.frames[joint.frame]];
        way = way.plus(turn.cross(V3::load(&frame[3]).minus(V3::load(&parent[3]))));
        let step = L::load(&motions.steps[joint.motor]) * L::splat(joint.gain as f32);
        match joint.motion {
            Motion::Turn { .. } => turn = turn.along(V3::load(&frame[2]), step),
            Motion::Slide { along } => {
                let zero = V3 { x: L::splat(0.0), y: L::splat(0.0), z: L::splat(0.0) };
                let axes = [V3::load(&parent[0]), V3::load(&parent[1]), V3::load(&parent[2])];
                way = way.along(moved(zero, axes, along), step);
            }
        }
        let twist = &mut motions.twists[joint.frame];
        turn.store(&mut twist[0]);
        way.store(&mut twist[1]);
    }
}

/// Sums up the levers of two things, unless that is done.
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

/// The smaller of both bounds, of two balls or solids, as steps number them.
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
    let common = V3::<L>::load(&motions.twists[between.common as usize][0]);
    let (one, other) = (V3::load(&block.centers[a]), V3::load(&block.centers[b]));
    let (turn_a, way_a) = at::<L>(program, block, motions, a, one);
    let (turn_b, way_b) = at::<L>(program, block, motions, b, other);
    let way = way_a.minus(way_b).minus(common.cross(one.minus(other)));
    let mut bound = way.squared().sqrt();
    // The farthest point of each core moves about its center.
    if program.extents[a] > 0.0 {
        bound = turn_a.minus(common).squared().sqrt().mul_add(L::splat(program.extents[a]), bound);
    }
    if program.extents[b] > 0.0 {
        bound = turn_b.minus(common).squared().sqrt().mul_add(L::splat(program.extents[b]), bound);
    }
    let [a, b] = between.sums.map(|sum| sum as usize);
    let second = L::load(&motions.sums[a][1]) + L::load(&motions.sums[b][1]);
    // A share of the coarse bound is more than the sums' own rounding.
    let slip = coarse.mul_add(L::splat(1.0 / 8192.0), L::load(&motions.slip));
    coarse.min(bound + second + slip)
}

/// How far a thing turns, and how far its center goes.
#[inline(always)]
fn at<L: Lanes>(program: &Program, block: &Block, motions: &Motions, index: usize, center: V3<L>) -> (V3<L>, V3<L>) {
    let frame = match index.checked_sub(program.balls.len()) {
        Some(solid) => program.solids[solid].frame,
        None => program.balls[index].frame,
    };
    let [turn, way] = &motions.twists[frame];
    let (turn, way) = (V3::<L>::load(turn), V3::<L>::load(way));
    (turn, way.plus(turn.cross(center.minus(V3::load(&block.frames[frame][3])))))
}
