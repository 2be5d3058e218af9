//! What sensing speaks of (paper, sections 1.1 and 3.2): a camera gives frames, a detector finds regions in them, a locator tells where
//! in the world these are.
//!
//! Nothing here is in the pulse: a sensor that falls behind or dies makes objects stale, and holds up nobody.

use crate::{Context, Pose, Refusal, Role, Snapshot, Time};
use mobee_model::{Robot, Scene};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// How a camera projects: a pinhole, and what its lens bends.
///
/// Frames of cameras: z along the optical axis, x to the picture's right, y down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// Width and height of its pictures, pixels.
    pub size: [u32; 2],
    /// Focal lengths across and down, pixels.
    pub focal: [f64; 2],
    /// Where the optical axis meets the picture, pixels from its upper left corner.
    pub center: [f64; 2],
    /// What the lens bends, by the model of Brown and Conrady as OpenCV writes it: k1, k2 (radial), p1, p2 (tangential). All zero: nothing.
    pub distortion: [f64; 4],
}

/// One picture. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Frame {
    /// When it was exposed (the middle of the exposure), not when it arrived.
    pub exposed: Time,
    /// How it was projected.
    pub intrinsics: Intrinsics,
    /// Row by row from the top, three bytes each pixel: red, green, blue.
    pub pixels: Arc<[u8]>,
}

/// Something that a detector found in a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Region {
    /// What it is, by the object's name in the world.
    pub object: String,
    /// The mean place of its pixels, pixels from the upper left corner of the picture; the middle of the first pixel is (0.5, 0.5).
    pub center: [f64; 2],
    /// Left, top, right and bottom of what encloses it, pixels.
    pub bounds: [f64; 4],
    /// Its area, pixels.
    pub area: f64,
    /// Whether it touches the picture's border, so that there may be more of it beyond.
    pub is_clipped: bool,
    /// How sure the detector is, 0 to 1.
    pub confidence: f64,
    /// Where it is before the camera, if its detector can tell that from one picture.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose: Option<SeenPose>,
}

/// Greatest number of regions of one picture, all objects together.
pub const MAX_REGIONS: usize = 256;
/// Greatest number of regions of each object in one picture, unless a sensor says otherwise.
pub const DEFAULT_MAX_REGIONS: usize = 16;
/// Greatest length of an object's name, bytes.
pub const MAX_OBJECT_NAME_BYTES: usize = 128;

/// Keeps the first regions of each object, at most `each`, and [`MAX_REGIONS`] of all; none with a longer name than
/// [`MAX_OBJECT_NAME_BYTES`]. Returns the number of those that were left out.
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
        let (mut counts, mut kept) = (BTreeMap::<String, usize>::new(), 0usize);
        regions.retain(|region| {
            if kept >= MAX_REGIONS {
                return false;
            }
            let count = counts.entry(region.object.clone()).or_default();
            *count += 1;
            kept += usize::from(*count <= each);
            *count <= each
        });
    }
    (all - regions.len()) as u64
}

/// Whether a detector may use this as the name of an object: it stands in every line of the journal that has a region.
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
    /// Whether all its numbers are finite. What is told with others is of no use to anybody.
    pub fn is_finite(&self) -> bool {
        let pose = self.pose.iter();
        let pose = pose.flat_map(|p| p.position.iter().chain(&p.rotation).chain(p.covariance.iter().flatten()));
        let own = [self.area, self.confidence];
        self.center.iter().chain(&self.bounds).chain(&own).chain(pose).all(|n| n.is_finite())
    }
}

/// Where something is before the camera that saw it, in all six degrees of freedom.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SeenPose {
    /// Its middle in the camera's frame, meters.
    pub position: [f64; 3],
    /// How it is turned there (`camera_from_it`): a unit quaternion, w, x, y, z.
    pub rotation: [f64; 4],
    /// How sure that is, row by row: the covariance of the position (meters) and of a small turn about the camera's axes (rad).
    pub covariance: [[f64; 6]; 6],
}

/// Which pixels of a frame a detector took for objects'.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SeenMask {
    /// Width and height, pixels: the frame's.
    pub size: [u32; 2],
    /// Row by row from the top: 0 where nothing is, else the number of the object among the detector's, from 1 on.
    pub objects: Arc<[u8]>,
}

/// Where a camera is fixed on a robot.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraMount {
    /// The robot's index in the scene.
    pub robot: usize,
    /// The node of its model that carries the camera.
    pub node: usize,
    /// Where the camera is in that node's frame (`node_from_camera`), meters.
    pub position: [f64; 3],
    /// How it is turned there: a unit quaternion, w, x, y, z.
    pub rotation: [f64; 4],
}

/// A frame, and what became of it, for people to look at.
#[derive(Clone, Debug)]
pub struct SeenPicture {
    /// What the camera saw.
    pub frame: Frame,
    /// What its detector found.
    pub regions: Arc<[Region]>,
    /// By which pixels, if the detector tells.
    pub mask: Option<SeenMask>,
    /// Where the camera is on its robot, as far as that is known.
    pub mount: Option<CameraMount>,
}

/// Pictures that a camera could not use.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SkippedPictures {
    /// Their number.
    pub count: u64,
    /// What is wrong with the last of them, and the remedy if there is one.
    pub why: String,
}

impl SkippedPictures {
    /// Counts one more.
    pub fn add(skipped: &mut Option<SkippedPictures>, why: String) {
        let count = skipped.as_ref().map_or(0, |s| s.count) + 1;
        *skipped = Some(SkippedPictures { count, why });
    }
}

/// Gives frames.
pub trait Camera: Send {
    /// The time until the next frame, asked after each.
    fn period(&self) -> Duration;
    /// The frame of now; `None` if there is no new one. Does not wait.
    ///
    /// # Errors
    /// Why there will be none any more, as a sentence; the camera is then made anew.
    fn frame(&mut self, now: Time) -> Result<Option<Frame>, String>;
    /// Whether it shows something by a virtual clock: a camera of the world outside doesn't.
    fn runs_in_virtual_time(&self) -> bool {
        true
    }
    /// Whether what it shows is simulated, from [`Truth`]. The objects that its sensor keeps are then moved by scripts in truth alone, and
    /// in the model by the sensor alone.
    fn is_simulated(&self) -> bool {
        false
    }
    /// Pictures that it has skipped since this was last called, and why; `None`: none. A camera skips what it can't use, such as a damaged
    /// picture, and goes on with the next one: only what ends the camera is an error of [`Camera::frame`].
    fn skipped(&mut self) -> Option<SkippedPictures> {
        None
    }
    /// Where it is on its robot, for the recording; `None`: not known. No locator is told.
    fn mount(&self) -> Option<CameraMount> {
        None
    }
}

/// A region, and where and when it was seen.
#[derive(Clone, Debug, PartialEq)]
pub struct Sighting {
    /// The camera that saw it, by its name in the run.
    pub camera: Arc<str>,
    /// How that projects.
    pub intrinsics: Intrinsics,
    /// What it saw.
    pub region: Region,
    /// When the frame was exposed.
    pub at: Time,
}

/// Where a robot's motors were when something was seen.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyState {
    /// When.
    pub at: Time,
    /// The pose, rad.
    pub q: Pose,
}

/// Where an object is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Located {
    /// Its name in the world.
    pub object: String,
    /// Where it is in the world, meters.
    pub position: [f64; 3],
    /// How sure that is: the covariance of the position, square meters, row by row.
    pub covariance: [[f64; 3]; 3],
}

impl Located {
    /// Whether all its numbers are finite.
    pub fn is_finite(&self) -> bool {
        self.position.iter().chain(self.covariance.iter().flatten()).all(|n| n.is_finite())
    }
}

/// What became of an object's place at the world gate, between a locator and the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Admission {
    /// The object is there in the model from now on.
    Moved,
    /// It is there already, as near as makes no difference.
    Agrees,
    /// Too far from where it was seen last: believed once it has been seen there some more times in a row.
    Waits,
    /// Another place in the same frame is nearer to where the object was seen last.
    Other,
    /// Less sure than the gate demands.
    Unsure,
    /// Outside the workspace.
    Outside,
    /// No object that this sensor keeps, or numbers that are none.
    Foreign,
}

/// Finds regions in frames. Pure: whatever it learns is its own.
pub trait Detector: Send {
    /// What there is to see, the surest or greatest first: if there are too many regions, the last ones are left out.
    fn detect(&mut self, frame: &Frame) -> Vec<Region>;
    /// The number of regions of the last frame that it found and left out by itself, since they were too many.
    fn omitted(&self) -> u64 {
        0
    }
    /// Why it can't go on, if it has failed while it looked at the last frame. It is then made again.
    fn failure(&mut self) -> Option<String> {
        None
    }
    /// How long that takes by a virtual clock, so that runs in virtual time are equal; a real clock tells by itself.
    fn takes(&self) -> Duration;
    /// What it can find, by the objects' names in the world, in the order of the mask's numbers; empty: it does not say.
    fn objects(&self) -> Vec<String> {
        Vec::new()
    }
    /// Which pixels of the frame that it looked at last it took for its objects', for the recording; `None`: it goes by no mask.
    fn mask(&self) -> Option<SeenMask> {
        None
    }
    /// What somebody should know of the frame that it looked at last, as a sentence; it says no more than once what stays so.
    fn complaint(&mut self) -> Option<String> {
        None
    }
    /// What it has learned, for a successor; `None`: nothing.
    fn export(&self) -> Option<Snapshot> {
        None
    }
    /// Takes over what a predecessor has learned.
    ///
    /// # Errors
    /// [`Refusal::State`] if that is of another kind or version; the detector is then as before, and begins anew.
    fn import(&mut self, _from: Snapshot) -> Result<(), Refusal> {
        Err(Refusal::State { what: "this detector learns nothing".into() })
    }
}

/// Tells where in the world is what was seen. Pure: whatever it remembers, such as what another camera saw just before, is its own.
pub trait Locator: Send {
    /// Where the things are that one camera saw at one instant, as far as that can be told, with the body as it was then.
    fn locate(&mut self, seen: &[Sighting], body: &BodyState) -> Vec<Located>;
    /// How long that takes by a virtual clock; a real clock tells by itself.
    fn takes(&self) -> Duration {
        Duration::ZERO
    }
    /// What it remembers, for a successor; `None`: nothing.
    fn export(&self) -> Option<Snapshot> {
        None
    }
    /// Takes over what a predecessor remembers.
    ///
    /// # Errors
    /// [`Refusal::State`] if that is of another kind or version; the locator is then as before, and begins anew.
    fn import(&mut self, _from: Snapshot) -> Result<(), Refusal> {
        Err(Refusal::State { what: "this locator remembers nothing".into() })
    }
}

/// What there is in truth, where robots are simulated: what their cameras see. No detector and no locator is told.
#[derive(Clone, Debug)]
pub struct Truth {
    /// The robots and the objects, these where they are, not where the model believes them.
    pub scene: Arc<Scene>,
    /// Where the motors of each robot are, rad, in the scene's order.
    pub poses: Vec<Pose>,
}

/// What is known, beside its settings, when a camera is built.
#[derive(Clone)]
pub struct CameraContext {
    /// The robot that carries it.
    pub robot: Arc<Robot>,
    /// That robot's index in the scene.
    pub index: usize,
    /// Its own seed, derived from the run's.
    pub seed: u64,
    /// The truth of now; `None` if a robot has not been heard of yet, or if it is not simulated.
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
