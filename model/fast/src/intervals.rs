//! Kernel for intervals of edges: sixteen of them, each tested at its midpoint with the motion on it as a margin.
//!
//! A pair is free on the whole interval if, at the midpoint, it is farther apart than the clearance plus the relative
//! motion of the two from there to either end. Lanes are independent: the result for an interval does not depend on the
//! other intervals in its block.

use crate::distance::{PairResult, beside, test_pair, within};
use crate::kernel::{Block, place_group, place_region, start_placing};
use crate::lanes::{LaneMask, Lanes, Row, WIDTH};
use crate::motion::{Motions, coarse, fine, place_twists, start, sum_up};
use crate::program::{Program, Step, UnitTest};
use crate::vector::LaneVector;

/// Number of unit pairs per batch of ball tests.
const BATCH: usize = 32;
/// Marks the absence of a pair.
pub(crate) const NONE: usize = usize::MAX;

/// Input and results of sixteen intervals.
#[derive(Clone, Debug, Default)]
pub(crate) struct Intervals {
    /// Motions from the midpoint to either end.
    pub motions: Motions,
    /// The units to test, with their lanes; in ascending order.
    pub requested: Vec<(u32, LaneMask)>,
    /// The units that may touch, with their lanes, in the same order.
    pub open: Vec<(u32, LaneMask)>,
    /// Per lane: the first pair found that certainly touches at the midpoint, or [`NONE`].
    pub touching: [usize; WIDTH],
    /// Pairs for which rounding could decide if they touch at the midpoint, with their lanes.
    pub doubts: Vec<(usize, LaneMask)>,
    /// Pairs that the lanes could not decide; these count as free in `open`.
    pub stuck: Vec<Stuck>,
}

/// A pair that the projections can't decide.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stuck {
    pub unit: u32,
    pub pair: usize,
    pub lanes: LaneMask,
    /// Bound of the relative motion of the two, meters.
    pub motion: Row,
}

impl Intervals {
    pub fn new(program: &Program) -> Self {
        Intervals { motions: Motions::new(program), ..Intervals::default() }
    }
}

/// Tests the requested intervals, with the block's motors at their midpoints.
#[inline(always)]
pub(crate) fn sweep<L: Lanes>(program: &Program, block: &mut Block, intervals: &mut Intervals) {
    intervals.open.clear();
    intervals.doubts.clear();
    intervals.stuck.clear();
    intervals.touching = [NONE; WIDTH];
    start_placing::<L>(program, block);
    start::<L>(program, &mut intervals.motions);
    place_twists::<L>(program, block, &mut intervals.motions, 0);
    let mut touching = 0;
    let mut from = 0;
    while from < intervals.requested.len() {
        let to = intervals.requested.len().min(from + BATCH);
        for i in from..to {
            sum_up::<L>(program, &mut intervals.motions, &program.unit_motions[intervals.requested[i].0 as usize]);
        }
        // All at once and without a branch, as in `kernel.rs`.
        let (mut near, mut count) = ([(0, 0); BATCH], 0);
        for (unit, requested) in &intervals.requested[from..to] {
            let motion = coarse::<L>(&intervals.motions, &program.unit_motions[*unit as usize]);
            let UnitTest { a, b, within_squared, .. } = program.units[*unit as usize];
            let lanes = nearer::<L>(block, a, b, within_squared, motion) & requested;
            near[count] = (*unit, lanes);
            count += usize::from(lanes != 0);
        }
        for (unit, lanes) in &near[..count] {
            let UnitTest { a, b, within_squared, .. } = program.units[*unit as usize];
            let between = &program.unit_motions[*unit as usize];
            let motion = fine::<L>(program, block, &intervals.motions, between, a, b);
            let lanes = lanes & nearer::<L>(block, a, b, within_squared, motion);
            // In a lane with a contact only the possibility of further contacts matters.
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

/// Lanes in which two centers are closer than the threshold, or may be after the motion.
#[inline(always)]
fn nearer<L: Lanes>(block: &Block, a: usize, b: usize, within_squared: f32, motion: L) -> LaneMask {
    let between = LaneVector::<L>::load(&block.centers[a]).minus(LaneVector::load(&block.centers[b]));
    within::<L, true>(between.squared(), within_squared, motion)
}

/// Executes the steps of two units that are near in these lanes.
///
/// # Returns
/// The lanes in which a pair certainly touches, and all lanes in which one may.
#[inline(always)]
fn take_steps<L: Lanes>(
    program: &Program,
    block: &mut Block,
    intervals: &mut Intervals,
    unit: usize,
    near: LaneMask,
) -> (LaneMask, LaneMask) {
    let mut hit = 0;
    let mut open = 0;
    let UnitTest { steps, is_object, .. } = &program.units[unit];
    let (code, first) = program.code(*is_object);
    // Stack of open steps: the lanes that are near, and the step at which each ends; at most four are nested.
    let mut scopes = [(near, steps.end); 5];
    let mut depth = 0;
    let mut at = steps.start;
    while at < steps.end {
        while at >= scopes[depth].1 && depth > 0 {
            depth -= 1;
        }
        let lanes = scopes[depth].0 & !hit;
        let step = &code.steps[at];
        let motions = &code.motions[at];
        at += 1;
        match *step {
            Step::Near { a, b, within_squared, skip } => {
                sum_up::<L>(program, &mut intervals.motions, motions);
                let (a, b) = (a as usize, b as usize);
                let motion = fine::<L>(program, block, &intervals.motions, motions, a, b);
                let near = nearer::<L>(block, a, b, within_squared, motion) & lanes;
                if near == 0 {
                    at = skip as usize;
                } else {
                    depth += 1;
                    scopes[depth] = (near, skip as usize);
                }
            }
            Step::Beside { ball, of, half, within_squared, skip } => {
                sum_up::<L>(program, &mut intervals.motions, motions);
                let (a, b) = (ball as usize, program.balls.len() + of as usize);
                let motion = fine::<L>(program, block, &intervals.motions, motions, a, b);
                let near = beside::<L, true>(program, block, (ball, of), (half, within_squared), motion) & lanes;
                if near == 0 {
                    at = skip as usize;
                } else {
                    depth += 1;
                    scopes[depth] = (near, skip as usize);
                }
            }
            Step::Region(region) => {
                if place_region::<L>(program, block, region) {
                    place_twists::<L>(program, block, &mut intervals.motions, region);
                }
            }
            Step::Group(group) => place_group::<L>(program, block, group),
            Step::Pair(index) => {
                if lanes == 0 {
                    continue;
                }
                let pair = &code.pairs[index];
                let index = first + index;
                sum_up::<L>(program, &mut intervals.motions, motions);
                let [a, b] = [pair.a, pair.b].map(|solid| program.balls.len() + solid as usize);
                let motion = fine::<L>(program, block, &intervals.motions, motions, a, b);
                let found: PairResult = test_pair::<L, true>(program, block, pair, lanes, motion);
                open |= found.open & !found.stuck;
                if found.stuck != 0 {
                    let mut stuck =
                        Stuck { unit: unit as u32, pair: index, lanes: found.stuck, motion: Row::default() };
                    motion.store(&mut stuck.motion);
                    intervals.stuck.push(stuck);
                }
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
