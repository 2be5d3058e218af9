//! The kinds of trained detectors, created from a detector file.

use super::file::{DetectorFile, DetectorKind};
use super::picture::Picture;
use mobee_contract::*;
use mobee_model::file::{MIB, read_text};
use schemars::JsonSchema;
use serde::Deserialize;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::time::Duration;

/// Settings of the kinds `color` and `cgp`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LearnedDetectorSettings {
    /// Detector file, as `mobee detector train` wrote it.
    #[schemars(extend("format" = "path"))]
    pub file: PathBuf,
    /// Name of the object in the world; default: the name that it was trained with.
    #[serde(default)]
    pub object: Option<String>,
}

/// Finds the one object that it was trained for.
pub struct LearnedDetector {
    file: DetectorFile,
    /// Mask of the last frame.
    mask: Option<SeenMask>,
    /// Number of regions of the last frame beyond the maximum.
    omitted: u64,
}

impl LearnedDetector {
    /// Creates a detector from its file.
    pub fn new(file: DetectorFile) -> LearnedDetector {
        LearnedDetector { file, mask: None, omitted: 0 }
    }
}

impl Detector for LearnedDetector {
    fn detect(&mut self, frame: &Frame) -> Vec<Region> {
        let Some(picture) = Picture::of(frame) else { return Vec::new() };
        let (mask, blobs) = self.file.look(&picture);
        let objects = mask.data.iter().map(|inside| u8::from(*inside)).collect();
        self.mask = Some(SeenMask { size: frame.intrinsics.size, objects });
        self.omitted = blobs.omitted;
        blobs.kept.iter().map(|blob| blob.region(&self.file.object)).collect()
    }

    fn omitted(&self) -> u64 {
        self.omitted
    }

    fn objects(&self) -> Vec<String> {
        vec![self.file.object.clone()]
    }

    fn mask(&self) -> Option<SeenMask> {
        self.mask.clone()
    }

    fn takes(&self) -> Duration {
        match self.file.kind {
            DetectorKind::Color => Duration::from_millis(5),
            DetectorKind::Cgp => Duration::from_millis(30),
        }
    }
}

fn build(value: &Value, kind: DetectorKind) -> Result<Box<dyn Detector>, KindError> {
    let settings: LearnedDetectorSettings = settings(value)?;
    let at = settings.file.display();
    let text = read_text(&settings.file, 64 * MIB).map_err(|e| {
        KindError::new("file", format!("can't read {at}: {e}"), "give a file of `mobee detector train`")
    })?;
    let mut file =
        DetectorFile::parse(&text).map_err(|e| KindError::new("file", format!("{at}: {}", e.what), e.help))?;
    if file.kind != kind {
        let help = "name the kind that it was trained as, or train it again with --kind";
        return Err(KindError::new("file", format!("{at} is a detector of another kind"), help));
    }
    file.object = settings.object.unwrap_or(file.object);
    Ok(Box::new(LearnedDetector::new(file)))
}

inventory::submit! {
    Registered(&Kind::<dyn Detector> {
        name: "color",
        doc: "Finds one object by the likelihood of its colors, trained on images with masks (`mobee \
              detector train --kind color`).",
        schema: || schemars::schema_for!(LearnedDetectorSettings),
        example: |_| Ok(json!({ "file": "cup.detector.json", "object": "cup" })),
        build: |value, _| build(value, DetectorKind::Color),
    })
}

inventory::submit! {
    Registered(&Kind::<dyn Detector> {
        name: "cgp",
        doc: "Finds one object by an evolved image program. Its inputs are the color channels, the color \
              likelihood, and the output of a small network on the surroundings of each pixel (`mobee \
              detector train --kind cgp`).",
        schema: || schemars::schema_for!(LearnedDetectorSettings),
        example: |_| Ok(json!({ "file": "cup.detector.json", "object": "cup" })),
        build: |value, _| build(value, DetectorKind::Cgp),
    })
}
