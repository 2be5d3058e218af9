//! Types and traits of sensing (paper, sections 1.1 and 3.2): a camera provides frames, a detector finds regions in
//! them, a locator computes the positions of these in the world.
//!
//! Sensing is not part of the pulse: a sensor that falls behind or dies makes its objects stale, and delays no other
//! component.

use crate::{Context, Pose, Refusal, Role, Snapshot, Time};
use mobee_model::{Robot, Scene};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// Projection of a camera: a pinhole with lens distortion.
///
/// Camera frames: z along the optical axis, x to the right of the image, y down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// Width and height of its images, pixels.
    pub size: [u32; 2],
    /// Horizontal and vertical focal length, pixels.
    pub focal: [f64; 2],
    /// Principal point, pixels from the upper left corner of the image.
    pub center: [f64; 2],
    /// Lens distortion by the model of Brown and Conrady, in OpenCV's notation: k1, k2 (radial), p1, p2 (tangential).
    /// All zero: none.
    pub distortion: [f64; 4],
}

/// Image of one exposure. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Time of the middle of the exposure, not of the arrival.
    pub exposed: Time,
    /// Projection of the camera.
    pub intrinsics: Intrinsics,
    /// Pixels row by row from the top, three bytes each: red, green, blue.
    pub pixels: Arc<[u8]>,
}

/// Region of a frame in which a detector found an object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Region {
    /// Name of the object in the world.
    pub object: String,
    /// Mean of its pixels, pixels from the upper left corner of the image; the center of the first pixel is (0.5,
    /// 0.5).
    pub center: [f64; 2],
    /// Bounding box: left, top, right and bottom, pixels.
    pub bounds: [f64; 4],
    /// Area, pixels.
    pub area: f64,
    /// True if it touches the image's border, so that a part of it may be outside.
    pub is_clipped: bool,
    /// Confidence of the detector, 0 to 1.
    pub confidence: f64,
    /// Pose relative to the camera, if the detector can estimate it from one image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose: Option<SeenPose>,
}

/// Greatest number of regions of one image, all objects together.
pub const MAX_REGIONS: usize = 256;
/// Default for the greatest number of regions of each object in one image.
pub const DEFAULT_MAX_REGIONS: usize = 16;
/// Greatest length of an object's name, bytes.
pub const MAX_OBJECT_NAME_BYTES: usize = 128;

/// Reduces the regions to the first `each` of each object, and to [`MAX_REGIONS`] in total; removes regions with a
/// longer name than [`MAX_OBJECT_NAME_BYTES`]. Returns the number of removed regions.
///
/// # Examples
/// ```
/// # use mobee_contract::{Region, limit_regions};
/// # let region = |object: &str| Region {
/// #     object: object.into(), center: [0.5; 2], bounds: [0.0, 0.0, 1.0, 1.0], area: 1.0, is_clipped: false, confidence: 1.0, pose: None,
/// # };
/// let mut regions = vec![region("cup"), region("cup"), region("jar"), region("cup")];
/// assert_eq!(limit_regions(&mut regions, 2), 1);
/// assert_eq!(regions, [region("cup"), region("cup"), region("jar")]);
/// ```
pub fn limit_regions(regions: &mut Vec<Region>, each: usize) -> u64 {
    let all = regions.len();
    regions.retain(|region| region.object.len() <= MAX_OBJECT_NAME_BYTES);
    if regions.len() > each.min(MAX_REGIONS) {
        let mut counts = BTreeMap::<String, usize>::new();
        let mut retained = 0usize;
        regions.retain(|region| {
            if retained >= MAX_REGIONS {
                return false;
            }
            let count = counts.entry(region.object.clone()).or_default();
            *count += 1;
            retained += usize::from(*count <= each);
            *count <= each
        });
    }
    (all - regions.len()) as u64
}

/// Checks whether a detector may use this as the name of an object: it is part of every journal line with a region.
///
/// # Errors
/// The problem, as the end of a sentence that begins with "the object's name".
pub fn check_object_name(name: &str) -> Result<(), String> {
    if name.is_empty() {
        return Err("is empty".into());
    }
    if name.len() > MAX_OBJECT_NAME_BYTES {
        return Err(format!("has {} bytes, more than {MAX_OBJECT_NAME_BYTES}", name.len()));
    }
    if name.chars().any(char::is_control) {
        return Err(format!("{name:?} contains control characters"));
    }
    Ok(())
}

impl Region {
    /// Returns whether all its numbers are finite. Regions with other numbers are useless.
    pub fn is_finite(&self) -> bool {
        let pose = self.pose.iter();
        let pose = pose.flat_map(|p| p.position.iter().chain(&p.rotation).chain(p.covariance.iter().flatten()));
        let own = [self.area, self.confidence];
        self.center.iter().chain(&self.bounds).chain(&own).chain(pose).all(|n| n.is_finite())
    }
}

/// Pose of an object relative to the camera that observed it, in all six degrees of freedom.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SeenPose {
    /// Center in the camera's frame, meters.
    pub position: [f64; 3],
    /// Rotation (`camera_from_object`): a unit quaternion, w, x, y, z.
    pub rotation: [f64; 4],
    /// Covariance, row by row: of the position (meters) and of a small rotation about the camera's axes (rad).
    pub covariance: [[f64; 6]; 6],
}

/// Pixels of a frame that a detector assigned to objects.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SeenMask {
    /// Width and height, pixels: those of the frame.
    pub size: [u32; 2],
    /// Row by row from the top: 0 for no object, else the number of the object among the detector's, from 1 on.
    pub objects: Arc<[u8]>,
}

/// Pose of a camera that is fixed on a robot.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraMount {
    /// Index of the robot in the scene.
    pub robot: usize,
    /// Node of the robot model that carries the camera.
    pub node: usize,
    /// Position in that node's frame (`node_from_camera`), meters.
    pub position: [f64; 3],
    /// Rotation in that node's frame: a unit quaternion, w, x, y, z.
    pub rotation: [f64; 4],
}

/// A frame with its detections, for people to look at.
#[derive(Clone, Debug)]
pub struct SeenPicture {
    /// Frame of the camera.
    pub frame: Frame,
    /// Regions found by its detector.
    pub regions: Arc<[Region]>,
    /// Pixels of these regions, if the detector provides them.
    pub mask: Option<SeenMask>,
    /// Pose of the camera on its robot, if known.
    pub mount: Option<CameraMount>,
}

/// Images that a camera could not use.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SkippedPictures {
    /// Number of images.
    pub count: u64,
    /// Problem of the last of them, with the remedy if there is one.
    pub why: String,
}

impl SkippedPictures {
    /// Counts one more image.
    pub fn add(skipped: &mut Option<SkippedPictures>, why: String) {
        let count = skipped.as_ref().map_or(0, |s| s.count) + 1;
        *skipped = Some(SkippedPictures { count, why });
    }
}

/// Source of frames.
pub trait Camera: Send {
    /// Time until the next frame; called after each.
    fn period(&self) -> Duration;
    /// Present frame; `None` if there is no new one. Does not wait.
    ///
    /// # Errors
    /// The reason why there will be no further frames, as a sentence; the camera is then built again.
    fn frame(&mut self, now: Time) -> Result<Option<Frame>, String>;
    /// Returns whether it provides frames under a virtual clock: a camera of the real world does not.
    fn runs_in_virtual_time(&self) -> bool {
        true
    }
    /// Returns whether its images are simulated, from [`Truth`]. Scripts then move the objects that its sensor tracks
    /// in the ground truth only, and the sensor alone moves them in the model.
    fn is_simulated(&self) -> bool {
        false
    }
    /// Images that it has skipped since the last call, and the reason; `None`: none. A camera skips an unusable
    /// image, such as a damaged one, and goes on with the next: [`Camera::frame`] returns an error only if the camera
    /// ends.
    fn skipped(&mut self) -> Option<SkippedPictures> {
        None
    }
    /// Pose on its robot, for the recording; `None`: unknown. No locator receives it.
    fn mount(&self) -> Option<CameraMount> {
        None
    }
}

/// Region with its camera and time.
#[derive(Clone, Debug, PartialEq)]
pub struct Sighting {
    /// Name of the camera in the run.
    pub camera: Arc<str>,
    /// Projection of the camera.
    pub intrinsics: Intrinsics,
    /// Region found.
    pub region: Region,
    /// Exposure time of the frame.
    pub at: Time,
}

/// Configuration of a robot at the time of an observation.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyState {
    /// Time of the observation.
    pub at: Time,
    /// Configuration, rad.
    pub q: Pose,
}

/// Position of an object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Located {
    /// Name of the object in the world.
    pub object: String,
    /// Position in the world, meters.
    pub position: [f64; 3],
    /// Covariance of the position, square meters, row by row.
    pub covariance: [[f64; 3]; 3],
}

impl Located {
    /// Returns whether all its numbers are finite.
    pub fn is_finite(&self) -> bool {
        self.position.iter().chain(self.covariance.iter().flatten()).all(|n| n.is_finite())
    }
}

/// Decision of the world gate, between a locator and the model, on the position of an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Admission {
    /// The object is moved there in the model.
    Moved,
    /// The object is there already, within the least update.
    Agrees,
    /// Too far from its last observed position: accepted after some more consecutive observations there.
    Waits,
    /// Another position from the same frame is closer to the object's last observed position.
    Other,
    /// Less certain than the gate requires.
    Unsure,
    /// Outside the workspace.
    Outside,
    /// Not an object that this sensor tracks, or numbers that are not finite.
    Foreign,
}

/// Finds regions in frames. Pure: its state is its own.
pub trait Detector: Send {
    /// Returns the regions of a frame, the most confident or largest first: if there are too many, the last ones are
    /// omitted.
    fn detect(&mut self, frame: &Frame) -> Vec<Region>;
    /// Number of regions of the last frame that the detector itself omitted, since there were too many.
    fn omitted(&self) -> u64 {
        0
    }
    /// Reason why it cannot go on, if it failed on the last frame. It is then built again.
    fn failure(&mut self) -> Option<String> {
        None
    }
    /// Duration of a detection by a virtual clock, so that runs in virtual time are reproducible; unused with a real
    /// clock.
    fn takes(&self) -> Duration;
    /// Names of the objects that it can find, in the order of the mask's numbers; empty: unknown.
    fn objects(&self) -> Vec<String> {
        Vec::new()
    }
    /// Pixels of the last frame that it assigned to objects, for the recording; `None`: it uses no mask.
    fn mask(&self) -> Option<SeenMask> {
        None
    }
    /// Warning about the last frame, as a sentence; a lasting problem is reported once.
    fn complaint(&mut self) -> Option<String> {
        None
    }
    /// Exports what it has learned, for a successor; `None`: nothing.
    fn export(&self) -> Option<Snapshot> {
        None
    }
    /// Imports what a predecessor has learned.
    ///
    /// # Errors
    /// [`Refusal::State`] if the state is of another kind or version; the detector is then unchanged, and starts
    /// without it.
    fn import(&mut self, _from: Snapshot) -> Result<(), Refusal> {
        Err(Refusal::State { what: "this detector learns nothing".into() })
    }
}

/// Computes positions in the world. Pure: its state, such as earlier observations of another camera, is its own.
pub trait Locator: Send {
    /// Returns the positions of the objects that one camera observed at one instant, as far as possible; `body`: the
    /// robot at that instant.
    fn locate(&mut self, seen: &[Sighting], body: &BodyState) -> Vec<Located>;
    /// Duration of a call by a virtual clock; unused with a real clock.
    fn takes(&self) -> Duration {
        Duration::ZERO
    }
    /// Exports its memory, for a successor; `None`: nothing.
    fn export(&self) -> Option<Snapshot> {
        None
    }
    /// Imports the memory of a predecessor.
    ///
    /// # Errors
    /// [`Refusal::State`] if the state is of another kind or version; the locator is then unchanged, and starts
    /// without it.
    fn import(&mut self, _from: Snapshot) -> Result<(), Refusal> {
        Err(Refusal::State { what: "this locator remembers nothing".into() })
    }
}

/// Ground truth of simulated robots: the world that their cameras show. No detector and no locator receives it.
#[derive(Clone, Debug)]
pub struct Truth {
    /// Robots and objects; the objects at their true positions, not at those in the model.
    pub scene: Arc<Scene>,
    /// Configurations of the robots, rad, in the scene's order.
    pub poses: Vec<Pose>,
}

/// Data available, in addition to the settings, when a camera is built.
#[derive(Clone)]
pub struct CameraContext {
    /// Robot that carries it.
    pub robot: Arc<Robot>,
    /// Index of that robot in the scene.
    pub index: usize,
    /// Seed of its own, derived from the run's.
    pub seed: u64,
    /// Present ground truth; `None` if a robot has not sent a reading yet, or is not simulated.
    pub truth: Arc<dyn Fn() -> Option<Truth> + Send + Sync>,
}

impl Role for dyn Camera {
    const NAME: &'static str = "camera";
    type Context = CameraContext;
    type Built = Box<dyn Camera>;
}

impl Role for dyn Detector {
    const NAME: &'static str = "detector";
    type Context = Context;
    type Built = Box<dyn Detector>;
}

impl Role for dyn Locator {
    const NAME: &'static str = "locator";
    type Context = Context;
    type Built = Box<dyn Locator>;
}
