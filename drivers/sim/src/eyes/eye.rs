//! A simulated camera, which renders the ground truth at one moment.

use super::film::{Film, Planes};
use super::lens::Rays;
use super::light::{Light, lamp_in_eye};
use super::mount::Mount;
use super::room::Room;
use super::scenery::{Scenery, ScenerySettings};
use super::settings::SimulatedCameraSettings;
use super::shadow::Shadows;
use super::sight::{TileSight, lay, look};
use super::solid::{CameraForm, V3};
use super::sticker;
use super::surface::{Materials, Paint, TileSurfaces};
use mobee_contract::{CameraMount, Frame, Intrinsics, KindError, Time, Truth};
use mobee_model::{ObjectClass, Robot, Shape};
use nalgebra::{Isometry3, Vector3};
use std::time::Duration;

/// Owner of the surface that a pixel shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Owner {
    /// The room.
    Room,
    /// An object of the scenery only.
    Scenery,
    /// The robot of this index in the scene.
    Robot(u16),
    /// The object of this id.
    Object(u32),
}

/// An image with the ground truth of its pixels, row by row; for tests and training, not for perception.
#[derive(Clone, Debug)]
pub struct Shot {
    /// The image.
    pub frame: Frame,
    /// Depth along the optical axis, meters; infinite for the room.
    pub depth: Vec<f32>,
    /// Owner of each pixel.
    pub owner: Vec<Owner>,
    /// `world_from_eye`; the camera frame has x to the right of the image, y down, z forward.
    pub eye: Isometry3<f64>,
}

/// A visible shape: its pose in the camera frame, its paint, and its owner.
struct VisibleSolid {
    shape: Shape,
    pose: Isometry3<f64>,
    paint: Paint,
    owner: Owner,
}

/// A camera on a simulated robot.
pub struct SimulatedEye {
    lens: Intrinsics,
    rays: Rays,
    mount: Mount,
    /// Index of its robot in the scene.
    robot: usize,
    scenery: Scenery,
    film: Film,
    exposure: Duration,
    work: Work,
}

/// Buffers that are reused for each image.
struct Work {
    shadows: Shadows,
    planes: Planes,
    spare: Vec<f32>,
    depth: Vec<f32>,
    owner: Vec<Owner>,
}

/// Paint of robots whose file gives no color.
const ROBOT: [f32; 3] = [190.0, 190.0, 196.0];
/// Share of the lamp that colored objects reflect.
const GLOSS: f32 = 0.25;
/// Color of objects without one.
const PLAIN: [u8; 3] = [150, 150, 150];
/// Color of the cards that carry stickers.
const PAPER: [f32; 3] = [235.0, 235.0, 235.0];
/// Boxes with at least two edges of this length are textured, meters.
const TABLE: f64 = 0.3;

impl SimulatedEye {
    /// Creates a camera on a robot.
    ///
    /// # Arguments
    /// * `index`: index of the robot in the scenes to be rendered.
    /// * `seed`: seed of the sensor noise; the scenery has its own.
    ///
    /// # Errors
    /// Invalid settings.
    pub fn new(
        settings: &SimulatedCameraSettings,
        robot: &Robot,
        index: usize,
        seed: u64,
    ) -> Result<SimulatedEye, KindError> {
        settings.validate()?;
        let mount = Mount::new(robot, &settings.marker, settings.offset_m, settings.rotation_deg)?;
        let lens = settings.intrinsics()?;
        let rays = Rays::new(&lens).map_err(|[u, v]| {
            let what = format!("a lens with this distortion shows nothing at pixel {u}, {v}");
            KindError::new("lens.distortion", what, "give what a calibration found for pictures of this size")
        })?;
        let scenery = Scenery::new(&settings.scenery).map_err(|e| e.under("scenery"))?;
        let film = Film::new(settings.film(), rays.size, seed);
        let exposure = Duration::try_from_secs_f64(settings.exposure_ms * 1e-3).unwrap_or_default();
        let pixels = rays.size[0] * rays.size[1];
        let plane = || vec![0.0; pixels];
        let work = Work {
            shadows: Shadows::new(),
            planes: [plane(), plane(), plane()],
            spare: Vec::new(),
            depth: plane(),
            owner: vec![Owner::Room; pixels],
        };
        Ok(SimulatedEye { lens, rays, mount, robot: index, scenery, film, exposure, work })
    }

    /// Projection of the camera.
    pub fn intrinsics(&self) -> Intrinsics {
        self.lens
    }

    /// Mount on its robot.
    pub fn mount(&self) -> CameraMount {
        self.mount.to_contract(self.robot)
    }

    /// Replaces the scenery.
    ///
    /// # Errors
    /// Invalid settings; the scenery is unchanged then.
    pub fn furnish(&mut self, scenery: &ScenerySettings) -> Result<(), KindError> {
        self.scenery = Scenery::new(scenery)?;
        Ok(())
    }

    /// `world_from_eye` for the robot's configuration in the truth; `None` if the truth does not contain that
    /// robot.
    pub fn at(&self, truth: &Truth) -> Option<Isometry3<f64>> {
        let robot = truth.scene.robots().get(self.robot)?;
        let mut frames = Vec::new();
        robot.forward_from(&truth.scene.base(self.robot), truth.poses.get(self.robot)?, &mut frames);
        self.mount.at(&frames)
    }

    /// Renders an image with its ground truth.
    ///
    /// # Arguments
    /// * `before`: an earlier pose (`world_from_eye`) and its time: rotation since then blurs the image.
    ///
    /// # Errors
    /// As [`SimulatedEye::frame`].
    pub fn shoot(&mut self, truth: &Truth, before: Option<(Isometry3<f64>, Time)>, now: Time) -> Result<Shot, String> {
        let (frame, eye) = self.expose(truth, before, now, true)?;
        Ok(Shot { frame, depth: self.work.depth.clone(), owner: self.work.owner.clone(), eye })
    }

    /// Renders an image; returns it with the pose of the camera, `world_from_eye`.
    ///
    /// # Errors
    /// The truth does not contain its robot, or an object that the scenery's distractors refer to.
    pub fn frame(
        &mut self,
        truth: &Truth,
        before: Option<(Isometry3<f64>, Time)>,
        now: Time,
    ) -> Result<(Frame, Isometry3<f64>), String> {
        self.expose(truth, before, now, false)
    }

    fn expose(
        &mut self,
        truth: &Truth,
        before: Option<(Isometry3<f64>, Time)>,
        now: Time,
        tells: bool,
    ) -> Result<(Frame, Isometry3<f64>), String> {
        let eye = self.at(truth).ok_or("the robot that carries this camera is not in the world that it looks at")?;
        let solids = self.solids(truth, &eye)?;
        let base = truth.scene.base(self.robot).translation.vector;
        let Work { shadows, planes, depth, owner, .. } = &mut self.work;
        let shadows = self.scenery.settings.shadows.then(|| {
            let shapes = solids.iter().map(|s| (s.shape, s.pose));
            shadows.light(lamp_in_eye(&self.scenery, base, &eye), shapes);
            &*shadows
        });
        let light = Light::new(&self.scenery, shadows, base, &eye);
        let forms: Vec<CameraForm> = solids.iter().map(|s| CameraForm::new(&s.shape, &s.pose)).collect();
        let size = self.rays.size;
        let room = Room::new(&self.scenery, base, &eye);
        let materials = Materials {
            wood: (&self.scenery.wood, self.scenery.wood_scale),
            stickers: &self.scenery.stickers,
            pitch: self.lens.focal.map(|f| (1.0 / f) as f32),
        };
        let mut surfaces = TileSurfaces::new();
        look(&self.rays, &forms, |seen| {
            see(&seen, &forms, &solids, materials, &room, &mut surfaces);
            light.fall(seen.tile, &mut surfaces);
            let laid = planes.iter_mut().zip(&surfaces.color);
            laid.for_each(|(plane, color)| lay(seen.corner, color, plane, size));
            if tells {
                lay(seen.corner, seen.depth, depth, size);
                let whose = |k: u32| solids.get(k as usize).map_or(Owner::Room, |s| s.owner);
                lay(seen.corner, &seen.solid.map(whose), owner, size);
            }
        });
        let moved = before.map_or([0.0; 2], |(then, at)| self.drift(&then, &eye, now.since(at)));
        let Work { planes, spare, .. } = &mut self.work;
        let pixels = self.film.develop(planes, spare, now.secs(), now.0, moved);
        Ok((Frame { exposed: now, intrinsics: self.lens, pixels: pixels.into() }, eye))
    }

    /// All visible solids. Omits the housing of the camera, and ghosts, which are shown to people only.
    fn solids(&self, truth: &Truth, eye: &Isometry3<f64>) -> Result<Vec<VisibleSolid>, String> {
        let scene = &truth.scene;
        let eye_from_world = eye.inverse();
        let mut solids = Vec::new();
        let mut frames = Vec::new();
        for (r, (robot, q)) in scene.robots().iter().zip(&truth.poses).enumerate() {
            robot.forward_from(&(eye_from_world * scene.base(r)), q, &mut frames);
            for (n, (node, frame)) in robot.nodes.iter().zip(&frames).enumerate() {
                for (s, primitive) in node.solids.iter().enumerate() {
                    if r == self.robot && self.mount.is_housed_in(n, s) {
                        continue;
                    }
                    // parts of a robot differ slightly in paint
                    let tone = 0.86 + 0.04 * ((n * 7 + s * 3) % 8) as f32;
                    let (color, gloss) = match node.color {
                        Some(own) => (V3::from(own.map(f32::from)), GLOSS),
                        None => (V3::from(ROBOT) * tone, 0.15),
                    };
                    let paint = Paint { color, wood: false, gloss, stickers: [None; 6] };
                    let owner = Owner::Robot(u16::try_from(r).unwrap_or(u16::MAX));
                    solids.push(VisibleSolid { shape: primitive.shape, pose: frame * primitive.pose, paint, owner });
                }
            }
        }
        for (id, object) in scene.objects().filter(|(_, o)| o.class != ObjectClass::Ghost) {
            let color = V3::from(object.color.unwrap_or(PLAIN).map(f32::from));
            let mut stickers = sticker::on(&self.scenery.stickers, &object.name);
            for primitive in &object.shapes {
                let wood = is_table(&primitive.shape);
                let is_box = matches!(primitive.shape, Shape::Box { .. });
                // the first box gets the stickers
                let stickers = if is_box { std::mem::take(&mut stickers) } else { [None; 6] };
                let paint = Paint { color, wood, gloss: if wood { 0.0 } else { GLOSS }, stickers };
                let pose = eye_from_world * object.pose * primitive.pose;
                solids.push(VisibleSolid { shape: primitive.shape, pose, paint, owner: Owner::Object(id) });
            }
            if !object.shapes.iter().any(|p| matches!(p.shape, Shape::Box { .. })) {
                let cards = sticker::cards(&self.scenery.stickers, object);
                solids.extend(cards.map(|(shape, pose, stickers)| {
                    let paint = Paint { color: V3::from(PAPER), wood: false, gloss: 0.0, stickers };
                    VisibleSolid { shape, pose: eye_from_world * object.pose * pose, paint, owner: Owner::Object(id) }
                }));
            }
        }
        if let Some(distractors) = &self.scenery.settings.distractors {
            let missing = |name| format!("the world has no object {name}, which the scenery's distractors name");
            for d in distractors.stand(scene, self.scenery.settings.seed).map_err(missing)? {
                let paint = Paint { color: d.color, wood: false, gloss: GLOSS, stickers: [None; 6] };
                let pose = eye_from_world * d.shape.pose;
                solids.push(VisibleSolid { shape: d.shape.shape, pose, paint, owner: Owner::Scenery });
            }
        }
        Ok(solids)
    }

    /// Motion of the image's center while the shutter is open, pixels right and down, if the camera continues
    /// to rotate as it did since `then`.
    fn drift(&self, then: &Isometry3<f64>, now: &Isometry3<f64>, since: Duration) -> [f32; 2] {
        let seconds = since.as_secs_f64();
        if seconds <= 0.0 {
            return [0.0; 2];
        }
        // present direction of the earlier axis
        let turned = now.rotation.inverse() * (then.rotation * Vector3::z());
        let share = self.exposure.as_secs_f64() / seconds;
        let [fx, fy] = self.lens.focal;
        let way = |d: f64, f: f64| (d / turned.z.max(0.1) * f * share).clamp(-MOST_BLUR, MOST_BLUR) as f32;
        [way(turned.x, fx), way(turned.y, fy)]
    }
}

/// Longest blur, pixels.
const MOST_BLUR: f64 = 60.0;

fn is_table(shape: &Shape) -> bool {
    match shape {
        Shape::Box { size } => size.iter().filter(|edge| **edge >= TABLE).count() >= 2,
        _ => false,
    }
}

/// Renders the unlit surfaces of a tile, in runs of pixels that show the same solid.
fn see(
    seen: &TileSight,
    forms: &[CameraForm],
    solids: &[VisibleSolid],
    materials: Materials,
    room: &Room,
    surfaces: &mut TileSurfaces,
) {
    surfaces.depth = *seen.depth;
    let mut first = 0;
    for same in seen.solid.chunk_by(|a, b| a == b) {
        let mut run = surfaces.run(seen.tile, first, same.len());
        let known = same.first().map(|k| *k as usize).and_then(|k| forms.get(k).zip(solids.get(k)));
        match known {
            Some((form, solid)) => run.see(form, &solid.paint, materials),
            None => room.fill(&mut run),
        }
        first += same.len();
    }
}
