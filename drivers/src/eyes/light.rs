//! What color light makes of what a pixel sees.

use super::scenery::Scenery;
use super::shadow::Shadows;
use super::solid::{Form, V3};
use nalgebra::{Isometry3, Matrix3, Vector3};

/// What a shape looks like.
#[derive(Clone, Copy, Debug)]
pub struct Paint {
    /// Its color, 0 to 255.
    pub color: V3,
    /// Whether it has the texture of wood, as tables have.
    pub wood: bool,
    /// How much of the lamp it mirrors, 0 to 1.
    pub gloss: f32,
}

/// The light of one moment, as an eye sees it.
pub struct Light<'a> {
    scenery: &'a Scenery,
    shadows: Option<&'a Shadows>,
    /// In the eye's frame.
    lamp: V3,
    /// The world's up, in the eye's frame.
    up: V3,
    /// `room_from_eye`, and where the eye is in the room.
    turn: Matrix3<f32>,
    eye: V3,
    /// The least and the greatest corner of the room.
    room: [V3; 2],
    /// The lamp in the room.
    room_lamp: V3,
}

impl<'a> Light<'a> {
    /// The light of a scenery.
    ///
    /// # Arguments
    /// * `base`: where the robot's base is in the world: the middle of the room.
    /// * `world_from_eye`: where the eye is.
    pub fn new(
        scenery: &'a Scenery,
        shadows: Option<&'a Shadows>,
        base: Vector3<f64>,
        world_from_eye: &Isometry3<f64>,
    ) -> Light<'a> {
        let turn = world_from_eye.rotation.to_rotation_matrix();
        let [width, depth, height] = scenery.settings.room_m;
        // the floor is where the world says, not where the robot stands
        let floor = scenery.settings.floor_m - base.z;
        let low = Vector3::new(-width / 2.0, -depth / 2.0, floor);
        let high = Vector3::new(width / 2.0, depth / 2.0, floor + height);
        Light {
            shadows,
            lamp: lamp_in_eye(scenery, base, world_from_eye).cast(),
            up: (turn.inverse() * Vector3::z()).cast(),
            turn: turn.matrix().cast(),
            eye: (world_from_eye.translation.vector - base).cast(),
            room: [low.cast(), high.cast()],
            room_lamp: Vector3::from(scenery.lamp).cast(),
            scenery,
        }
    }

    /// The color of a shape's point at depth `t` along the ray `(x, y, 1)`.
    #[inline]
    pub fn of_shape(&self, form: &Form, paint: &Paint, x: f32, y: f32, t: f32) -> V3 {
        let at = V3::new(x * t, y * t, t);
        let (normal, face) = form.normal(at);
        let mut color = paint.color;
        if paint.wood
            && let Some((own, across)) = face
        {
            let [u, v] = match across {
                0 => [own.y, own.z],
                1 => [own.x, own.z],
                _ => [own.x, own.y],
            };
            let scale = self.scenery.wood_scale;
            color.component_mul_assign(&(self.scenery.wood.at(u * scale, v * scale) / 128.0));
        }
        let away = self.lamp - at;
        let toward = away / away.norm();
        let cosine = normal.dot(&toward);
        let [lamp, around] = self.scenery.light;
        // a little less of it from below
        let mut light = around * (0.8 + 0.2 * normal.dot(&self.up));
        if cosine > 0.0 {
            let reaches = self.shadows.map_or(1.0, |s| s.reaches(at));
            light += lamp * (cosine * reaches);
            if paint.gloss > 0.0 {
                let half = toward - at / at.norm();
                let mirrored = normal.dot(&half).max(0.0) / half.norm();
                let sharp = mirrored.powi(2).powi(2).powi(2).powi(2).powi(2);
                return color.component_mul(&light) + lamp * (255.0 * paint.gloss * sharp * reaches);
            }
        }
        color.component_mul(&light)
    }

    /// The color of the room along the ray `(x, y, 1)`.
    #[inline]
    pub fn of_room(&self, x: f32, y: f32) -> V3 {
        let ray = V3::new(x, y, 1.0);
        let d = self.turn * ray;
        let [low, high] = self.room;
        let way = |d: f32, o: f32, low: f32, high: f32| (if d > 0.0 { high - o } else { low - o }) / d;
        let (tx, ty, tz) = (
            way(d.x, self.eye.x, low.x, high.x),
            way(d.y, self.eye.y, low.y, high.y),
            way(d.z, self.eye.z, low.z, high.z),
        );
        let t = tx.min(ty).min(tz).max(0.0);
        let at = self.eye + d * t;
        let [x0, x1, y0, y1, z0, z1] = &self.scenery.walls;
        // on walls, up is up
        let (wall, u, v, across) = if tz <= tx && tz <= ty {
            (if d.z > 0.0 { z1 } else { z0 }, at.x, at.y, self.room_lamp.z - at.z)
        } else if tx <= ty {
            (if d.x > 0.0 { x1 } else { x0 }, at.y, high.z - at.z, self.room_lamp.x - at.x)
        } else {
            (if d.y > 0.0 { y1 } else { y0 }, at.x, high.z - at.z, self.room_lamp.y - at.y)
        };
        let scale = wall.side() / WALL;
        let cosine = across.abs() / (self.room_lamp - at).norm();
        let is_floor = tz <= tx && tz <= ty && d.z < 0.0;
        let reaches = if is_floor { self.shadows.map_or(1.0, |s| s.reaches(ray * t)) } else { 1.0 };
        let [lamp, around] = self.scenery.light;
        wall.at(u * scale, v * scale).component_mul(&(around + lamp * (cosine * reaches)))
    }
}

/// The side of a wall's texture, meters: the height of a low room.
const WALL: f32 = 2.2;

/// Where the lamp is in the eye's frame.
pub fn lamp_in_eye(scenery: &Scenery, base: Vector3<f64>, world_from_eye: &Isometry3<f64>) -> Vector3<f64> {
    let world = base + Vector3::from(scenery.lamp);
    world_from_eye.inverse_transform_point(&world.into()).coords
}
