//! What the lamp sees: all else is in the shadow.

use super::lens::{Rays, TILE, Tile};
use super::sight::{lay, look};
use super::solid::{Form, V3};
use super::surface::Numbers;
use mobee_contract::Intrinsics;
use mobee_model::Shape;
use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};

/// The side of the lamp's picture, pixels.
const SIDE: u32 = 160;
/// How wide the lamp looks: half its picture, at one meter, meters. Beyond that there are no shadows.
const WIDE: f64 = 0.55;
/// TileSurfaces nearer together than this do not shade each other, meters: the lamp's pixels are coarse.
const SLACK: f32 = 0.012;
/// How far before the eye the lamp aims, meters.
const AHEAD: f64 = 0.45;

/// The lamp's view of what is before an eye.
pub struct Shadows {
    rays: Rays,
    depth: Vec<f32>,
    /// `lamp_from_eye`: the lamp's axes in the eye's frame, and the eye in the lamp's.
    turn: [V3; 3],
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
        Shadows { rays, depth, turn: [V3::zeros(); 3], shift: V3::zeros(), focal: focal as f32 }
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
        let axes = [y.cross(&z), y, z];
        let turn = Matrix3::from_rows(&axes.map(|a| a.transpose()));
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(turn));
        let lamp_from_eye = Isometry3::from_parts((-(turn * lamp)).into(), rotation);
        (self.turn, self.shift) = (axes.map(|a| a.cast()), lamp_from_eye.translation.vector.cast());
        let forms: Vec<Form> = solids.map(|(shape, pose)| Form::new(&shape, &(lamp_from_eye * pose))).collect();
        let Shadows { rays, depth, .. } = self;
        look(rays, &forms, |seen| lay(seen.corner, seen.depth, depth, rays.size));
    }

    /// Takes the lamp's light from what is in the shadow: the four nearest pixels of its view, mixed.
    ///
    /// # Arguments
    /// * `depth`: of what each pixel of the tile sees, meters.
    /// * `direct`: the cosine of the lamp's direction, and `mirrored`, what is mirrored of it.
    pub fn fall(&self, tile: &Tile, depth: &Numbers, direct: &mut Numbers, mirrored: &mut Numbers) {
        let (mut us, mut vs, mut far) = ([0.0f32; TILE], [0.0f32; TILE], [0.0f32; TILE]);
        let ([a, b, c], shift, focal) = (self.turn, self.shift, self.focal);
        let half = SIDE as f32 / 2.0 - 0.5;
        let at = tile.x.iter().zip(&tile.y).zip(depth.iter().zip(direct.iter()));
        for (((x, y), (t, cosine)), ((u, v), z)) in at.zip(us.iter_mut().zip(&mut vs).zip(&mut far)) {
            let along = |axis: V3, shift: f32| (axis.x * x + axis.y * y + axis.z) * t + shift;
            let away = along(c, shift.z);
            let scale = focal / away;
            *u = along(a, shift.x) * scale + half;
            *v = along(b, shift.y) * scale + half;
            // a pixel of the lamp is the longer on a surface, the more that is turned away
            *z = away - SLACK * (0.5 + 0.5 / cosine.max(0.1));
        }
        let most = (SIDE - 1) as f32;
        let light = direct.iter_mut().zip(mirrored);
        for ((direct, mirrored), ((u, v), z)) in light.zip(us.iter().zip(&vs).zip(&far)) {
            if *direct > 0.0 && *u >= 0.0 && *v >= 0.0 && *u < most && *v < most {
                let reaches = self.reaches(*u, *v, *z);
                *direct *= reaches;
                *mirrored *= reaches;
            }
        }
    }

    /// The share of light at a place of the lamp's view, so far away.
    #[inline(always)]
    fn reaches(&self, u: f32, v: f32, far: f32) -> f32 {
        let (left, top) = (u as u32, v as u32);
        let (s, t) = (u - left as f32, v - top as f32);
        let first = (top * SIDE + left) as usize;
        let row = |k: usize| match self.depth.get(k..k + 2) {
            Some([a, b]) => {
                let lit = |d: f32| if far < d { 1.0 } else { 0.0 };
                lit(*a) * (1.0 - s) + lit(*b) * s
            }
            _ => 1.0,
        };
        row(first) * (1.0 - t) + row(first + SIDE as usize) * t
    }
}
