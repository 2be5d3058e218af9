//! A part of the mesh and the shape that encloses it.

use super::enclose::{self, Cover, THICKER};
use super::filled::Filled;
use super::probe::{self, COARSE, MEDIUM};
use super::soup::Triangle;
use crate::{Hull, Shape};
use nalgebra::{UnitQuaternion, Vector3};

/// Half as many extreme points of a piece stand for all of its corners while shapes are tried.
pub(super) const DIRECTIONS: usize = 48;
/// A cylinder must be so much nearer to be taken: it takes several times longer to test.
const CYLINDER: f64 = 1.3;
/// A box must be so much nearer than a ball or capsule.
const BOX: f64 = 1.1;
/// What a shape costs that holds all places which others claim, meters.
const CLAIMED: f64 = 0.006;
/// Turns by which an enclosing shape is improved, rad.
const TURNS: [f64; 4] = [0.2, 0.1, 0.05, 0.02];

/// A shape, and how far it is outside the mesh.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tried {
    /// The shape.
    pub cover: Cover,
    /// The largest distance from the mesh, meters.
    pub worst: f64,
    /// The mean distance, meters.
    pub mean: f64,
    /// What is to be small, meters: the bound is on the worst, but each mean millimeter costs free space.
    pub cost: f64,
}

/// Measures a shape at points in so many rows.
pub(super) fn tried(cover: Cover, rows: usize, filled: &Filled) -> Tried {
    let (worst, mean, cost) = measured(&cover, rows, filled, f64::INFINITY).unwrap_or_default();
    Tried { cover, worst, mean, cost }
}

/// The worst and the mean distance of a shape, and its cost; `None` as soon as that is no less than what another costs.
fn measured(cover: &Cover, rows: usize, filled: &Filled, other: f64) -> Option<(f64, f64, f64)> {
    let factor = match cover.shape {
        Shape::Sphere { .. } | Shape::Capsule { .. } => 1.0,
        Shape::Box { .. } => BOX,
        Shape::Cylinder { .. } => CYLINDER,
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
    let cost = (worst + mean) * factor + CLAIMED * filled.taken(cover);
    (cost < other).then_some((worst, mean, cost))
}

/// The better of a shape that was tried and another.
fn better(a: Tried, cover: Cover, filled: &Filled) -> Tried {
    measured(&cover, COARSE, filled, a.cost).map_or(a, |(worst, mean, cost)| Tried { cover, worst, mean, cost })
}

/// The best of all kinds around the points along the axes of some frames; `None` without points.
pub(super) fn best(points: &[Vector3<f64>], turns: &[UnitQuaternion<f64>], filled: &Filled) -> Option<Tried> {
    if points.is_empty() {
        return None;
    }
    let all = turns.iter().flat_map(|turn| enclose::all_kinds(points, turn));
    all.fold(None, |best, cover| {
        Some(best.map_or_else(|| tried(cover, COARSE, filled), |best| better(best, cover, filled)))
    })
}

/// The shape moved and turned as long as that improves it.
fn refined(points: &[Vector3<f64>], from: Tried, filled: &Filled) -> Tried {
    let mut best = from;
    for by in TURNS {
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
            for by in THICKER {
                let shape = Shape::Capsule { radius: radius * by, height: 0.0 };
                best = better(best, enclose::around(points, &Cover { shape, ..centered }), filled);
            }
        }
    }
    best
}

/// A part of the mesh.
#[derive(Clone, Debug)]
pub(super) struct Piece {
    /// Its triangles, clipped.
    pub triangles: Vec<Triangle>,
    /// Points spread evenly over them.
    pub samples: Vec<Vector3<f64>>,
    /// Its extreme corners.
    pub extremes: Vec<Vector3<f64>>,
    /// What encloses it.
    pub tried: Tried,
    /// Whether it gave way to others already.
    pub reshaped: bool,
    /// How often in a row what it is part of was parted though the parts held as much of what was claimed.
    pub in_vain: u8,
    /// What of the shape is solid, if not all.
    pub hull: Option<Hull>,
}

impl Piece {
    /// Encloses triangles; `like` is a frame that may suit, besides the link's and that of the principal axes. `None` without
    /// triangles.
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
        // Corners between the extreme ones may stick out a little.
        let corners: Vec<Vector3<f64>> = triangles.iter().flatten().copied().collect();
        let tried = tried(enclose::around(&corners, &fine.cover), MEDIUM, filled);
        Some(Self { triangles, samples, extremes, tried, reshaped: false, in_vain: 0, hull: None })
    }

    /// Both in one.
    pub fn merged(mut self, other: Self, filled: &Filled) -> Option<Self> {
        self.triangles.extend(other.triangles);
        self.samples.extend(other.samples);
        Self::new(self.triangles, self.samples, &other.tried.cover.pose.rotation, filled)
    }
}

/// Where principal axes come from: points spread evenly, if there are enough.
pub(super) fn spread<'a>(samples: &'a [Vector3<f64>], extremes: &'a [Vector3<f64>]) -> &'a [Vector3<f64>] {
    if samples.len() < 12 { extremes } else { samples }
}

/// The points that lie farthest in some of many directions, each once; to and fro along `count` axes.
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

/// By x, then y, then z.
pub(super) fn in_order(a: &Vector3<f64>, b: &Vector3<f64>) -> std::cmp::Ordering {
    a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z))
}

/// Directions spread evenly over half a ball: a spiral.
fn directions(count: usize) -> impl Iterator<Item = Vector3<f64>> {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    (0..count).map(move |i| {
        // The axes first: most parts have faces there.
        if i < 3 {
            return Vector3::ith(i, 1.0);
        }
        let y = (i as f64 - 2.5) / (count - 3) as f64;
        let (sin, cos) = (golden * i as f64).sin_cos();
        let r = (1.0 - y * y).max(0.0).sqrt();
        Vector3::new(r * cos, y, r * sin)
    })
}
