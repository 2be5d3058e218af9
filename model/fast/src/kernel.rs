//! The kernel: runs sixteen poses through a program. One source for all instruction sets.
//!
//! Lanes must not pass through closures and iterator adapters: a function that is not inlined does not have the
//! instructions enabled, and each operation becomes a call. Hence plain loops and written-out arrays here and in
//! `distance.rs`, `vector.rs` and `lanes.rs`.

use crate::distance::{beside, test_pair};
use crate::lanes::{LaneMask, Lanes, Row, WIDTH, WideRow};
use crate::program::{Bend, Joint, Motion, Program, Step, UnitTest};
use crate::vector::{LaneVector, Rows3};

/// Number of unit pairs per batch of ball tests.
const BATCH: usize = 32;

/// A block stops at a cut if at most this fraction (1/n) of its lanes is live; these continue in fuller blocks.
const STOP_DIVISOR: u32 = 2;

/// Buffers of the kernel: allocated once, reused for every block.
#[derive(Clone, Debug, Default)]
pub(crate) struct Block {
    /// Per motor: its position in every lane, within its limits, rad of encoder. Input of the kernel.
    pub motors: Vec<WideRow>,
    /// Per frame: its axes x, y, z and its origin, world frame.
    pub frames: Vec<[Rows3; 4]>,
    /// Centers of balls, then of solids, world frame.
    pub centers: Vec<Rows3>,
    /// Axes of solids, world frame.
    pub axes: Vec<Rows3>,
    /// Per region and per group: true if it is placed.
    pub regions_placed: Vec<bool>,
    pub groups_placed: Vec<bool>,
    /// Per motor: true if it has the same position in every block, namely that in its row.
    pub still: Vec<bool>,
    /// Per frame: true if it, and the balls on it, will be unchanged in the next block.
    pub unchanged: Vec<bool>,
    /// Per joint with a fixed motor: its sine and cosine, once computed.
    turns: Vec<Option<Box<[Row; 2]>>>,
    /// Lanes in which rounding could decide a pair: (pair, lanes).
    pub doubts: Vec<(usize, LaneMask)>,
    /// True if the lanes are poses of one line, so that a contact in any lane ends the check of all.
    pub one_decides: bool,
    /// Per pair: the number of lanes that it decided; empty unless decisions are counted.
    pub decided: Vec<u32>,
}

impl Block {
    /// Allocates buffers for a program, with everything placed that is independent of the pose.
    pub fn new(program: &Program) -> Self {
        let mut block = Block {
            motors: vec![WideRow::default(); program.limits.len()],
            frames: vec![Default::default(); program.frames],
            centers: vec![Default::default(); program.balls.len() + program.solids.len()],
            axes: vec![Default::default(); program.axes],
            regions_placed: vec![false; program.regions.len()],
            groups_placed: vec![false; program.groups.len()],
            ..Block::default()
        };
        block.forget(program);
        for (frame, numbers) in &program.fixed_frames {
            for (row, x) in block.frames[*frame].iter_mut().flatten().zip(numbers) {
                *row = Row([*x; WIDTH]);
            }
            place_balls::<crate::lanes::Portable>(program, &mut block, *frame);
        }
        for (g, _) in program.groups.iter().enumerate().filter(|(_, group)| group.fixed) {
            place_group::<crate::lanes::Portable>(program, &mut block, g);
        }
        (program.robot_solids..program.solids.len()).for_each(|solid| block.place_object(program, solid));
        block
    }

    /// Makes room for more objects and joints of a changed program.
    pub fn resize(&mut self, program: &Program) {
        self.centers.resize(program.balls.len() + program.solids.len(), Default::default());
        self.axes.resize(program.axes, Default::default());
        self.forget(program);
    }

    /// Places a solid of an object.
    pub fn place_object(&mut self, program: &Program, index: usize) {
        let solid = &program.solids[index];
        let rows = |point: &[f32; 3]| point.map(|x| Row([x; WIDTH]));
        self.centers[program.balls.len() + index] = rows(&solid.center);
        for (axis, own) in solid.used_axes().iter().zip(&mut self.axes[solid.first_axis..]) {
            *own = rows(axis);
        }
    }

    /// Resets: from now on any motor may move from block to block.
    pub fn forget(&mut self, program: &Program) {
        self.still.clear();
        self.still.resize(program.limits.len(), false);
        self.unchanged.clear();
        self.unchanged.resize(program.frames, false);
        program.fixed_frames.iter().for_each(|(frame, _)| self.unchanged[*frame] = true);
        self.turns.clear();
        self.turns.resize(program.joints.len(), None);
    }
}

/// Tests the requested lanes of a block, starting at a cut of the program.
///
/// # Returns
/// The lanes that are still live (all others certainly touch); and the cut at which it stopped because too few were
/// left, if it did. Live lanes may be in doubt: see [`Block::doubts`].
#[inline(always)]
pub(crate) fn judge<L: Lanes>(
    program: &Program,
    block: &mut Block,
    requested: LaneMask,
    cut: usize,
) -> (LaneMask, Option<usize>) {
    block.doubts.clear();
    let mut live = requested;
    start_placing::<L>(program, block);
    for next in cut + 1..program.cuts.len() {
        for units in program.units[program.cuts[next - 1]..program.cuts[next]].chunks(BATCH) {
            live = judge_units::<L>(program, block, units, live);
            if live == 0 {
                return (0, None);
            }
        }
        if next + 1 < program.cuts.len() && live.count_ones() * STOP_DIVISOR <= requested.count_ones() {
            return (live, Some(next));
        }
    }
    (live, None)
}

#[inline(always)]
fn judge_units<L: Lanes>(program: &Program, block: &mut Block, units: &[UnitTest], mut live: LaneMask) -> LaneMask {
    // All at once and without a branch: the pairs of units that are near can't be predicted.
    let (mut near, mut count) = ([(0, 0); BATCH], 0);
    for (i, unit) in units.iter().enumerate() {
        let lanes = nearer::<L>(block, unit.a, unit.b, unit.within_squared);
        near[count] = (i, lanes);
        count += usize::from(lanes & live != 0);
    }
    for (i, lanes) in &near[..count] {
        // Some lanes may have been decided since.
        if lanes & live != 0 {
            live = take_steps::<L>(program, block, &units[*i], live);
        }
    }
    live
}

/// Invalidates what depends on the last poses, and places what is needed at every pose.
#[inline(always)]
pub(crate) fn start_placing<L: Lanes>(program: &Program, block: &mut Block) {
    for (placed, group) in block.groups_placed.iter_mut().zip(&program.groups) {
        *placed = group.fixed;
    }
    block.regions_placed.fill(false);
    place_region::<L>(program, block, 0);
}

/// Lanes in which two centers are closer than the threshold.
#[inline(always)]
fn nearer<L: Lanes>(block: &Block, a: usize, b: usize, within_squared: f32) -> LaneMask {
    let between = LaneVector::<L>::load(&block.centers[a]).minus(LaneVector::load(&block.centers[b]));
    between.squared().below(L::splat(within_squared))
}

/// Executes the steps of two units; returns the lanes that are still live.
#[inline(always)]
fn take_steps<L: Lanes>(program: &Program, block: &mut Block, unit: &UnitTest, mut live: LaneMask) -> LaneMask {
    let (code, first) = program.code(unit.is_object);
    let mut at = unit.steps.start;
    while at < unit.steps.end {
        let step = &code.steps[at];
        at += 1;
        match *step {
            Step::Near { a, b, within_squared, skip } => {
                if nearer::<L>(block, a as usize, b as usize, within_squared) & live == 0 {
                    at = skip as usize;
                }
            }
            Step::Beside { ball, of, half, within_squared, skip } => {
                let motion = L::splat(0.0);
                if beside::<L, false>(program, block, (ball, of), (half, within_squared), motion) & live == 0 {
                    at = skip as usize;
                }
            }
            Step::Region(region) => {
                place_region::<L>(program, block, region);
            }
            Step::Group(group) => place_group::<L>(program, block, group),
            Step::Pair(index) => {
                let found = test_pair::<L, false>(program, block, &code.pairs[index], live, L::splat(0.0));
                if found.touching | found.doubtful != 0 {
                    live = if block.one_decides && found.touching != 0 { 0 } else { live & !found.touching };
                    if found.doubtful != 0 {
                        block.doubts.push((first + index, found.doubtful));
                    }
                    if let Some(count) = block.decided.get_mut(first + index) {
                        *count += found.touching.count_ones();
                    }
                    if live == 0 {
                        break;
                    }
                }
            }
        }
    }
    live
}

/// Places the frames of a region, with the balls on them.
///
/// # Returns
/// True if it was not placed before.
#[inline(always)]
pub(crate) fn place_region<L: Lanes>(program: &Program, block: &mut Block, region: usize) -> bool {
    if std::mem::replace(&mut block.regions_placed[region], true) {
        return false;
    }
    for j in program.regions[region].clone() {
        let joint = &program.joints[j];
        if !block.unchanged[joint.frame] {
            place_frame::<L>(block, joint, j);
            place_balls::<L>(program, block, joint.frame);
            block.unchanged[joint.frame] = block.still[joint.motor] && block.unchanged[joint.parent];
        }
    }
    true
}

#[inline(always)]
fn place_frame<L: Lanes>(block: &mut Block, joint: &Joint, index: usize) {
    let [mut x, mut y, mut z, origin] = axes_and_origin::<L>(&block.frames[joint.parent]);
    let mut origin = moved(origin, [x, y, z], joint.shift);
    let q = &block.motors[joint.motor];
    match joint.motion {
        Motion::Turn { about_z, about_x } => {
            (x, y) = bend(x, y, about_z);
            (y, z) = bend(y, z, about_x);
            let (sine, cosine) = if let Some(known) = &block.turns[index] {
                (L::load(&known[0]), L::load(&known[1]))
            } else {
                let mut rows = [Row::default(); 2];
                let [sine, cosine] = &mut rows;
                sine_cosine::<L>(q, joint, sine, cosine);
                if block.still[joint.motor] {
                    block.turns[index] = Some(Box::new(rows));
                }
                (L::load(&rows[0]), L::load(&rows[1]))
            };
            (x, y) = turn(x, y, cosine, sine);
        }
        Motion::Slide { along } => {
            let mut way = Row::default();
            for (way, q) in way.0.iter_mut().zip(&q.0) {
                *way = (joint.start + (q - joint.low) * joint.gain) as f32;
            }
            let zero = LaneVector { x: L::splat(0.0), y: L::splat(0.0), z: L::splat(0.0) };
            origin = origin.along(moved(zero, [x, y, z], along), L::load(&way));
        }
    }
    let frame = &mut block.frames[joint.frame];
    x.store(&mut frame[0]);
    y.store(&mut frame[1]);
    z.store(&mut frame[2]);
    origin.store(&mut frame[3]);
}

/// A point translated by a constant vector of a frame with these axes.
#[inline(always)]
pub(crate) fn moved<L: Lanes>(point: LaneVector<L>, axes: [LaneVector<L>; 3], by: [f32; 3]) -> LaneVector<L> {
    let mut at = point;
    for i in 0..3 {
        if by[i] != 0.0 {
            at = at.along(axes[i], L::splat(by[i]));
        }
    }
    at
}

/// A frame's axes and origin.
#[inline(always)]
fn axes_and_origin<L: Lanes>(frame: &[Rows3; 4]) -> [LaneVector<L>; 4] {
    [LaneVector::load(&frame[0]), LaneVector::load(&frame[1]), LaneVector::load(&frame[2]), LaneVector::load(&frame[3])]
}

/// Two axes of a frame, rotated in their plane.
#[inline(always)]
fn turn<L: Lanes>(u: LaneVector<L>, v: LaneVector<L>, cosine: L, sine: L) -> (LaneVector<L>, LaneVector<L>) {
    (u.times(cosine).along(v, sine), v.times(cosine).against(u, sine))
}

#[inline(always)]
fn bend<L: Lanes>(u: LaneVector<L>, v: LaneVector<L>, by: Bend) -> (LaneVector<L>, LaneVector<L>) {
    match by {
        Bend::None => (u, v),
        Bend::Quarter => (v, u.negated()),
        Bend::By { cosine, sine } => turn(u, v, L::splat(cosine), L::splat(sine)),
    }
}

#[inline(always)]
fn place_balls<L: Lanes>(program: &Program, block: &mut Block, frame: usize) {
    for &ball in &program.ball_order[program.frame_balls[frame].clone()] {
        let [x, y, z, origin] = axes_and_origin::<L>(&block.frames[frame]);
        moved(origin, [x, y, z], program.balls[ball].center).store(&mut block.centers[ball]);
    }
}

#[inline(always)]
pub(crate) fn place_group<L: Lanes>(program: &Program, block: &mut Block, group: usize) {
    if std::mem::replace(&mut block.groups_placed[group], true) {
        return;
    }
    let zero = LaneVector { x: L::splat(0.0), y: L::splat(0.0), z: L::splat(0.0) };
    for s in program.groups[group].solids.clone() {
        let solid = &program.solids[s];
        let [x, y, z, origin] = axes_and_origin::<L>(&block.frames[solid.frame]);
        moved(origin, [x, y, z], solid.center).store(&mut block.centers[program.balls.len() + s]);
        for (axis, rows) in solid.used_axes().iter().zip(&mut block.axes[solid.first_axis..]) {
            moved(zero, [x, y, z], *axis).store(rows);
        }
    }
}

/// Sine and cosine of a joint's angle. The error of both together is at most 1.65 units of `u` (`bound.rs`).
///
/// The angle is reduced to an eighth of a turn in `f64`, so that its magnitude is irrelevant; the series (from Cephes)
/// are summed in `f32`. Plain loops, which the compiler vectorizes.
#[inline(always)]
pub(crate) fn sine_cosine<L: Lanes>(q: &WideRow, joint: &Joint, sine: &mut Row, cosine: &mut Row) {
    use std::f64::consts::{FRAC_2_PI, FRAC_PI_2};
    /// Adding this rounds to a whole number and leaves it in the lowest bits.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let fma = |a: f64, b: f64, c: f64| if L::FUSED { a.mul_add(b, c) } else { a * b + c };
    let single = |a: f32, b: f32, c: f32| if L::FUSED { a.mul_add(b, c) } else { a * b + c };
    let (mut rest, mut quarters) = ([0.0_f32; WIDTH], [0_u32; WIDTH]);
    for i in 0..WIDTH {
        let angle = joint.start + (q.0[i] - joint.low) * joint.gain;
        let rounded = fma(angle, FRAC_2_PI, ROUND);
        quarters[i] = rounded.to_bits() as u32;
        rest[i] = fma(rounded - ROUND, -FRAC_PI_2, angle) as f32;
    }
    for i in 0..WIDTH {
        let (r, quarter) = (rest[i], quarters[i]);
        let r2 = r * r;
        let s = single(r2, single(r2, -1.951_529_6e-4, 8.332_161e-3), -1.666_665_5e-1);
        let s = single(r * r2, s, r);
        let c = single(r2, single(r2, 2.443_315_7e-5, -1.388_731_6e-3), 4.166_664_6e-2);
        let c = single(r2, single(r2, c, -0.5), 1.0);
        let swap = quarter & 1 != 0;
        let (a, b) = if swap { (c, s) } else { (s, c) };
        sine.0[i] = f32::from_bits(a.to_bits() ^ ((quarter & 2) << 30));
        cosine.0[i] = f32::from_bits(b.to_bits() ^ ((quarter.wrapping_add(1) & 2) << 30));
    }
}
