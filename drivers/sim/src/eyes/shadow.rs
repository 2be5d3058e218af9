//! Shadow map: the view of the lamp, outside of which lies the shadow.

use super::lens::{Rays, TILE, Tile};
use super::sight::{lay, look};
use super::solid::{CameraForm, V3};
use super::surface::Numbers;
use mobee_contract::Intrinsics;
use mobee_model::Shape;
use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Side of the lamp's image, pixels.
const SIDE: u32 = 160;
/// Half the width of the lamp's image at one meter, meters. Beyond it there are no shadows.
const WIDE: f64 = 0.55;
/// Depth tolerance of shadows, meters, because the lamp's pixels are coarse.
const SLACK: f32 = 0.012;
/// Distance in front of the camera at which the lamp aims, meters.
const AHEAD: f64 = 0.45;

/// The lamp's view of the scene in front of a camera.
pub struct Shadows {
    rays: Rays,
    depth: Vec<f32>,
    /// `lamp_from_eye`: the lamp's axes in the camera frame, and the camera's position in the lamp's.
    turn: [V3; 3],
    shift: V3,
    focal: f32,
}

impl Shadows {
    /// Creates an empty shadow map.
    pub fn new() -> Shadows {
        let side = f64::from(SIDE);
        let focal = f64::from(SIDE) / 2.0 / WIDE;
        let lens = Intrinsics { size: [SIDE; 2], focal: [focal; 2], center: [side / 2.0; 2], distortion: [0.0; 4] };
        // a pinhole has a ray for every pixel
        let rays = Rays::new(&lens).unwrap_or(Rays { bands: Vec::new(), size: [0; 2] });
        let depth = vec![f32::INFINITY; rays.size[0] * rays.size[1]];
        Shadows { rays, depth, turn: [V3::zeros(); 3], shift: V3::zeros(), focal: focal as f32 }
    }

    /// Renders shapes from the lamp.
    ///
    /// # Arguments
    /// * `lamp`: position of the lamp in the camera frame.
    /// * `solids`: the shapes with their poses, `eye_from_shape`.
    pub fn light(&mut self, lamp: Vector3<f64>, solids: impl Iterator<Item = (Shape, Isometry3<f64>)>) {
        let z = (Vector3::new(0.0, 0.0, AHEAD) - lamp).normalize();
        let other = if z.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
        let y = z.cross(&other).normalize();
        let axes = [y.cross(&z), y, z];
        let turn = Matrix3::from_rows(&axes.map(|a| a.transpose()));
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(turn));
        let lamp_from_eye = Isometry3::from_parts((-(turn * lamp)).into(), rotation);
        (self.turn, self.shift) = (axes.map(|a| a.cast()), lamp_from_eye.translation.vector.cast());
        let forms: Vec<CameraForm> =
            solids.map(|(shape, pose)| CameraForm::new(&shape, &(lamp_from_eye * pose))).collect();
        let Shadows { rays, depth, .. } = self;
        look(rays, &forms, |seen| lay(seen.corner, seen.depth, depth, rays.size));
    }

    /// Removes the lamp's light from shadows, interpolating the four nearest pixels of its view.
    ///
    /// # Arguments
    /// * `depth`: depth of each pixel of the tile, meters.
    /// * `direct`: cosine of the angle to the lamp; `mirrored`: specular share.
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
            // the footprint of a lamp pixel grows with the angle of incidence
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

    /// Share of light at a position of the lamp's view and this depth.
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
