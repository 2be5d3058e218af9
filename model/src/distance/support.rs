//! Cores by their support points: parry's GJK where they are apart, separating axes or EPA where they overlap, each
//! answer checked from the other side.

use super::{Core, Separation, overlap};
use nalgebra::{Isometry3, Point3, Vector3};
use parry3d_f64::math::{Pose, Vector};
use parry3d_f64::query::epa::EPA;
use parry3d_f64::query::gjk::{self, CsoPoint, GJKResult, VoronoiSimplex};
use parry3d_f64::shape::SupportMap;

/// Nearer than this, metres, the direction between two points is noise.
const TOUCHING: f64 = 1e-10;

/// A core and where it is.
#[derive(Clone, Copy)]
pub(super) struct Placed {
    pub core: Core,
    pub pose: Isometry3<f64>,
}

impl Placed {
    pub fn center(&self) -> Point3<f64> {
        self.pose.translation.vector.into()
    }
}

impl SupportMap for Core {
    fn local_support_point(&self, dir: Vector) -> Vector {
        match *self {
            Core::Point => Vector::ZERO,
            Core::Segment { half } => Vector::new(0.0, half.copysign(dir.y), 0.0),
            Core::Box { half } => Vector::new(half.x.copysign(dir.x), half.y.copysign(dir.y), half.z.copysign(dir.z)),
            Core::Cylinder { half, radius } => {
                let rho = (dir.x * dir.x + dir.z * dir.z).sqrt();
                let k = if rho > 0.0 { radius / rho } else { 0.0 };
                Vector::new(dir.x * k, half.copysign(dir.y), dir.z * k)
            }
        }
    }
}

/// The point of a placed core that lies farthest along `direction`, world frame.
pub(super) fn support_point(placed: &Placed, direction: &Vector3<f64>) -> Point3<f64> {
    let local = placed.pose.rotation.inverse_transform_vector(direction);
    let p = placed.core.local_support_point(Vector::new(local.x, local.y, local.z));
    placed.pose * Point3::new(p.x, p.y, p.z)
}

/// How far the cores are apart along unit `n`: never more than their signed distance.
pub(super) fn along(a: &Placed, b: &Placed, n: &Vector3<f64>) -> f64 {
    (support_point(b, &-n) - support_point(a, n)).dot(n)
}

/// The signed separation of two cores, or `None` once they are surely farther apart than `cap`.
pub(super) fn separation(
    a: &Core,
    world_from_a: &Isometry3<f64>,
    b: &Core,
    world_from_b: &Isometry3<f64>,
    cap: f64,
) -> Option<Separation> {
    let a_from_b = world_from_a.inv_mul(world_from_b);
    let here = Pose::from_parts(a_from_b.translation.vector.into(), a_from_b.rotation.into());
    let mut simplex = VoronoiSimplex::new();
    let start = Vector::from(-a_from_b.translation.vector);
    let start = if start.length_squared() > 1e-24 { start.normalize() } else { Vector::X };
    simplex.reset(CsoPoint::from_shapes(&here, a, b, start));
    let local_placed = || (Placed { core: *a, pose: Isometry3::identity() }, Placed { core: *b, pose: a_from_b });
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
/// side meet, GJK may stop some micrometres early. `None` if they turn out to touch.
fn polished(a: &Placed, b: &Placed, mut p: Point3<f64>, mut q: Point3<f64>) -> Option<Separation> {
    const GOOD: f64 = 1e-8;
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

/// The point of a placed core nearest to a point.
fn project(placed: &Placed, point: &Point3<f64>) -> Point3<f64> {
    let p = placed.pose.inverse_transform_point(point);
    placed.pose
        * match placed.core {
            Core::Point => Point3::origin(),
            Core::Segment { half } => Point3::new(0.0, p.y.clamp(-half, half), 0.0),
            Core::Box { half } => {
                Point3::new(p.x.clamp(-half.x, half.x), p.y.clamp(-half.y, half.y), p.z.clamp(-half.z, half.z))
            }
            Core::Cylinder { half, radius } => {
                let k = (radius / p.x.hypot(p.z)).min(1.0);
                Point3::new(p.x * k, p.y.clamp(-half, half), p.z * k)
            }
        }
}

/// The depth of overlapping cores.
fn deepest(a: &Placed, b: &Placed, here: &Pose, simplex: &VoronoiSimplex) -> Separation {
    let flat = |c: &Core| matches!(c, Core::Box { .. } | Core::Segment { .. });
    if flat(&a.core) && flat(&b.core) {
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
    if let Some((_, _, n)) = EPA::new().closest_points(here, &a.core, &b.core, simplex) {
        let n = Vector3::new(n.x, n.y, n.z);
        n.try_normalize(1e-12).into_iter().for_each(&mut consider);
    }
    candidates(a, b).iter().filter_map(|n| n.try_normalize(1e-9)).for_each(&mut consider);
    match best {
        Some((distance, normal)) => Separation { distance, normal, points: pressed(a, b, &normal, distance) },
        None => Separation { distance: 0.0, normal: Vector3::x(), points: [a.center(), b.center()] },
    }
}

/// Where two cores touch once they have been parted by `-distance` along `n`, as points of both. The farthest points of a face,
/// an edge or a mantle line are many: those are meant where the other core presses on it.
fn pressed(a: &Placed, b: &Placed, n: &Vector3<f64>, distance: f64) -> [Point3<f64>; 2] {
    const GOOD: f64 = 1e-10;
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

/// Of the points of a placed core that lie farthest along unit `n`, the one nearest to `point`.
fn farthest_near(placed: &Placed, n: &Vector3<f64>, point: &Point3<f64>) -> Point3<f64> {
    /// How far a side may be from square to `n` and still count as a whole, rad.
    const SQUARE: f64 = 1e-6;
    let n = placed.pose.rotation.inverse_transform_vector(n);
    let p = placed.pose.inverse_transform_point(point);
    let end = |n: f64, half: f64, p: f64| if n.abs() > SQUARE { half.copysign(n) } else { p.clamp(-half, half) };
    placed.pose
        * match placed.core {
            Core::Point => Point3::origin(),
            Core::Segment { half } => Point3::new(0.0, end(n.y, half, p.y), 0.0),
            Core::Box { half } => Point3::new(end(n.x, half.x, p.x), end(n.y, half.y, p.y), end(n.z, half.z, p.z)),
            Core::Cylinder { half, radius } => {
                let slant = n.x.hypot(n.z);
                let (x, z) = if slant > SQUARE {
                    (n.x * radius / slant, n.z * radius / slant)
                } else {
                    let k = (radius / p.x.hypot(p.z)).min(1.0);
                    (p.x * k, p.z * k)
                };
                Point3::new(x, end(n.y, half, p.y), z)
            }
        }
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
