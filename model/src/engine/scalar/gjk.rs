//! Cores with no closed form: parry's GJK where they are apart, separating axes or EPA where they overlap, each
//! answer checked from the other side.
//!
//! ```text
//! GJK ── farther than the cap ──> None
//!     ── apart ──> nearest points, projected to and fro until the slab between them is empty
//!     ── overlapping ──> boxes and segments: separating axes (exact)
//!                        round ones: EPA's direction and our own, the best of all by the lower bound
//! ```
//! Neither iteration is trusted: GJK may stop early where sides are nearly parallel, EPA where its first simplex is flat. Nearest
//! points bound the distance from above and any direction bounds it from below, so that an answer whose two bounds meet is right
//! whoever found it.

use super::exact::Separation;
use super::form::Core;
use super::overlap;
use super::support::{Placed, along, farthest_near, project, support_point};
use nalgebra::{Isometry3, Point3, Vector3};
use parry3d_f64::math::{Pose, Vector};
use parry3d_f64::query::epa::EPA;
use parry3d_f64::query::gjk::{self, CsoPoint, GJKResult, VoronoiSimplex};

/// Nearer than this, meters, the direction between two points is noise.
const TOUCHING: f64 = 1e-10;

/// The signed separation of two cores, or `None` once they are surely farther apart than `cap`.
pub(super) fn separation(
    a: &Core,
    world_from_a: &Isometry3<f64>,
    b: &Core,
    world_from_b: &Isometry3<f64>,
    cap: f64,
) -> Option<Separation> {
    // In the frame of the first shape: far from the world's origin GJK would lose digits, and so would the checks.
    let a_from_b = world_from_a.inv_mul(world_from_b);
    let here = Pose::from_parts(a_from_b.translation.vector.into(), a_from_b.rotation.into());
    let mut simplex = VoronoiSimplex::new();
    let start = Vector::from(-a_from_b.translation.vector);
    let start = if start.length_squared() > 1e-24 { start.normalize() } else { Vector::X };
    // GJK begins with the direction between the centers, which is right for balls; where the centers coincide any will do.
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
            let (p, q) = (Point3::new(p.x, p.y, p.z), Point3::new(q.x, q.y, q.z));
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

/// GJK's nearest points, projected to and fro until the slab between them is empty: where a rounded and a nearly parallel
/// side meet, GJK may stop some micrometers early. `None` if they turn out to touch.
fn polished(a: &Placed, b: &Placed, mut p: Point3<f64>, mut q: Point3<f64>) -> Option<Separation> {
    /// An empty slab within this, meters, is empty: far below what anybody asks of a distance, far above rounding.
    const GOOD: f64 = 1e-8;
    /// Projecting to and fro converges slowly where sides are nearly parallel; the points are then good to a micrometer.
    const ROUNDS: usize = 50;
    let mut rounds = 0;
    loop {
        let apart = q - p;
        let distance = apart.norm();
        if distance <= TOUCHING {
            return None;
        }
        let normal = apart / distance;
        rounds += 1;
        if distance < GOOD || rounds > ROUNDS || distance - along(a, b, &normal) < GOOD {
            return Some(Separation { distance, normal, points: [p, q] });
        }
        p = project(a, &q);
        q = project(b, &p);
    }
}

/// The depth of overlapping cores: the best of what EPA finds and a few directions of our own. `here` is `a_from_b`, `simplex`
/// what GJK ended with.
fn deepest(a: &Placed, b: &Placed, here: &Pose, simplex: &VoronoiSimplex) -> Separation {
    // Separating axes are exact for them and need no iteration; EPA is for round sides only.
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
    // EPA expands a polytope and stops near the best face, or at a wrong one in a degenerate simplex. Each candidate costs two
    // support points and can only make the answer better, since every direction is a lower bound.
    candidates(a, b).iter().filter_map(|n| n.try_normalize(1e-9)).for_each(&mut consider);
    match best {
        Some((distance, normal)) => Separation { distance, normal, points: pressed(a, b, &normal, distance) },
        None => Separation { distance: 0.0, normal: Vector3::x(), points: [a.center(), b.center()] },
    }
}

/// Where two cores touch once they have been parted by `-distance` along `n`, as points of both. The farthest points of a face,
/// an edge or a mantle line are many: those are meant where the other core presses on it.
fn pressed(a: &Placed, b: &Placed, n: &Vector3<f64>, distance: f64) -> [Point3<f64>; 2] {
    /// Points that move less than this in a round, meters, have arrived.
    const GOOD: f64 = 1e-10;
    /// Where a round side presses on a flat one the points creep; after so many rounds they are good to a micrometer.
    const ROUNDS: usize = 100;
    let way = n * distance;
    let mut p = support_point(a, n);
    for _ in 0..ROUNDS {
        let next = farthest_near(a, n, &(farthest_near(b, &-n, &(p + way)) - way));
        let step = (next - p).norm();
        p = next;
        if step < GOOD {
            break;
        }
    }
    [p, p + way]
}

/// Directions in which two overlapping shapes often part most easily.
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
