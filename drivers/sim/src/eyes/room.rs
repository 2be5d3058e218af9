//! Room around the scene: the inner side of a box, with a texture on each wall.

use super::lens::TILE;
use super::scenery::Scenery;
use super::solid::V3;
use super::surface::Run;
use super::texture::Texture;
use nalgebra::{Isometry3, Vector3};

/// Side of a wall's texture, meters: the height of a low room.
const WALL: f32 = 2.2;

/// The room in the camera frame.
pub struct Room<'a> {
    walls: &'a [Texture; 6],
    /// Position of the camera relative to the robot's base.
    eye: V3,
    /// Axes of the room in the camera frame.
    axes: [V3; 3],
    low: V3,
    high: V3,
}

impl<'a> Room<'a> {
    /// Room of a scenery, around a robot's base in the world.
    pub fn new(scenery: &'a Scenery, base: Vector3<f64>, world_from_eye: &Isometry3<f64>) -> Room<'a> {
        let [width, depth, height] = scenery.settings.room_m;
        // the floor's height is relative to the world, not to the robot
        let floor = scenery.settings.floor_m - base.z;
        let back = world_from_eye.rotation.inverse();
        Room {
            walls: &scenery.walls,
            eye: (world_from_eye.translation.vector - base).cast(),
            axes: [Vector3::x(), Vector3::y(), Vector3::z()].map(|a| (back * a).cast()),
            low: Vector3::new(-width / 2.0, -depth / 2.0, floor).cast(),
            high: Vector3::new(width / 2.0, depth / 2.0, floor + height).cast(),
        }
    }

    /// Renders the room in all of these pixels.
    pub fn fill(&self, run: &mut Run) {
        run.gloss.fill(0.0);
        let (mut us, mut vs, mut walls) = ([0.0f32; TILE], [0.0f32; TILE], [0u32; TILE]);
        let [a, b, c] = self.axes;
        let eye = self.eye;
        let low = self.low;
        let high = self.high;
        let rays = run.x.iter().zip(run.y);
        let normals = run.nx.iter_mut().zip(run.ny.iter_mut().zip(run.nz.iter_mut()));
        let places = us.iter_mut().zip(vs.iter_mut().zip(&mut walls));
        for (((x, y), t), ((nx, (ny, nz)), (u, (v, wall)))) in rays.zip(run.depth.iter_mut()).zip(normals.zip(places)) {
            let along = |axis: V3| axis.x * x + axis.y * y + axis.z;
            let (dx, dy, dz) = (along(a), along(b), along(c));
            let way = |d: f32, o: f32, low: f32, high: f32| (if d > 0.0 { high - o } else { low - o }) / d;
            let tx = way(dx, eye.x, low.x, high.x);
            let ty = way(dy, eye.y, low.y, high.y);
            let tz = way(dz, eye.z, low.z, high.z);
            let near = tx.min(ty).min(tz).max(0.0);
            let level = tz <= tx.min(ty);
            let across = tx <= ty;
            let (px, py, pz) = (eye.x + dx * near, eye.y + dy * near, eye.z + dz * near);
            let (d, axis) = if across { (dx, a) } else { (dy, b) };
            let (d, axis) = if level { (dz, c) } else { (d, axis) };
            let side = -1f32.copysign(d);
            (*nx, *ny, *nz) = (axis.x * side, axis.y * side, axis.z * side);
            *t = near;
            // textures of walls are upright
            *u = if across & !level { py } else { px };
            *v = if level { py } else { high.z - pz };
            *wall = if across { 0 } else { 2 };
            *wall = if level { 4 } else { *wall } + u32::from(d > 0.0);
        }
        let colors = run.red.iter_mut().zip(run.green.iter_mut().zip(run.blue.iter_mut()));
        for ((r, (g, b)), ((u, v), wall)) in colors.zip(us.iter().zip(&vs).zip(&walls)) {
            let Some(wall) = self.walls.get(*wall as usize) else { continue };
            let scale = wall.side() * (1.0 / WALL);
            [*r, *g, *b] = wall.at(u * scale, v * scale);
        }
    }
}
