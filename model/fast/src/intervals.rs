//! The kernel for intervals of edges: sixteen of them, each judged at its middle with what moves on it as a margin.
//!
//! A pair that is farther apart at the middle than the clearance and what the two move against each other from there to
//! either end is free on the whole interval. Lanes know nothing of each other: what is said of an interval is the same
//! whichever others it shares a block with.

use crate::distance::{Found, test_pair, within};
use crate::kernel::{Block, place_group, place_region, start_placing};
use crate::lanes::{Lanes, Mask, Row, WIDTH};
use crate::program::{Program, Step, UnitTest};
use crate::vector::V3;

/// Pairs of units whose balls are asked together.
const BATCH: usize = 32;
/// No pair.
pub(crate) const NONE: usize = usize::MAX;

/// What is asked of sixteen intervals, and what came of it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Intervals {
    /// Per motor: how far it goes from the middle to either end, rad of encoder.
    pub half: Vec<Row>,
    /// The units to ask about, in which lanes; in rising order.
    pub asked: Vec<(u32, Mask)>,
    /// Those that may touch, and in which lanes, in the same order.
    pub open: Vec<(u32, Mask)>,
    /// Per lane: the first pair that surely touches at the middle, or [`NONE`].
    pub touching: [usize; WIDTH],
    /// Pairs of which rounding could decide whether they touch at the middle, and in which lanes.
    pub doubts: Vec<(usize, Mask)>,
    /// Per sum of levers: what it comes to.
    sums: Vec<Row>,
    /// Whether it was summed up for these intervals.
    summed: Vec<bool>,
}

impl Intervals {
    pub fn new(program: &Program) -> Self {
        Intervals {
            half: vec![Row::default(); program.limits.len()],
            sums: vec![Row::default(); program.sums.len()],
            summed: vec![false; program.sums.len()],
            ..Intervals::default()
        }
    }
}

/// Judges the intervals that are asked for, the block's motors being at their middles.
#[inline(always)]
pub(crate) fn sweep<L: Lanes>(program: &Program, block: &mut Block, intervals: &mut Intervals) {
    intervals.open.clear();
    intervals.doubts.clear();
    intervals.touching = [NONE; WIDTH];
    intervals.summed.fill(false);
    start_placing::<L>(program, block);
    let mut touching = 0;
    let mut from = 0;
    while from < intervals.asked.len() {
        let to = intervals.asked.len().min(from + BATCH);
        for i in from..to {
            for sum in program.unit_sums[intervals.asked[i].0 as usize] {
                sum_up::<L>(program, intervals, sum as usize);
            }
        }
        // All at once and without a branch, as in `kernel.rs`.
        let (mut near, mut count) = ([(0, 0); BATCH], 0);
        for (unit, asked) in &intervals.asked[from..to] {
            let sums = program.unit_sums[*unit as usize];
            let lanes = nearer::<L>(block, intervals, &program.units[*unit as usize], sums) & asked;
            near[count] = (*unit, lanes);
            count += usize::from(lanes != 0);
        }
        for (unit, lanes) in &near[..count] {
            // Where something touches already it does not matter what else does, only that it may.
            let mut open = lanes & touching;
            if lanes & !touching != 0 {
                let (hit, may) = take_steps::<L>(program, block, intervals, *unit as usize, lanes & !touching);
                touching |= hit;
                open |= may;
            }
            if open != 0 {
                intervals.open.push((*unit, open));
            }
        }
        from = to;
    }
}

/// Sums up levers times steps, unless that is done.
#[inline(always)]
fn sum_up<L: Lanes>(program: &Program, intervals: &mut Intervals, sum: usize) {
    if !std::mem::replace(&mut intervals.summed[sum], true) {
        let mut all = L::splat(0.0);
        for lever in &program.levers[program.sums[sum].clone()] {
            all = L::load(&intervals.half[lever.motor]).mul_add(L::splat(lever.reach), all);
        }
        all.store(&mut intervals.sums[sum]);
    }
}

/// How far two things move against each other.
#[inline(always)]
fn motion<L: Lanes>(intervals: &Intervals, sums: [u32; 2]) -> L {
    L::load(&intervals.sums[sums[0] as usize]) + L::load(&intervals.sums[sums[1] as usize])
}

#[inline(always)]
fn nearer<L: Lanes>(block: &Block, intervals: &Intervals, unit: &UnitTest, sums: [u32; 2]) -> Mask {
    let between = V3::<L>::load(&block.centers[unit.a]).minus(V3::load(&block.centers[unit.b]));
    within::<L, true>(between.squared(), unit.within_squared, motion(intervals, sums))
}

/// Takes the steps of two units that are near in these lanes.
///
/// # Returns
/// The lanes in which a pair surely touches, and all in which one may.
#[inline(always)]
fn take_steps<L: Lanes>(
    program: &Program,
    block: &mut Block,
    intervals: &mut Intervals,
    unit: usize,
    near: Mask,
) -> (Mask, Mask) {
    let (mut hit, mut open) = (0, 0);
    let steps = program.units[unit].steps.clone();
    // What is near in the step that is open, and up to which step; at most two are open at once.
    let (mut scopes, mut depth) = ([(near, steps.end); 4], 0);
    let mut at = steps.start;
    while at < steps.end {
        while at >= scopes[depth].1 && depth > 0 {
            depth -= 1;
        }
        let lanes = scopes[depth].0 & !hit;
        let (step, sums) = (&program.steps[at], program.step_sums[at]);
        at += 1;
        for sum in sums {
            sum_up::<L>(program, intervals, sum as usize);
        }
        match *step {
            Step::Near { a, b, within_squared, skip } => {
                let between = V3::<L>::load(&block.centers[a]).minus(V3::load(&block.centers[b]));
                let near = within::<L, true>(between.squared(), within_squared, motion(intervals, sums)) & lanes;
                if near == 0 {
                    at = skip;
                } else {
                    depth += 1;
                    scopes[depth] = (near, skip);
                }
            }
            Step::Region(region) => place_region::<L>(program, block, region),
            Step::Group(group) => place_group::<L>(program, block, group),
            Step::Pair(index) => {
                if lanes == 0 {
                    continue;
                }
                let pair = &program.pairs[index];
                let found: Found = test_pair::<L, true>(program, block, pair, lanes, motion(intervals, sums));
                open |= found.open;
                if found.doubtful != 0 {
                    intervals.doubts.push((index, found.doubtful));
                }
                if found.touching != 0 {
                    hit |= found.touching;
                    for lane in 0..WIDTH {
                        if found.touching >> lane & 1 != 0 {
                            intervals.touching[lane] = index;
                        }
                    }
                }
            }
        }
    }
    (hit, open)
}
