//! Cores without a closed form: parry's GJK if they are apart, separating axes or EPA if they overlap. Each result is
//! checked from the other side.
//!
//! ```text
//! GJK ── farther than the cap ──> None
//!     ── apart ──> nearest points, projected alternately until the slab between them is empty
//!     ── overlapping ──> boxes and segments: separating axes (exact)
//!                        round cores: EPA's direction and fixed candidates, the best lower bound of all
//! ```
//! Neither iteration is trusted: GJK may stop early at nearly parallel sides, EPA if its first simplex is flat. Nearest
//! points bound the distance from above and any direction bounds it from below, so a result whose two bounds meet is
//! right, whichever method found it.

use super::exact::Separation;
use super::form::Core;
use super::overlap;
use super::support::{Placed, along, farthest_near, project, support_point};
use nalgebra::{Isometry3, Point3, Vector3};
use parry3d_f64::math::{Pose, Vector};
use parry3d_f64::query::epa::EPA;
use parry3d_f64::query::gjk::{self, CsoPoint, GJKResult, VoronoiSimplex};

/// Distance, meters, below which the direction between two points is noise.
const TOUCHING: f64 = 1e-10;

/// The signed separation of two cores, or `None` if they are certainly farther apart than `cap`.
pub(super) fn separation(
    a: &Core,
    world_from_a: &Isometry3<f64>,
    b: &Core,
    world_from_b: &Isometry3<f64>,
    cap: f64,
) -> Option<Separation> {
    // Computed in the frame of the first shape: far from the world's origin GJK and the checks would lose digits.
    let a_from_b = world_from_a.inv_mul(world_from_b);
    let here = Pose::from_parts(a_from_b.translation.vector.into(), a_from_b.rotation.into());
    let mut simplex = VoronoiSimplex::new();
    let start = Vector::from(-a_from_b.translation.vector);
    let start = if start.length_squared() > 1e-24 { start.normalize() } else { Vector::X };
    // GJK starts from the direction between the centers, which is exact for balls; if the centers coincide, any
    // direction will do.
    simplex.reset(CsoPoint::from_shapes(&here, a, b, start));
    let local_placed = || (Placed { core: a, pose: Isometry3::identity() }, Placed { core: b, pose: a_from_b });
    let world = |s: Separation| Separation {
        distance: s.distance,
        normal: world_from_a.rotation * s.normal,
        points: [world_from_a * s.points[0], world_from_a * s.points[1]],
    };
    match gjk::closest_points(&here, a, b, cap, true, &mut simplex) {
        GJKResult::NoIntersection(_) => None,
        GJKResult::ClosestPoints(p, q, _) => {
            let p = Point3::new(p.x, p.y, p.z);
            let q = Point3::new(q.x, q.y, q.z);
            let apart = q - p;
            let distance = apart.norm();
            let (a, b) = local_placed();
            if distance > TOUCHING
                && let Some(apart) = polished(&a, &b, p, q)
            {
                return Some(world(apart));
            }
            Some(world(deepest(&a, &b, &here, &simplex)))
        }
        GJKResult::Intersection | GJKResult::Proximity(_) => {
            let (a, b) = local_placed();
            Some(world(deepest(&a, &b, &here, &simplex)))
        }
    }
}

/// Refines GJK's nearest points by alternating projection until the slab between them is empty: where a rounded side
/// meets a nearly parallel one, GJK may stop some micrometers early. `None` if the cores turn out to touch.
fn polished(a: &Placed, b: &Placed, mut p: Point3<f64>, mut q: Point3<f64>) -> Option<Separation> {
    /// Gap, meters, within which the slab counts as empty: far below any accuracy that callers need, far above
    /// rounding.
    const SLAB_TOLERANCE_M: f64 = 1e-8;
    /// Iteration limit. Alternating projection converges slowly at nearly parallel sides; the points are then accurate
    /// to a micrometer.
    const MAX_ROUNDS: usize = 50;
    let mut rounds = 0;
    loop {
        let apart = q - p;
        let distance = apart.norm();
        if distance <= TOUCHING {
            return None;
        }
        let normal = apart / distance;
        rounds += 1;
        if distance < SLAB_TOLERANCE_M || rounds > MAX_ROUNDS || distance - along(a, b, &normal) < SLAB_TOLERANCE_M {
            return Some(Separation { distance, normal, points: [p, q] });
        }
        p = project(a, &q);
        q = project(b, &p);
    }
}

/// The depth of overlapping cores: the best of EPA's result and a few fixed candidate directions. `here` is `a_from_b`,
/// `simplex` GJK's final simplex.
fn deepest(a: &Placed, b: &Placed, here: &Pose, simplex: &VoronoiSimplex) -> Separation {
    // For flat cores separating axes are exact and need no iteration; EPA is only for round sides.
    let flat = |c: &Core| matches!(c, Core::Box { .. } | Core::Segment { .. });
    if flat(a.core) && flat(b.core) {
        return overlap::by_axes(a, b);
    }
    let mut best: Option<(f64, Vector3<f64>)> = None;
    let mut consider = |n: Vector3<f64>| {
        for n in [n, -n] {
            let distance = along(a, b, &n);
            if best.is_none_or(|(d, _)| distance > d) {
                best = Some((distance, n));
            }
        }
    };
    if let Some((_, _, n)) = EPA::new().closest_points(here, a.core, b.core, simplex) {
        let n = Vector3::new(n.x, n.y, n.z);
        n.try_normalize(1e-12).into_iter().for_each(&mut consider);
    }
    // EPA expands a polytope and stops near the best face, or at a wrong one if its simplex is degenerate. Each
    // candidate costs two support points and can only improve the result, since every direction gives a lower bound.
    candidates(a, b).iter().filter_map(|n| n.try_normalize(1e-9)).for_each(&mut consider);
    match best {
        Some((distance, normal)) => Separation { distance, normal, points: pressed(a, b, &normal, distance) },
        None => Separation { distance: 0.0, normal: Vector3::x(), points: [a.center(), b.center()] },
    }
}

/// Contact points on both cores after a separating translation of `-distance` along `n`. A face, an edge or a mantle
/// line has many farthest points; chosen are those that the other core presses on.
fn pressed(a: &Placed, b: &Placed, n: &Vector3<f64>, distance: f64) -> [Point3<f64>; 2] {
    /// Step length, meters, below which the points have converged.
    const CONVERGED_M: f64 = 1e-10;
    /// Iteration limit. If a round side presses on a flat one, convergence is slow; the points are then accurate to a
    /// micrometer.
    const MAX_ROUNDS: usize = 100;
    let shift = n * distance;
    let mut p = support_point(a, n);
    for _ in 0..MAX_ROUNDS {
        let next = farthest_near(a, n, &(farthest_near(b, &-n, &(p + shift)) - shift));
        let step = (next - p).norm();
        p = next;
        if step < CONVERGED_M {
            break;
        }
    }
    [p, p + shift]
}

/// Candidate directions in which two overlapping shapes often separate most easily.
fn candidates(a: &Placed, b: &Placed) -> [Vector3<f64>; 18] {
    let axis = |p: &Placed, i: usize| {
        let mut e = Vector3::zeros();
        e[i] = 1.0;
        p.pose.rotation * e
    };
    let between = b.center() - a.center();
    let mut all = [Vector3::zeros(); 18];
    let mut next = 0;
    let mut put = |v: Vector3<f64>| {
        if let Some(slot) = all.get_mut(next) {
            *slot = v;
            next += 1;
        }
    };
    put(between);
    let main = |p: &Placed| axis(p, 1);
    for (p, q) in [(a, b), (b, a)] {
        if matches!(p.core, Core::Box { .. }) {
            (0..3).for_each(|i| put(axis(p, i)));
            (0..3).for_each(|i| put(axis(p, i).cross(&main(q))));
        } else {
            put(main(p));
            put(between - main(p) * main(p).dot(&between));
        }
    }
    put(main(a).cross(&main(b)));
    all
}
