//! What sensing speaks of (paper, sections 1.1 and 3.2): a camera gives frames, a detector finds regions in them, a locator tells where
//! in the world these are.
//!
//! Nothing here is in the pulse: a sensor that falls behind or dies makes objects stale, and holds up nobody.

use crate::{Context, Pose, Refusal, Role, Snapshot, Time};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Duration;

/// How a camera projects: a pinhole without distortion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// Width and height of its pictures, pixels.
    pub size: [u32; 2],
    /// Focal lengths across and down, pixels.
    pub focal: [f64; 2],
    /// Where the optical axis meets the picture, pixels from its upper left corner.
    pub center: [f64; 2],
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
    /// Its middle, pixels from the upper left corner.
    pub center: [f64; 2],
    /// Its width and height, pixels.
    pub size: [f64; 2],
}

/// Gives frames.
pub trait Camera: Send {
    /// The time between two frames.
    fn period(&self) -> Duration;
    /// The frame of now; `None` if there is no new one. Does not wait.
    ///
    /// # Errors
    /// Why there will be none any more, as a sentence; the camera is then made anew.
    fn frame(&mut self, now: Time) -> Result<Option<Frame>, String>;
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

/// Finds regions in frames. Pure: whatever it learns is its own.
pub trait Detector: Send {
    /// What there is to see.
    fn detect(&mut self, frame: &Frame) -> Vec<Region>;
    /// How long that takes by a virtual clock, so that runs in virtual time are equal; a real clock tells by itself.
    fn takes(&self) -> Duration;
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

impl Role for dyn Camera {
    const NAME: &'static str = "camera";
    type Context = Context;
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
