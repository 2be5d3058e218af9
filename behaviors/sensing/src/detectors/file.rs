//! Detector files: the trained model for one object, as JSON with a version.

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

/// Noun for this kind of file in messages.
const FILE_NOUN: &str = "detector";
/// Version that is written, and the only one that is read.
pub const DETECTOR_VERSION: u32 = 1;

/// Model that a detector is trained as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DetectorKind {
    /// The likelihood of each color.
    Color,
    /// Color likelihood, the surroundings of each pixel, and an evolved image program.
    Cgp,
}

impl DetectorKind {
    /// Name in configuration files.
    pub fn name(self) -> &'static str {
        match self {
            DetectorKind::Color => "color",
            DetectorKind::Cgp => "cgp",
        }
    }
}

/// A trained detector.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DetectorFile {
    /// Name of the file format.
    pub format: String,
    /// Version of the file format.
    pub version: u32,
    /// Model of the detector.
    pub kind: DetectorKind,
    /// Name of the object.
    pub object: String,
    /// Integer factor by which images are shrunk first.
    pub shrink: usize,
    /// Smoothing of the likelihood.
    pub smoothing: Smoothing,
    /// Conversion of the likelihood to a mask.
    pub cut: Cut,
    /// Image program; only for the kind `cgp`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub program: Option<ImageProgram>,
    /// Network on the surroundings of a pixel; only for the kind `cgp`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub network: Option<PixelNetwork>,
    /// Color likelihood.
    pub colors: ColorTable,
}

/// Smoothing by means over windows, or by a filter that preserves edges.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Smoothing {
    /// Half-width of the windows, pixels of the shrunk image; 0: no smoothing.
    pub radius: usize,
    /// Preserve edges of the brightness.
    pub at_edges: bool,
}

impl Smoothing {
    /// Smooths a plane; with `at_edges`, not across edges of the brightness.
    pub fn apply(&self, plane: &Plane, brightness: &Plane) -> Plane {
        match (self.radius, self.at_edges) {
            (0, _) => plane.clone(),
            (r, false) => plane.box_mean(r, r),
            (r, true) => guided(plane, brightness, r, 100.0),
        }
    }
}

impl DetectorFile {
    /// Reads a detector from JSON.
    ///
    /// # Errors
    /// Text of another format, an incomplete file, another version, or values out of range.
    pub fn parse(text: &str) -> Result<DetectorFile, LearnedFault> {
        learned_file::parse(text, FILE_NOUN, DETECTOR_VERSION, DetectorFile::wrong)
    }

    /// Writes the detector as JSON.
    pub fn text(&self) -> String {
        serde_json::to_string(self).unwrap_or_default() + "\n"
    }

    /// Creates a detector without smoothing, program and network.
    pub fn new(kind: DetectorKind, object: &str, shrink: usize, colors: ColorTable) -> DetectorFile {
        DetectorFile {
            format: learned_file::format_name(FILE_NOUN),
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

    /// Computes the likelihood of each pixel, 0 to 255, at the size of the image.
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

    /// Detects the object: its mask and its regions, by decreasing weight.
    pub fn look(&self, picture: &Picture) -> (Mask, Blobs) {
        self.cut.apply(&self.likelihood(picture))
    }
}
