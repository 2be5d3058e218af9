//! Detector files: what was learned of one object, as JSON with a version.

use super::cgp::{ImageProgram, channels};
use super::color::ColorTable;
use super::features::features;
use super::picture::{Mask, Picture};
use super::pixels::PixelNetwork;
use super::plane::{Plane, brightness, guided};
use super::regions::{Blobs, Cut};
use crate::learned_file::{self, LearnedFault};
use mobee_contract::check_object_name;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What it is a file of.
const NOUN: &str = "detector";
/// The version that is written, and the only one that is read.
pub const DETECTOR_VERSION: u32 = 1;

/// What a detector learns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DetectorKind {
    /// How likely each color is the object's.
    Color,
    /// That, what surrounds each pixel, and an evolved image program.
    Cgp,
}

impl DetectorKind {
    /// What configuration files call it.
    pub fn name(self) -> &'static str {
        match self {
            DetectorKind::Color => "color",
            DetectorKind::Cgp => "cgp",
        }
    }
}

/// A detector, learned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DetectorFile {
    /// What this file is.
    pub format: String,
    /// Version of the layout.
    pub version: u32,
    /// What was learned.
    pub kind: DetectorKind,
    /// The object's name.
    pub object: String,
    /// By what whole factor pictures are made smaller first.
    pub shrink: usize,
    /// How the likelihood is smoothed at last.
    pub smoothing: Smoothing,
    /// How it becomes a mask.
    pub cut: Cut,
    /// The image program; only of the kind `cgp`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub program: Option<ImageProgram>,
    /// What is made of the surroundings of a pixel; only of the kind `cgp`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub network: Option<PixelNetwork>,
    /// What the colors say.
    pub colors: ColorTable,
}

/// Means over windows, or smoothing that stops at the picture's edges.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Smoothing {
    /// Half-width of the windows, pixels of the smaller picture; 0: none.
    pub radius: usize,
    /// Whether it stops at edges of brightness.
    pub at_edges: bool,
}

impl Smoothing {
    /// The plane smoothed, and if so asked, not across edges of the brightness.
    pub fn apply(&self, plane: &Plane, brightness: &Plane) -> Plane {
        match (self.radius, self.at_edges) {
            (0, _) => plane.clone(),
            (r, false) => plane.box_mean(r, r),
            (r, true) => guided(plane, brightness, r, 100.0),
        }
    }
}

impl DetectorFile {
    /// From JSON.
    ///
    /// # Errors
    /// Text that is no such file or not whole, another version, numbers that can't be: nothing of it is taken then.
    pub fn parse(text: &str) -> Result<DetectorFile, LearnedFault> {
        learned_file::parse(text, NOUN, DETECTOR_VERSION, DetectorFile::wrong)
    }

    /// As JSON.
    pub fn text(&self) -> String {
        serde_json::to_string(self).unwrap_or_default() + "\n"
    }

    /// A file with these parts.
    pub fn new(kind: DetectorKind, object: &str, shrink: usize, colors: ColorTable) -> DetectorFile {
        DetectorFile {
            format: learned_file::format_name(NOUN),
            version: DETECTOR_VERSION,
            kind,
            object: object.into(),
            shrink,
            smoothing: Smoothing { radius: 0, at_edges: false },
            cut: Cut { threshold: 128.0, open: false, keep: 0.0 },
            program: None,
            network: None,
            colors,
        }
    }

    fn wrong(&self) -> Option<String> {
        let is_cgp = self.kind == DetectorKind::Cgp;
        if !(1..=64).contains(&self.shrink) || self.smoothing.radius > 64 {
            return Some("`shrink` or `smoothing.radius` is not in its range".into());
        }
        if let Err(why) = check_object_name(&self.object) {
            return Some(format!("`object`: the name {why}"));
        }
        if !self.cut.is_sound() {
            return Some("`cut.threshold` or `cut.keep` is not in its range".into());
        }
        if !self.colors.is_whole() {
            return Some("`colors` has not one entry for each color".into());
        }
        if is_cgp != self.network.is_some() || is_cgp != self.program.is_some() {
            return Some("the kind `cgp` has a `network` and a `program`, and `color` has neither".into());
        }
        if self.network.as_ref().is_some_and(|n| !n.is_whole()) {
            return Some("`network` has missing, too many or non-finite numbers".into());
        }
        self.program.as_ref().and_then(|p| p.wrong().map(|w| format!("`program`: {w}")))
    }

    /// How likely each pixel is the object's, 0 to 255, as large as the picture.
    pub fn likelihood(&self, picture: &Picture) -> Plane {
        let rgb = picture.planes(self.shrink);
        let colors = self.colors.look(picture, self.shrink);
        let plane = match (&self.network, &self.program) {
            (Some(network), Some(program)) => {
                let learned = network.look(&features(&rgb, &colors));
                program.run(&channels(&rgb, &colors, &learned))
            }
            _ => colors,
        };
        let plane = self.smoothing.apply(&plane, &brightness(&rgb));
        plane.grown(self.shrink, picture.width, picture.height)
    }

    /// Where the object is, and in what regions, the weightiest first.
    pub fn look(&self, picture: &Picture) -> (Mask, Blobs) {
        self.cut.apply(&self.likelihood(picture))
    }
}
