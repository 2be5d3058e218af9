//! A part of the mesh and the shape that encloses it.

use super::enclose::{self, Cover, THICKENING};
use super::filled::Filled;
use super::probe::{self, COARSE, MEDIUM};
use super::soup::Triangle;
use mobee_model::{Hull, Shape};
use nalgebra::{UnitQuaternion, Vector3};

/// Number of axes for the extreme points that represent a piece's corners while shapes are tried; at most two points
/// per axis.
pub(super) const DIRECTIONS: usize = 48;
/// Cost factor of a cylinder: its collision test takes several times longer.
const CYLINDER_COST: f64 = 1.3;
/// Cost factor of a box, compared with a ball or capsule.
const BOX_COST: f64 = 1.1;
/// Cost, meters, of a shape that contains all claimed points.
const CLAIMED_COST_M: f64 = 0.006;
/// Rotations that are tried to improve an enclosing shape, rad.
const ROTATION_STEPS_RAD: [f64; 4] = [0.2, 0.1, 0.05, 0.02];

/// A shape, and its distance outside the mesh.
#[derive(Clone, Copy, Debug)]
pub(super) struct CoverFit {
    /// The enclosing shape.
    pub cover: Cover,
    /// The largest distance of its surface from the mesh, meters.
    pub worst: f64,
    /// The mean distance, meters.
    pub mean: f64,
    /// The value to minimize, meters: the bound applies to the worst distance, but the mean distance costs free space,
    /// too.
    pub cost: f64,
}

/// Measures a shape at `rows` rows of surface points.
pub(super) fn evaluate(cover: Cover, rows: usize, filled: &Filled) -> CoverFit {
    let (worst, mean, cost) = measured(&cover, rows, filled, f64::INFINITY).unwrap_or_default();
    CoverFit { cover, worst, mean, cost }
}

/// The worst and the mean distance of a shape, and its cost; `None` as soon as the cost reaches `other`.
fn measured(cover: &Cover, rows: usize, filled: &Filled, other: f64) -> Option<(f64, f64, f64)> {
    let factor = match cover.shape {
        Shape::Sphere { .. } | Shape::Capsule { .. } => 1.0,
        Shape::Box { .. } => BOX_COST,
        Shape::Cylinder { .. } => CYLINDER_COST,
    };
    let points = probe::points(cover, rows);
    let count = points.len() as f64;
    let (mut worst, mut sum): (f64, f64) = (0.0, 0.0);
    for p in &points {
        let outside = filled.outside(p);
        worst = worst.max(outside);
        sum += outside;
        if (worst + sum / count) * factor >= other {
            return None;
        }
    }
    let mean = sum / count;
    let cost = (worst + mean) * factor + CLAIMED_COST_M * filled.taken(cover);
    (cost < other).then_some((worst, mean, cost))
}

/// The cheaper of a measured shape and another one.
fn better(a: CoverFit, cover: Cover, filled: &Filled) -> CoverFit {
    measured(&cover, COARSE, filled, a.cost).map_or(a, |(worst, mean, cost)| CoverFit { cover, worst, mean, cost })
}

/// The cheapest shape of all kinds around the points, along the axes of the given frames; `None` without points.
pub(super) fn best(points: &[Vector3<f64>], turns: &[UnitQuaternion<f64>], filled: &Filled) -> Option<CoverFit> {
    if points.is_empty() {
        return None;
    }
    let all = turns.iter().flat_map(|turn| enclose::all_kinds(points, turn));
    all.fold(None, |best, cover| {
        Some(best.map_or_else(|| evaluate(cover, COARSE, filled), |best| better(best, cover, filled)))
    })
}

/// Translates and rotates a shape while that improves it.
fn refined(points: &[Vector3<f64>], from: CoverFit, filled: &Filled) -> CoverFit {
    let mut best = from;
    for by in ROTATION_STEPS_RAD {
        for axis in [Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()] {
            for by in [by, -by] {
                let pose = best.cover.pose * UnitQuaternion::from_axis_angle(&axis, by);
                let turned = enclose::around(points, &Cover { pose, ..best.cover });
                best = better(best, turned, filled);
            }
        }
        let centered = enclose::centered(points, &best.cover);
        best = better(best, centered, filled);
        if let Shape::Capsule { radius, .. } = centered.shape {
            for by in THICKENING {
                let shape = Shape::Capsule { radius: radius * by, height: 0.0 };
                best = better(best, enclose::around(points, &Cover { shape, ..centered }), filled);
            }
        }
    }
    best
}

/// A part of the mesh, and the shape that encloses it.
#[derive(Clone, Debug)]
pub(super) struct Piece {
    /// Its triangles, clipped.
    pub triangles: Vec<Triangle>,
    /// Points distributed evenly over them.
    pub samples: Vec<Vector3<f64>>,
    /// Its extreme corners.
    pub extremes: Vec<Vector3<f64>>,
    /// The enclosing shape.
    pub fit: CoverFit,
    /// True if it has been refitted around claimed points.
    pub reshaped: bool,
    /// Number of consecutive splits that did not reduce the claimed points inside.
    pub failed_splits: u8,
    /// Solid part of the shape; `None`: all of it.
    pub hull: Option<Hull>,
}

impl Piece {
    /// Encloses triangles. `like` is a candidate frame besides the link's and that of the principal axes. `None`
    /// without triangles.
    pub fn new(
        triangles: Vec<Triangle>,
        samples: Vec<Vector3<f64>>,
        like: &UnitQuaternion<f64>,
        filled: &Filled,
    ) -> Option<Self> {
        let extremes = extremes(DIRECTIONS, triangles.iter().flatten());
        let turns = [UnitQuaternion::identity(), enclose::principal_axes(spread(&samples, &extremes)), *like];
        let rough = best(&extremes, &turns, filled)?;
        let fine = refined(&extremes, rough, filled);
        // Corners between the extreme ones may stick out slightly.
        let corners: Vec<Vector3<f64>> = triangles.iter().flatten().copied().collect();
        let fit = evaluate(enclose::around(&corners, &fine.cover), MEDIUM, filled);
        Some(Self { triangles, samples, extremes, fit, reshaped: false, failed_splits: 0, hull: None })
    }

    /// Both pieces merged into one.
    pub fn merged(mut self, other: Self, filled: &Filled) -> Option<Self> {
        self.triangles.extend(other.triangles);
        self.samples.extend(other.samples);
        Self::new(self.triangles, self.samples, &other.fit.cover.pose.rotation, filled)
    }
}

/// Points for the principal axes: the evenly distributed samples if there are enough, else the extreme corners.
pub(super) fn spread<'a>(samples: &'a [Vector3<f64>], extremes: &'a [Vector3<f64>]) -> &'a [Vector3<f64>] {
    if samples.len() < 12 { extremes } else { samples }
}

/// The points that lie farthest in either direction along one of `count` axes, each once.
pub(super) fn extremes<'a>(count: usize, points: impl Iterator<Item = &'a Vector3<f64>>) -> Vec<Vector3<f64>> {
    let mut all: Vec<_> = directions(count)
        .map(|direction| (direction, [(f64::INFINITY, Vector3::zeros()), (f64::NEG_INFINITY, Vector3::zeros())]))
        .collect();
    for p in points {
        for (direction, [low, high]) in &mut all {
            let along = direction.dot(p);
            if along < low.0 {
                *low = (along, *p);
            }
            if along > high.0 {
                *high = (along, *p);
            }
        }
    }
    let found = all.into_iter().flat_map(|(_, ends)| ends);
    let mut out: Vec<Vector3<f64>> = found.filter(|(along, _)| along.is_finite()).map(|(_, p)| p).collect();
    out.sort_by(in_order);
    out.dedup();
    out
}

/// Orders points by x, then y, then z.
pub(super) fn in_order(a: &Vector3<f64>, b: &Vector3<f64>) -> std::cmp::Ordering {
    a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z))
}

/// Directions distributed evenly over half a sphere, in a spiral.
fn directions(count: usize) -> impl Iterator<Item = Vector3<f64>> {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    (0..count).map(move |i| {
        // The axes first: most parts have faces perpendicular to them.
        if i < 3 {
            return Vector3::ith(i, 1.0);
        }
        let y = (i as f64 - 2.5) / (count - 3) as f64;
        let (sin, cos) = (golden * i as f64).sin_cos();
        let r = (1.0 - y * y).max(0.0).sqrt();
        Vector3::new(r * cos, y, r * sin)
    })
}
