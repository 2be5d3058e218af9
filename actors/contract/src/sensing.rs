//! What sensing speaks of (paper, sections 1.1 and 3.2): a camera gives frames, a detector finds regions in them.
//!
//! Nothing here is in the pulse: a sensor that falls behind or dies makes objects stale, and holds up nobody.

use crate::{Context, Role, Time};
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

/// Finds regions in frames. Pure: whatever it learns is its own.
pub trait Detector: Send {
    /// What there is to see.
    fn detect(&mut self, frame: &Frame) -> Vec<Region>;
    /// How long that takes by a virtual clock, so that runs in virtual time are equal; a real clock tells by itself.
    fn takes(&self) -> Duration;
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
