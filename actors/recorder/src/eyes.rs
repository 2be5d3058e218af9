//! Camera images with their detections: an image and a mask in front of each camera, in the camera's frustum if
//! its pose on the robot is known.

use crate::body::entities;
use crate::palette;
use crate::shapes::{quaternion, vec3};
use crate::stream::{EntityStream, Written};
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder};
use mobee_contract::{CameraMount, Intrinsics, SeenMask, SeenPicture};
use mobee_model::Scene;
use nalgebra::{Isometry3, Quaternion, UnitQuaternion, Vector3};
use rerun::datatypes::{ChannelDatatype, ImageFormat, Rgba32};
use rerun::{AnnotationContext, Boxes2D, EncodedImage, Pinhole, Points2D, SegmentationImage, Transform3D};

/// JPEG quality, percent: the images are for display only.
const JPEG_QUALITY: u8 = 80;
/// Distance of an image from its camera, meters: less than to the workspace of the hands.
const IMAGE_DISTANCE_M: f32 = 0.12;
/// Opacity of the mask over the image.
const OPACITY: f32 = 0.5;
/// Change of a camera's pose after which it is written again: meters, and rad (0.05 degrees).
const STEP: [f64; 2] = [1e-4, 1e-3];

/// A camera with at least one image.
pub(crate) struct Eye {
    /// Name of the camera in the run.
    name: String,
    /// Entity of the camera.
    pub(crate) path: String,
    mount: Option<CameraMount>,
    lens: Option<Intrinsics>,
    /// Pose that was written last, `world_from_camera`.
    written: Option<Isometry3<f64>>,
}

impl Eye {
    /// Creates the entity of a camera with this name in the run. A camera on a robot is drawn there.
    pub(crate) fn new(stream: &EntityStream, name: &str, mount: Option<&CameraMount>) -> Result<Eye, String> {
        let below = if mount.is_some() { "world/eyes" } else { "eyes" };
        let path = format!("{below}/{}", entities(name));
        stream.log_static(&path, &AnnotationContext::new(classes()))?;
        Ok(Eye { name: name.to_owned(), path, mount: mount.cloned(), lens: None, written: None })
    }

    /// True if it is the camera of this name.
    pub(crate) fn is(&self, name: &str) -> bool {
        self.name == name
    }

    /// Draws an image, the mask over it, and boxes and centers of the detections.
    ///
    /// # Errors
    /// If Rerun refuses the data, as a message. An image or a mask whose size does not match its data is
    /// skipped.
    pub(crate) fn show(&mut self, stream: &EntityStream, seen: &SeenPicture) -> Written {
        let SeenPicture { frame, regions, mask, mount } = seen;
        // The camera may have been exchanged for one elsewhere on the robot.
        if self.mount.is_some() && mount.is_some() {
            self.mount.clone_from(mount);
        }
        let path = &self.path;
        let [width, height] = frame.intrinsics.size;
        if self.mount.is_some() && self.lens != Some(frame.intrinsics) {
            stream.log(path, &pinhole(&frame.intrinsics))?;
            self.lens = Some(frame.intrinsics);
        }
        let mut jpeg = Vec::new();
        let encoder = JpegEncoder::new_with_quality(&mut jpeg, JPEG_QUALITY);
        if encoder.write_image(&frame.pixels, width, height, ExtendedColorType::Rgb8).is_ok() {
            let picture = EncodedImage::from_file_contents(jpeg).with_media_type("image/jpeg");
            stream.log(&format!("{path}/picture"), &picture)?;
        }
        if let Some(mask) = mask.as_ref().filter(|mask| is_whole(mask)) {
            let format = ImageFormat::segmentation(mask.size, ChannelDatatype::U8);
            let mask = SegmentationImage::new(mask.objects.to_vec(), format).with_opacity(OPACITY);
            stream.log(&format!("{path}/mask"), &mask)?;
        }
        let ends = |i: usize, k: usize| regions.iter().map(move |r| (r.bounds[i] as f32, r.bounds[k] as f32));
        let sizes = ends(2, 3).zip(ends(0, 1)).map(|((right, bottom), (left, top))| (right - left, bottom - top));
        let boxes = Boxes2D::from_mins_and_sizes(ends(0, 1), sizes)
            .with_colors([palette::NEAR])
            .with_labels(regions.iter().map(|r| r.object.clone()));
        stream.log(&format!("{path}/regions"), &boxes)?;
        let centers = regions.iter().map(|r| (r.center[0] as f32, r.center[1] as f32));
        stream.log(&format!("{path}/centers"), &Points2D::new(centers).with_colors([palette::NEAR]).with_radii([2.0]))
    }

    /// Moves the camera with its robot in this configuration.
    ///
    /// # Errors
    /// If Rerun refuses the data, as a message.
    pub(crate) fn carry(&mut self, stream: &EntityStream, scene: &Scene, robot: usize, q: &[f64]) -> Written {
        let Some(mount) = self.mount.as_ref().filter(|mount| mount.robot == robot) else { return Ok(()) };
        let Some(at) = place(mount, scene, q) else { return Ok(()) };
        let [step, turn] = STEP;
        let stays = |old: &Isometry3<f64>| {
            let moved = (old.translation.vector - at.translation.vector).norm();
            moved < step && old.rotation.angle_to(&at.rotation) < turn
        };
        if self.written.as_ref().is_some_and(stays) {
            return Ok(());
        }
        self.written = Some(at);
        let place = Transform3D::from_translation_rotation(vec3(&at.translation.vector), quaternion(&at.rotation));
        stream.log(&self.path, &place)
    }
}

/// Pose of a camera, `world_from_camera`; `None` if the robot or the configuration does not fit the scene.
fn place(mount: &CameraMount, scene: &Scene, q: &[f64]) -> Option<Isometry3<f64>> {
    let robot = scene.robots().get(mount.robot).filter(|r| r.motors.len() == q.len())?;
    let mut frames = Vec::new();
    robot.forward_from(&scene.base(mount.robot), q, &mut frames);
    let [w, x, y, z] = mount.rotation;
    let turn = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-6)?;
    let own = Isometry3::from_parts(Vector3::from(mount.position).into(), turn);
    let at = frames.get(mount.node)? * own;
    at.translation.vector.iter().all(|x| x.is_finite()).then_some(at)
}

/// Frustum of a camera, without lens distortion.
fn pinhole(lens: &Intrinsics) -> Pinhole {
    let [[fx, fy], [cx, cy]] = [lens.focal, lens.center].map(|pair| pair.map(|x| x as f32));
    let [width, height] = lens.size.map(|n| n as f32);
    Pinhole::new([[fx, 0.0, 0.0], [0.0, fy, 0.0], [cx, cy, 1.0]])
        .with_resolution([width, height])
        .with_image_plane_distance(IMAGE_DISTANCE_M)
        .with_color(palette::FRUSTUM)
}

fn is_whole(mask: &SeenMask) -> bool {
    let [width, height] = mask.size.map(|n| usize::try_from(n).unwrap_or(usize::MAX));
    width.checked_mul(height) == Some(mask.objects.len())
}

/// Colors of a mask: none for the background, then one for each of the detector's objects.
fn classes() -> impl Iterator<Item = (u16, &'static str, Rgba32)> {
    let nothing = (0, "", Rgba32(0));
    let objects = (1..=u16::from(u8::MAX)).map(|n| (n, "", Rgba32(palette::trail(usize::from(n)))));
    std::iter::once(nothing).chain(objects)
}
