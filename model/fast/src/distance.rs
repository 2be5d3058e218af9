//! Test of two solids in sixteen lanes: certainly apart, certainly touching, or in doubt.
//!
//! Results are verified independently of the method that found them. *Touching* is witnessed by two near points, one of
//! each core; *free* by a direction along which the supports of the two shapes are apart:
//!
//! ```text
//! g·(a - b) - support of A along g - support of B along g  >  |g| · clearance
//! ```
//!
//! Points and direction need not be the nearest ones; a bad choice only leaves a lane in doubt. So only the rounding of
//! these two tests matters, which the thresholds include (`bound.rs`).

use crate::kernel::Block;
use crate::lanes::{LaneMask, Lanes};
use crate::program::{BallAndBox, PairTest, Program, ProgramSolid, SolidForm};
use crate::vector::{LaneVector, Rows3};

/// Maximum number of projections; then the reference decides the pair.
const MAX_PROJECTIONS: usize = 12;

/// Result of testing a pair.
#[derive(Clone, Copy)]
pub(crate) struct PairResult {
    /// Lanes in which it certainly touches.
    pub touching: LaneMask,
    /// Lanes in which rounding could decide if it touches.
    pub doubtful: LaneMask,
    /// Lanes in which the two may touch after their motion.
    pub open: LaneMask,
    /// Open lanes in which more projections might give a result.
    pub stuck: LaneMask,
}

const FREE: PairResult = PairResult { touching: 0, doubtful: 0, open: 0, stuck: 0 };

/// A solid at its pose.
#[derive(Clone, Copy)]
struct PlacedSolid<'a, L> {
    form: SolidForm,
    center: LaneVector<L>,
    /// One axis, or three for a box.
    axes: &'a [Rows3],
}

impl<L: Lanes> PlacedSolid<'_, L> {
    #[inline(always)]
    fn axis(&self, i: usize) -> LaneVector<L> {
        LaneVector::load(&self.axes[i])
    }
}

/// Tests a pair in the `live` lanes. `motion` is the bound of the relative motion of the two, meters per lane; ignored
/// unless `MOVES`.
#[inline(always)]
pub(crate) fn test_pair<L: Lanes, const MOVES: bool>(
    program: &Program,
    block: &Block,
    pair: &PairTest,
    live: LaneMask,
    motion: L,
) -> PairResult {
    let (a, b) = (placed::<L>(program, block, pair.a as usize), placed::<L>(program, block, pair.b as usize));
    let between = a.center.minus(b.center);
    let mut near = within::<L, MOVES>(between.squared(), pair.ball_squared, motion) & live;
    if near == 0 {
        return FREE;
    }
    if let Some(sizes) = &pair.ball_and_box {
        return measure::<L, MOVES>(&a, &b, between, sizes, near, motion);
    }
    // Axes of the bounding capsules, their nearest points, and the direction from the second to the first.
    let (u, v) = (a.axis(0), b.axis(0));
    let half = [L::splat(pair.half[0]), L::splat(pair.half[1])];
    let (s, t) = nearest(between, u, v, half);
    let g = between.along(u, s).against(v, t);
    let squared = g.squared();
    let reach = half[0] * g.dot(u).abs() + half[1] * g.dot(v).abs();
    let gap = g.dot(between) - reach;
    near &= !apart::<L, MOVES>(gap, squared, pair.outer, motion);
    if near == 0 {
        return FREE;
    }
    let mut held = 0;
    if let Some(capsules) = &pair.held {
        let half = [L::splat(capsules.half[0]), L::splat(capsules.half[1])];
        let (s, t) = nearest(between, u, v, half);
        held = touching(between.along(u, s).against(v, t).squared(), capsules.inner) & near;
        if held == near {
            return PairResult { touching: held, doubtful: 0, open: near, stuck: 0 };
        }
    }
    let found = if pair.round {
        let touching = touching(squared, pair.inner) & near;
        let free = if MOVES { apart::<L, false>(gap, squared, pair.outer, motion) } else { 0 };
        PairResult { touching, doubtful: near & !touching & !free, open: near, stuck: 0 }
    } else {
        alternate_projections::<L, MOVES>(&a, &b, a.center.along(u, s), pair, near, motion)
    };
    solid::<MOVES>(pair, found, held)
}

/// Tests a ball and a box, in closed form.
#[inline(always)]
fn measure<L: Lanes, const MOVES: bool>(
    a: &PlacedSolid<L>,
    b: &PlacedSolid<L>,
    between: LaneVector<L>,
    sizes: &BallAndBox,
    near: LaneMask,
    motion: L,
) -> PairResult {
    let squared = if let SolidForm::Box { half, .. } = a.form {
        beyond::<L>(a, half, between)
    } else if let SolidForm::Box { half, .. } = b.form {
        beyond::<L>(b, half, between)
    } else {
        // Unreachable: such a pair would be entirely in doubt.
        return PairResult { touching: 0, doubtful: near, open: near, stuck: 0 };
    };
    let touching = touching(squared, sizes.inner) & near;
    let far = L::splat(sizes.apart);
    let free = (far * far).below(squared);
    let open = if MOVES { near & !((far + motion) * (far + motion)).below(squared) } else { near };
    PairResult { touching, doubtful: near & !touching & !free, open, stuck: 0 }
}

/// Squared distance of a point from a box, given the vector from the box's center to the point.
#[inline(always)]
fn beyond<L: Lanes>(solid: &PlacedSolid<L>, half: [f32; 3], way: LaneVector<L>) -> L {
    let mut squared = L::splat(0.0);
    for i in 0..3 {
        let over = (solid.axis(i).dot(way).abs() - L::splat(half[i])).max(L::splat(0.0));
        squared = over.mul_add(over, squared);
    }
    squared
}

/// Result for a pair whose shapes may contain hulls: shapes that are apart contain hulls that are apart; hulls touch if
/// their inner capsules touch; in all other cases the reference decides.
#[inline(always)]
fn solid<const MOVES: bool>(pair: &PairTest, found: PairResult, held: LaneMask) -> PairResult {
    if pair.held.is_none() {
        return found;
    }
    let stuck = if MOVES { found.open & !held } else { 0 };
    PairResult { touching: held, doubtful: (found.touching | found.doubtful) & !held, open: found.open, stuck }
}

/// The lanes in which a ball's center is closer than the threshold to a box, or to the axis (of half length `half`) of
/// a solid's capsule.
#[inline(always)]
pub(crate) fn beside<L: Lanes, const MOVES: bool>(
    program: &Program,
    block: &Block,
    (ball, of): (u32, u32),
    (half, within_squared): (f32, f32),
    motion: L,
) -> LaneMask {
    let solid = placed::<L>(program, block, of as usize);
    let way = LaneVector::load(&block.centers[ball as usize]).minus(solid.center);
    if let SolidForm::Box { half, .. } = solid.form {
        return within::<L, MOVES>(beyond::<L>(&solid, half, way), within_squared, motion);
    }
    let axis = solid.axis(0);
    let off = way.against(axis, way.dot(axis).clamp(L::splat(half)));
    within::<L, MOVES>(off.squared(), within_squared, motion)
}

/// The lanes in which centers of this squared distance are closer than the threshold plus the motion.
#[inline(always)]
pub(crate) fn within<L: Lanes, const MOVES: bool>(squared: L, within_squared: f32, motion: L) -> LaneMask {
    if !MOVES {
        return squared.below(L::splat(within_squared));
    }
    let within = L::splat(within_squared.sqrt()) + motion;
    squared.below(within * within)
}

#[inline(always)]
fn placed<'a, L: Lanes>(program: &Program, block: &'a Block, index: usize) -> PlacedSolid<'a, L> {
    let solid: &ProgramSolid = &program.solids[index];
    let center = LaneVector::load(&block.centers[program.balls.len() + index]);
    PlacedSolid { form: solid.form, center, axes: &block.axes[solid.first_axis..] }
}

/// The lanes in which supports are apart by more than `distance` plus the motion, along a direction of this squared
/// length.
#[inline(always)]
fn apart<L: Lanes, const MOVES: bool>(gap: L, squared: L, distance: f32, motion: L) -> LaneMask {
    let distance_squared = if MOVES {
        let distance = L::splat(distance) + motion;
        distance * distance
    } else {
        L::splat(distance * distance)
    };
    L::splat(0.0).below(gap) & (squared * distance_squared).below(gap * gap)
}

/// The lanes in which points of this squared distance are closer than `distance`.
#[inline(always)]
fn touching<L: Lanes>(squared: L, distance: f32) -> LaneMask {
    if distance > 0.0 { squared.below(L::splat(distance * distance)) } else { 0 }
}

/// The nearest points of two segments, as coordinates along their unit axes from their midpoints; `between` points from
/// the second midpoint to the first. After Ericson, *Real-Time Collision Detection*, 5.1.9, without branches: if they
/// are parallel any point will do, and the last line optimizes the first coordinate for the second.
#[inline(always)]
fn nearest<L: Lanes>(between: LaneVector<L>, u: LaneVector<L>, v: LaneVector<L>, half: [L; 2]) -> (L, L) {
    let (uv, ur, vr) = (u.dot(v), u.dot(between), v.dot(between));
    let sine_squared = uv.neg_mul_add(uv, L::splat(1.0)).max(L::splat(1e-7));
    let s = (uv * vr - ur).div(sine_squared).clamp(half[0]);
    let t = uv.mul_add(s, vr).clamp(half[1]);
    (uv.mul_add(t, L::splat(0.0) - ur).clamp(half[0]), t)
}

/// Alternating projections between the cores, with Nesterov's momentum: they converge to the nearest points, and every
/// pair of points and every direction on the way is tried as a witness.
#[inline(always)]
fn alternate_projections<L: Lanes, const MOVES: bool>(
    a: &PlacedSolid<L>,
    b: &PlacedSolid<L>,
    start: LaneVector<L>,
    pair: &PairTest,
    near: LaneMask,
    motion: L,
) -> PairResult {
    let between = a.center.minus(b.center);
    let (mut from, mut last) = (start, start);
    // Lanes: undecided; may touch after the motion; certainly touching; may touch without motion.
    let (mut unknown, mut open, mut found, mut doubtful) = (near, near, 0, near);
    for round in 0..MAX_PROJECTIONS {
        let on_b = project(b, from);
        let on_a = project(a, on_b);
        let g = on_a.minus(on_b);
        let squared = g.squared();
        let hit = touching(squared, pair.inner) & unknown;
        let gap = g.dot(between) - support(a, g) - support(b, g);
        found |= hit;
        let far = apart::<L, MOVES>(gap, squared, pair.apart, motion) & unknown;
        open &= !far;
        unknown &= !(hit | far);
        if MOVES {
            // Apart without motion, but too close for the motion: no other direction will change that.
            doubtful &= !apart::<L, false>(gap, squared, pair.apart, motion);
            let inner = (L::splat(pair.inner) + motion).max(L::splat(0.0));
            unknown &= doubtful | !squared.below(inner * inner);
        }
        if unknown == 0 {
            break;
        }
        from = on_a.along(on_a.minus(last), L::splat(round as f32 / (round as f32 + 3.0)));
        last = on_a;
    }
    let doubtful = if MOVES { doubtful & open & !found } else { unknown };
    PairResult { touching: found, doubtful, open, stuck: unknown }
}

/// The point of a solid's core nearest to a point.
#[inline(always)]
fn project<L: Lanes>(solid: &PlacedSolid<L>, point: LaneVector<L>) -> LaneVector<L> {
    let way = point.minus(solid.center);
    match solid.form {
        SolidForm::Round { half, .. } => {
            solid.center.along(solid.axis(0), solid.axis(0).dot(way).clamp(L::splat(half)))
        }
        SolidForm::Cylinder { half, radius, inset } => {
            let u = solid.axis(0);
            let along = u.dot(way);
            let across = way.against(u, along);
            let length = across.squared().sqrt().max(L::splat(1e-12));
            let share = L::splat(radius - inset).div(length).min(L::splat(1.0));
            solid.center.along(u, along.clamp(L::splat(half - inset))).along(across, share)
        }
        SolidForm::Box { half, inset } => {
            let mut at = solid.center;
            for i in 0..3 {
                let u = solid.axis(i);
                at = at.along(u, u.dot(way).clamp(L::splat(half[i] - inset)));
            }
            at
        }
    }
}

/// Extent of a solid from its center along a direction, times that direction's length; without the radius of round
/// ones.
#[inline(always)]
fn support<L: Lanes>(solid: &PlacedSolid<L>, g: LaneVector<L>) -> L {
    match solid.form {
        SolidForm::Round { half, .. } => L::splat(half) * g.dot(solid.axis(0)).abs(),
        SolidForm::Cylinder { half, radius, .. } => {
            let along = g.dot(solid.axis(0));
            // Computed as a vector: from the lengths alone it would be lost to rounding if g is along the axis.
            let across = g.against(solid.axis(0), along).squared().sqrt();
            L::splat(half) * along.abs() + L::splat(radius) * across
        }
        SolidForm::Box { half, .. } => {
            let mut sum = L::splat(0.0);
            for i in 0..3 {
                sum = L::splat(half[i]).mul_add(g.dot(solid.axis(i)).abs(), sum);
            }
            sum
        }
    }
}
