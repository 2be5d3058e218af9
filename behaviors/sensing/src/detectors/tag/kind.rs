//! The detector kind `tag`.

use super::family::TagFamilyName;
use super::pose::pose_of_square;
use super::seek::{SeenTag, TagSeeker};
use crate::detectors::picture::Picture;
use crate::locators::lens::Lens;
use mobee_contract::*;
use schemars::JsonSchema;
use serde::Deserialize;
use serde_json::{Value, json};
use std::time::Duration;

/// Settings of the kind `tag`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TagDetectorSettings {
    /// Family of the tags.
    #[serde(default)]
    pub family: TagFamilyName,
    /// Edge of the black border, m.
    pub size_m: f64,
    /// Objects of the tags. Other tags are ignored.
    pub tags: Vec<TagSettings>,
    /// Maximum number of bits of a tag that may be misread, 0 to 2.
    #[serde(default = "errors")]
    #[schemars(extend("expert" = true))]
    pub errors: u8,
    /// Minimum decision margin of the bits of a tag, 0 to 255.
    #[serde(default = "margin")]
    #[schemars(extend("expert" = true))]
    pub margin: f64,
}

/// A tag on an object.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TagSettings {
    /// Number of the tag in its family.
    pub id: u16,
    /// Name of the object in the world.
    pub object: String,
    /// Edge of its black border, m; default: `size_m` of the detector.
    #[serde(default)]
    pub size_m: Option<f64>,
}

fn errors() -> u8 {
    1
}
fn margin() -> f64 {
    20.0
}

/// Range of sizes of tags, meters.
const SIZES_M: std::ops::RangeInclusive<f64> = 0.001..=10.0;
/// Decision margin of a tag with full confidence.
const FULL_CONFIDENCE_MARGIN: f64 = 100.0;

/// Finds the tags of its settings.
pub struct TagDetector {
    settings: TagDetectorSettings,
    seeker: TagSeeker,
}

impl TagDetector {
    /// Creates a detector from its settings.
    ///
    /// # Errors
    /// Invalid settings, each with a remedy.
    pub fn new(settings: TagDetectorSettings) -> Result<TagDetector, KindError> {
        let wrong = |path: &str, what: String, help: &str| Err(KindError::new(path, what, help));
        let mut checks = Vec::new();
        let mut size = |path: String, size: f64| {
            if !SIZES_M.contains(&size) {
                let help = "give the edge of the black border in meters, such as 0.06";
                checks.push(wrong(&path, format!("{size} m is not a valid size of a tag"), help));
            }
        };
        size("size_m".into(), settings.size_m);
        for (k, own) in settings.tags.iter().enumerate().filter_map(|(k, t)| t.size_m.map(|s| (k, s))) {
            size(format!("tags[{k}].size_m"), own);
        }
        if settings.tags.is_empty() {
            let help = "give the objects of the tags: tags = [{ id = 7, object = \"cup\" }]";
            checks.push(wrong("tags", "without a tag there is nothing to find".into(), help));
        }
        let family = settings.family.name();
        let count = settings.family.count();
        for (k, tag) in settings.tags.iter().enumerate() {
            if tag.id >= count {
                let what = format!("the family {family} has no tag {}", tag.id);
                checks.push(wrong(&format!("tags[{k}].id"), what, &format!("give a number from 0 to {}", count - 1)));
            }
            if settings.tags.iter().take(k).any(|other| other.id == tag.id) {
                let what = format!("tag {} is on two objects", tag.id);
                checks.push(wrong(&format!("tags[{k}].id"), what, "print another tag for one of them"));
            }
        }
        if settings.errors > 2 {
            let what = format!("with {} wrong bits, a tag can be confused with another one", settings.errors);
            checks.push(wrong("errors", what, "give 0, 1 or 2"));
        }
        if !(0.0..=255.0).contains(&settings.margin) {
            checks.push(wrong(
                "margin",
                format!("{} is not a valid margin", settings.margin),
                "give a number from 0 to 255",
            ));
        }
        KindError::gather::<()>(checks)?;
        let seeker = TagSeeker::new(settings.family);
        Ok(TagDetector { settings, seeker })
    }

    fn region(&self, seen: &SeenTag, frame: &Frame) -> Option<Region> {
        let tag = self.settings.tags.iter().find(|t| t.id == seen.id)?;
        if seen.errors > self.settings.errors || seen.margin < self.settings.margin {
            return None;
        }
        let [xs, ys] = [0, 1].map(|i| seen.corners.map(|c| c[i]));
        let least = |of: [f64; 4]| of.into_iter().fold(f64::MAX, f64::min);
        let most = |of: [f64; 4]| of.into_iter().fold(f64::MIN, f64::max);
        let size = tag.size_m.unwrap_or(self.settings.size_m);
        let doubt = 1.0 - 0.25 * f64::from(seen.errors);
        Some(Region {
            object: tag.object.clone(),
            center: seen.center,
            bounds: [least(xs), least(ys), most(xs), most(ys)],
            area: area(&seen.corners),
            // A tag that the image border cuts has fewer than four corners and is not found.
            is_clipped: false,
            confidence: (seen.margin / FULL_CONFIDENCE_MARGIN).clamp(0.0, 1.0) * doubt,
            pose: pose_of_square(&seen.corners, size, &Lens::from(frame.intrinsics)),
        })
    }
}

/// Returns the area of a quadrilateral, square pixels.
fn area([a, b, c, d]: &[[f64; 2]; 4]) -> f64 {
    ((c[0] - a[0]) * (d[1] - b[1]) - (c[1] - a[1]) * (d[0] - b[0])).abs() / 2.0
}

impl Detector for TagDetector {
    fn detect(&mut self, frame: &Frame) -> Vec<Region> {
        let Some(picture) = Picture::of(frame) else { return Vec::new() };
        let seen = self.seeker.seek(&picture);
        seen.iter().filter_map(|tag| self.region(tag, frame)).collect()
    }

    fn objects(&self) -> Vec<String> {
        self.settings.tags.iter().map(|t| t.object.clone()).collect()
    }

    fn takes(&self) -> Duration {
        Duration::from_millis(10)
    }
}

inventory::submit! {
    Registered(&Kind::<dyn Detector> {
        name: "tag",
        doc: "Finds objects by the AprilTags on them, and estimates the pose of each tag in the camera \
              frame, in all six degrees of freedom. `mobee detector tag` draws tags for a printer.",
        schema: || schemars::schema_for!(TagDetectorSettings),
        example: |_| Ok(json!({ "size_m": 0.06, "tags": [{ "id": 7, "object": "cup" }] })),
        build: |value: &Value, _| Ok(Box::new(TagDetector::new(settings(value)?)?)),
    })
}
