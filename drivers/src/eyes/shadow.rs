//! What the lamp sees: all else is in the shadow.

use super::lens::Rays;
use super::sight::{lay, look};
use super::solid::{Form, V3};
use mobee_contract::Intrinsics;
use mobee_model::Shape;
use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};

/// The side of the lamp's picture, pixels.
const SIDE: u32 = 192;
/// How wide the lamp looks: half its picture, at one meter, meters. Beyond that there are no shadows.
const WIDE: f64 = 0.55;
/// Surfaces nearer together than this do not shade each other, meters: the lamp's pixels are coarse.
const SLACK: f32 = 0.012;
/// How far before the eye the lamp aims, meters.
const AHEAD: f64 = 0.45;

/// The lamp's view of what is before an eye.
pub struct Shadows {
    rays: Rays,
    depth: Vec<f32>,
    /// `lamp_from_eye`.
    turn: Matrix3<f32>,
    shift: V3,
    focal: f32,
}

impl Shadows {
    /// Nothing is lit yet.
    pub fn new() -> Shadows {
        let (side, focal) = (f64::from(SIDE), f64::from(SIDE) / 2.0 / WIDE);
        let lens = Intrinsics { size: [SIDE; 2], focal: [focal; 2], center: [side / 2.0; 2], distortion: [0.0; 4] };
        // a pinhole sees something in every pixel
        let rays = Rays::new(&lens).unwrap_or(Rays { bands: Vec::new(), size: [0; 2] });
        let depth = vec![f32::INFINITY; rays.size[0] * rays.size[1]];
        Shadows { rays, depth, turn: Matrix3::identity(), shift: V3::zeros(), focal: focal as f32 }
    }

    /// Lights shapes.
    ///
    /// # Arguments
    /// * `lamp`: where it is, in the eye's frame.
    /// * `solids`: the shapes where they are, `eye_from_shape`.
    pub fn light(&mut self, lamp: Vector3<f64>, solids: impl Iterator<Item = (Shape, Isometry3<f64>)>) {
        let z = (Vector3::new(0.0, 0.0, AHEAD) - lamp).normalize();
        let other = if z.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
        let y = z.cross(&other).normalize();
        let turn = Matrix3::from_rows(&[y.cross(&z).transpose(), y.transpose(), z.transpose()]);
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(turn));
        let lamp_from_eye = Isometry3::from_parts((-(turn * lamp)).into(), rotation);
        (self.turn, self.shift) = (turn.cast(), lamp_from_eye.translation.vector.cast());
        let forms: Vec<Form> = solids.map(|(shape, pose)| Form::new(&shape, &(lamp_from_eye * pose))).collect();
        let Shadows { rays, depth, .. } = self;
        look(rays, &forms, |seen| lay(seen.corner, seen.depth, depth, rays.size));
    }

    /// The share of the lamp's light that reaches a place in the eye's frame: the four nearest pixels of its view, mixed.
    #[inline]
    pub fn reaches(&self, at: V3) -> f32 {
        let p = self.turn * at + self.shift;
        let half = SIDE as f32 / 2.0 - 0.5;
        let (u, v) = (p.x / p.z * self.focal + half, p.y / p.z * self.focal + half);
        let most = (SIDE - 1) as f32;
        if !(u >= 0.0 && v >= 0.0 && u < most && v < most) {
            return 1.0;
        }
        let (left, top) = (u as usize, v as usize);
        let (s, t) = (u - left as f32, v - top as f32);
        let lit = |k: usize| if self.depth.get(k).is_none_or(|d| p.z < d + SLACK) { 1.0 } else { 0.0 };
        let first = top * SIDE as usize + left;
        let row = |k: usize| lit(k) * (1.0 - s) + lit(k + 1) * s;
        row(first) * (1.0 - t) + row(first + SIDE as usize) * t
    }
}
