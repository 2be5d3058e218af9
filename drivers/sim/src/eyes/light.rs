//! Lighting of surfaces: light of a lamp, except in shadows, and ambient light.

use super::lens::{TILE, Tile};
use super::scenery::Scenery;
use super::shadow::Shadows;
use super::solid::V3;
use super::surface::TileSurfaces;
use nalgebra::{Isometry3, Vector3};

/// Light of one moment, in the camera frame.
pub struct Light<'a> {
    /// Color and strength of the lamp, and of the ambient light.
    strength: [V3; 2],
    shadows: Option<&'a Shadows>,
    /// Position of the lamp in the camera frame.
    lamp: V3,
    /// The world's up in the camera frame.
    up: V3,
}

impl<'a> Light<'a> {
    /// Light of a scenery with a robot's base in its center.
    pub fn new(
        scenery: &'a Scenery,
        shadows: Option<&'a Shadows>,
        base: Vector3<f64>,
        world_from_eye: &Isometry3<f64>,
    ) -> Light<'a> {
        Light {
            strength: scenery.light,
            shadows,
            lamp: lamp_in_eye(scenery, base, world_from_eye).cast(),
            up: (world_from_eye.rotation.inverse() * Vector3::z()).cast(),
        }
    }

    /// Converts the surface colors of a tile to the light that reaches the camera.
    pub fn fall(&self, tile: &Tile, surfaces: &mut TileSurfaces) {
        // cosine of the angle to the lamp, specular share, and ambient share
        let (mut direct, mut mirrored, mut around) = ([0.0f32; TILE], [0.0f32; TILE], [0.0f32; TILE]);
        let TileSurfaces { depth, normal: [nx, ny, nz], color, gloss } = surfaces;
        let lamp = self.lamp;
        let up = self.up;
        let at = tile.x.iter().zip(&tile.y).zip(depth.iter());
        let facing = nx.iter().zip(ny.iter()).zip(nz.iter());
        let outputs = direct.iter_mut().zip(&mut mirrored).zip(&mut around);
        for ((((x, y), t), ((nx, ny), nz)), ((direct, mirrored), around)) in at.zip(facing).zip(outputs) {
            let (px, py, pz) = (x * t, y * t, *t);
            let (lx, ly, lz) = (lamp.x - px, lamp.y - py, lamp.z - pz);
            let scale = 1.0 / (lx * lx + ly * ly + lz * lz).sqrt();
            let (lx, ly, lz) = (lx * scale, ly * scale, lz * scale);
            *direct = (nx * lx + ny * ly + nz * lz).max(0.0);
            // slightly less ambient light from below
            *around = 0.8 + 0.2 * (nx * up.x + ny * up.y + nz * up.z);
            // halfway vector between lamp and camera (Blinn)
            let back = 1.0 / (x * x + y * y + 1.0).sqrt();
            let (hx, hy, hz) = (lx - x * back, ly - y * back, lz - back);
            let cosine2 = (nx * hx + ny * hy + nz * hz).max(0.0).powi(2) / (hx * hx + hy * hy + hz * hz);
            *mirrored = cosine2.powi(2).powi(2).powi(2).powi(2);
        }
        if let Some(shadows) = self.shadows {
            shadows.fall(tile, depth, &mut direct, &mut mirrored);
        }
        let [lamp, everywhere] = self.strength;
        let channels = [(lamp.x, everywhere.x), (lamp.y, everywhere.y), (lamp.z, everywhere.z)];
        for (plane, (lamp, everywhere)) in color.iter_mut().zip(channels) {
            let lights = direct.iter().zip(&around).zip(mirrored.iter().zip(gloss.iter()));
            for (c, ((direct, around), (mirrored, gloss))) in plane.iter_mut().zip(lights) {
                *c = *c * (lamp * direct + everywhere * around) + 255.0 * lamp * gloss * mirrored;
            }
        }
    }
}

/// Position of the lamp in the camera frame.
pub fn lamp_in_eye(scenery: &Scenery, base: Vector3<f64>, world_from_eye: &Isometry3<f64>) -> Vector3<f64> {
    let world = base + Vector3::from(scenery.lamp);
    world_from_eye.inverse_transform_point(&world.into()).coords
}
