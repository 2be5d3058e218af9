//! Shapes in the camera frame, with their bounds in the image and their intersections with rays.

use super::lens::{NOTHING, TILE, Tile, TileBounds, union};
use mobee_model::Shape;
use nalgebra::{Isometry3, Vector3};

/// Near plane, meters.
pub const NEAR_PLANE_M: f32 = 0.01;

/// Point or direction in the camera frame, or in a shape's own.
pub type V3 = Vector3<f32>;

/// A shape in the camera frame, meters.
#[derive(Clone, Copy, Debug)]
pub enum CameraForm {
    /// A ball.
    Ball {
        /// Its center.
        center: V3,
        /// Its radius.
        radius: f32,
    },
    /// A cylinder with round ends, or with flat ones.
    Rod(Rod),
    /// A box.
    Box {
        /// Its own axes.
        axes: [V3; 3],
        /// Position of the camera in the box's frame.
        eye: V3,
        /// Half of its edge lengths.
        half: V3,
    },
}

/// Common data of capsules and cylinders.
#[derive(Clone, Copy, Debug)]
pub struct Rod {
    /// Its center.
    pub center: V3,
    /// Unit direction of its axis.
    pub axis: V3,
    /// Cross product of center and axis.
    moment: V3,
    /// Half its length along the axis, without round ends.
    pub half: f32,
    /// Its radius.
    pub radius: f32,
    /// True if its ends are hemispheres.
    pub round: bool,
}

impl CameraForm {
    /// Transforms a shape by its pose, `eye_from_shape`.
    pub fn new(shape: &Shape, pose: &Isometry3<f64>) -> CameraForm {
        let center = pose.translation.vector;
        let rod = |radius: f64, height: f64, round| {
            let axis = pose.rotation * Vector3::y();
            let moment = center.cross(&axis).cast();
            let half = (height / 2.0) as f32;
            let radius = radius as f32;
            CameraForm::Rod(Rod { center: center.cast(), axis: axis.cast(), moment, half, radius, round })
        };
        match *shape {
            Shape::Sphere { radius } => CameraForm::Ball { center: center.cast(), radius: radius as f32 },
            Shape::Capsule { radius, height } => rod(radius, height, true),
            Shape::Cylinder { radius, height } => rod(radius, height, false),
            Shape::Box { size } => {
                let axes = [Vector3::x(), Vector3::y(), Vector3::z()].map(|a| (pose.rotation * a).cast());
                let eye = (pose.rotation.inverse() * -center).cast();
                CameraForm::Box { axes, eye, half: (size / 2.0).cast() }
            }
        }
    }

    /// Bounds in the image; [`NOTHING`] if all of it is behind the camera.
    pub fn bounds(&self) -> TileBounds {
        match *self {
            CameraForm::Ball { center, radius } => ball_bounds(center, radius)
                .unwrap_or_else(|| corners_bounds(center, [V3::x(), V3::y(), V3::z()], V3::repeat(radius))),
            CameraForm::Rod(Rod { center, axis, half, radius, round, .. }) => {
                let ends = [center + axis * half, center - axis * half].map(|c| ball_bounds(c, radius));
                if let (true, [Some(a), Some(b)]) = (round, ends) {
                    return union(a, b);
                }
                // box around the rod, with any rotation about its axis
                let other = if axis.x.abs() < 0.7 { V3::x() } else { V3::y() };
                let side = axis.cross(&other).normalize();
                let length = if round { half + radius } else { half };
                corners_bounds(center, [side, axis, side.cross(&axis)], V3::new(radius, length, radius))
            }
            CameraForm::Box { axes, eye, half } => {
                corners_bounds(-(axes[0] * eye.x + axes[1] * eye.y + axes[2] * eye.z), axes, half)
            }
        }
    }

    /// Intersects each ray of a tile with the shape. Where the shape is nearer than earlier ones, sets
    /// `depth` (along the optical axis, meters) and `owner`. A shape that contains the camera is not hit.
    pub fn cast(&self, tile: &Tile, number: u32, depth: &mut [f32; TILE], owner: &mut [u32; TILE]) {
        match *self {
            CameraForm::Ball { center, radius } => each(tile, number, depth, owner, |x, y| {
                let (disc, t) = enter_ball(x, y, center, radius);
                if disc > 0.0 { t } else { f32::INFINITY }
            }),
            CameraForm::Rod(rod) if rod.round => each(tile, number, depth, owner, |x, y| rod.enter_round(x, y)),
            CameraForm::Rod(rod) => each(tile, number, depth, owner, |x, y| rod.enter_flat(x, y)),
            CameraForm::Box { axes, eye, half } => each(tile, number, depth, owner, |x, y| {
                let slab = |axis: V3, eye: f32, half: f32| {
                    let inverse = 1.0 / (axis.x * x + axis.y * y + axis.z);
                    let middle = -eye * inverse;
                    let reach = half * inverse.abs();
                    (middle - reach, middle + reach)
                };
                let (a, d) = slab(axes[0], eye.x, half.x);
                let (b, e) = slab(axes[1], eye.y, half.y);
                let (c, f) = slab(axes[2], eye.z, half.z);
                let enters = a.max(b).max(c);
                let leaves = d.min(e).min(f);
                if enters < leaves { enters } else { f32::INFINITY }
            }),
        }
    }
}

/// One loop for all shapes, instantiated for each, so that `enter` is vectorized.
#[inline(always)]
fn each(tile: &Tile, number: u32, depth: &mut [f32; TILE], owner: &mut [u32; TILE], enter: impl Fn(f32, f32) -> f32) {
    for ((x, y), (d, o)) in tile.x.iter().zip(&tile.y).zip(depth.iter_mut().zip(owner)) {
        let t = enter(*x, *y);
        // uses masks, because branches prevent vectorization
        let met = u32::from(t > NEAR_PLANE_M && t < *d).wrapping_neg();
        *d = f32::from_bits(t.to_bits() & met | d.to_bits() & !met);
        *o = number & met | *o & !met;
    }
}

/// Discriminant (positive for a hit), and depth at which the ray `(x, y, 1)` enters a ball.
#[inline(always)]
fn enter_ball(x: f32, y: f32, c: V3, radius: f32) -> (f32, f32) {
    // r^2 d.d - |d x c|^2: the usual (d.c)^2 - d.d (c.c - r^2) loses small balls far away
    let a = x * x + y * y + 1.0;
    let m = V3::new(y * c.z - c.y, c.x - x * c.z, x * c.y - y * c.x);
    let disc = radius * radius * a - (m.x * m.x + m.y * m.y + m.z * m.z);
    (disc, (x * c.x + y * c.y + c.z - disc.max(0.0).sqrt()) / a)
}

impl Rod {
    /// Discriminant of the infinite cylinder, depth at which a ray enters it, and position along the axis.
    #[inline(always)]
    fn enter_endless(&self, x: f32, y: f32) -> (f32, f32, f32) {
        let (c, u, m) = (self.center, self.axis, self.moment);
        let along = x * u.x + y * u.y + u.z;
        let middle = c.x * u.x + c.y * u.y + c.z * u.z;
        let a = (x * x + y * y + 1.0 - along * along).max(1e-9);
        let b = x * c.x + y * c.y + c.z - along * middle;
        let s = x * m.x + y * m.y + m.z;
        let disc = self.radius * self.radius * a - s * s;
        let t = (b - disc.max(0.0).sqrt()) / a;
        (disc, t, t * along - middle)
    }

    #[inline(always)]
    fn enter_round(&self, x: f32, y: f32) -> f32 {
        let (disc, t, at) = self.enter_endless(x, y);
        let end = if at < 0.0 { -self.half } else { self.half };
        let (c, u) = (self.center, self.axis);
        let center = V3::new(c.x + end * u.x, c.y + end * u.y, c.z + end * u.z);
        let (end_disc, end_t) = enter_ball(x, y, center, self.radius);
        let body = at.abs() <= self.half;
        let met = (disc > 0.0) & (body | (end_disc > 0.0));
        let t = if body { t } else { end_t };
        if met { t } else { f32::INFINITY }
    }

    #[inline(always)]
    fn enter_flat(&self, x: f32, y: f32) -> f32 {
        let (disc, t, at) = self.enter_endless(x, y);
        let end = if at < 0.0 { -self.half } else { self.half };
        let (c, u) = (self.center, self.axis);
        let end_t = (c.x * u.x + c.y * u.y + c.z * u.z + end) / (x * u.x + y * u.y + u.z);
        let (px, py, pz) = (end_t * x - c.x, end_t * y - c.y, end_t - c.z);
        let on_end = px * px + py * py + pz * pz - self.half * self.half < self.radius * self.radius;
        let body = at.abs() <= self.half;
        let met = (disc > 0.0) & (body | on_end);
        let t = if body { t } else { end_t };
        if met { t } else { f32::INFINITY }
    }
}

/// Bounds of a ball; `None` if part of it is behind the camera.
fn ball_bounds(c: V3, r: f32) -> Option<TileBounds> {
    if c.z - r < NEAR_PLANE_M {
        return None;
    }
    // the two tangents from the camera to a circle, in the plane of one axis and z
    let tangents = |x: f32| {
        let s = (x * x + c.z * c.z - r * r).max(0.0).sqrt();
        ((x * s - c.z * r) / (c.z * s + x * r), (x * s + c.z * r) / (c.z * s - x * r))
    };
    let ((left, right), (top, bottom)) = (tangents(c.x), tangents(c.y));
    // slightly enlarged for single precision
    Some([left - 1e-4, right + 1e-4, top - 1e-4, bottom + 1e-4])
}

fn corners_bounds(center: V3, axes: [V3; 3], half: V3) -> TileBounds {
    let corner = |k: u8| {
        let side = |i: u8| if k >> i & 1 == 1 { 1.0 } else { -1.0 };
        center + axes[0] * (side(0) * half.x) + axes[1] * (side(1) * half.y) + axes[2] * (side(2) * half.z)
    };
    let mut bounds = NOTHING;
    let mut seen = |p: V3| {
        let (x, y) = (p.x / p.z, p.y / p.z);
        bounds = union(bounds, [x - 1e-4, x + 1e-4, y - 1e-4, y + 1e-4]);
    };
    for k in 0..8 {
        let from = corner(k);
        if from.z > NEAR_PLANE_M {
            seen(from);
        }
        // edges through the near plane are cut there
        for to in [k ^ 1, k ^ 2, k ^ 4].into_iter().filter(|to| *to > k).map(corner) {
            if (from.z > NEAR_PLANE_M) != (to.z > NEAR_PLANE_M) {
                let cut = from + (to - from) * ((NEAR_PLANE_M - from.z) / (to.z - from.z));
                seen(V3::new(cut.x, cut.y, NEAR_PLANE_M));
            }
        }
    }
    bounds
}
