//! The detector kind `onnx`.

use super::network::{NetworkOutput, NetworkSetup};
use super::process::{NetworkRunError, NetworkRunner};
use super::settings::{OnnxDetectorSettings, OnnxOutput};
use crate::detectors::picture::Picture;
use mobee_contract::*;
use serde_json::{Value, json};
use std::time::Duration;

/// Finds objects by an imported network.
pub struct OnnxDetector {
    settings: OnnxDetectorSettings,
    network: NetworkRunner,
    /// Width and height of the network's input, pixels.
    size: [usize; 2],
    /// Mask of the last frame.
    mask: Option<SeenMask>,
    /// First problem with the network's outputs, until it is reported.
    complaint: Option<String>,
    has_complained: bool,
    /// Number of regions of the last frame beyond the maximum.
    omitted: u64,
    failure: Option<String>,
}

impl OnnxDetector {
    /// Creates a detector from its settings. The network is tried on two images first.
    ///
    /// # Errors
    /// Invalid settings, a file without a network, and a network with an output that is non-finite
    /// or disagrees with the settings.
    pub fn new(settings: OnnxDetectorSettings) -> Result<OnnxDetector, KindError> {
        sound(&settings)?;
        let at = settings.file.display();
        let setup = NetworkSetup {
            file: settings.file.clone(),
            input: settings.input.clone(),
            output: settings.output.name().map(str::to_owned),
            limits: settings.limits,
        };
        let (network, size) = NetworkRunner::start(&setup).map_err(|mut e| {
            e.what = format!("{at}: {}", e.what);
            e
        })?;
        let mut detector = OnnxDetector {
            settings,
            network,
            size,
            mask: None,
            complaint: None,
            has_complained: false,
            omitted: 0,
            failure: None,
        };
        for level in [0u8, 170] {
            detector.rehearse(level)?;
        }
        Ok(detector)
    }

    /// Checks that the output for a test image agrees with the settings.
    fn rehearse(&mut self, level: u8) -> Result<(), KindError> {
        let [width, height] = self.size;
        // A ramp added to a level, so that no channel is constant.
        let value = |k: usize| level.wrapping_add((k % 61) as u8);
        let picture = Picture { width, height, rgb: (0..width * height * 3).map(value).collect() };
        let at = self.settings.file.display();
        let output = self.network.run(&picture).map_err(|e| match e {
            NetworkRunError::Refused(e) => {
                let help = "give a network that takes one image, of the size and layout given in `input`";
                KindError::new("file", format!("{at} can't be run: {e}"), help)
            }
            NetworkRunError::Ended(why) => {
                let help = "export a simpler network, or raise `limits`";
                KindError::new("file", format!("{at} can't be run: {why}"), help)
            }
        })?;
        self.check(&output)?;
        if output.numbers.iter().any(|v| !v.is_finite()) {
            let what = format!("the output of {at} contains NaN or infinite numbers");
            return Err(KindError::new("file", what, "check `input.mean` and `input.std`, and the network's weights"));
        }
        Ok(())
    }

    /// Stores the first problem, to be reported once.
    fn complain(&mut self, what: String) {
        if !std::mem::replace(&mut self.has_complained, true) {
            self.complaint = Some(what);
        }
    }

    fn check(&self, output: &NetworkOutput) -> Result<(), KindError> {
        let shape = output.shape.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
        let sizes = match &self.settings.output {
            OnnxOutput::Mask(mask) => mask.sizes(&output.shape).map(|[channels, ..]| Some(channels)),
            OnnxOutput::Boxes(boxes) => boxes.sizes(&output.shape).map(|_| None),
        };
        let channels = sizes.map_err(|e| {
            let help = "describe the meaning of the output in `output`, and select it by `output.name`";
            KindError::new("output", format!("the network's output has the dimensions [{shape}]: {e}"), help)
        })?;
        let beyond = |class: usize| channels.is_some_and(|c| class >= c);
        match self.settings.objects.iter().enumerate().find(|(_, o)| beyond(o.class)) {
            Some((k, o)) => {
                let what = format!("the network has no class {}: its output has the dimensions [{shape}]", o.class);
                Err(KindError::new(format!("objects[{k}].class"), what, "classes count from 0"))
            }
            None => Ok(()),
        }
    }
}

/// Checks the numbers of the settings.
fn sound(settings: &OnnxDetectorSettings) -> Result<(), KindError> {
    let mut checks = Vec::new();
    let mut require = |path: &str, is_right: bool, what: &str, help: &str| {
        checks.push(if is_right { Ok(()) } else { Err(KindError::new(path, what, help)) });
    };
    let share = |v: f64| (0.0..=1.0).contains(&v);
    let range = "give a number from 0 to 1";
    require(
        "threshold",
        share(settings.threshold) && settings.threshold >= 0.001,
        "it is not a valid threshold",
        "give a number from 0.001 to 1",
    );
    let is_mean = settings.input.mean.iter().all(|v| v.is_finite());
    require("input.mean", is_mean, "a color's mean is a number", "give three numbers from 0 to 255");
    let is_std = settings.input.std.iter().all(|v| v.is_finite() && *v > 0.0);
    require("input.std", is_std, "nothing can be divided by that", "give three numbers above 0");
    let known = "give the objects of the classes: objects = [{ class = 0, object = \"cup\" }]";
    require("objects", !settings.objects.is_empty(), "without an object there is nothing to find", known);
    let is_few = settings.objects.len() <= usize::from(u8::MAX);
    require("objects", is_few, "these are more than 255 objects", "use several detectors");
    let is_memory = (64..=1_000_000).contains(&settings.limits.memory_mib);
    require("limits.memory_mib", is_memory, "no network runs with that", "give 64 to 1000000 MiB");
    let is_time = (1..=3600).contains(&settings.limits.seconds);
    require("limits.seconds", is_time, "no network runs with that", "give 1 to 3600 s");
    match &settings.output {
        OnnxOutput::Mask(mask) => require("output.keep", share(mask.keep), "it is not a share", range),
        OnnxOutput::Boxes(boxes) => require("output.overlap", share(boxes.overlap), "it is not a share", range),
    }
    KindError::gather(checks).map(drop)
}

impl Detector for OnnxDetector {
    fn detect(&mut self, frame: &Frame) -> Vec<Region> {
        let Some(picture) = Picture::of(frame) else { return Vec::new() };
        let size = [picture.width, picture.height];
        self.mask = None;
        self.omitted = 0;
        // The network was tried at the start. If it fails on this image, nothing is detected.
        let output = match self.network.run(&picture) {
            Ok(output) => output,
            Err(NetworkRunError::Ended(why)) => {
                self.failure = Some(format!("the network failed on a picture: {why}"));
                return Vec::new();
            }
            Err(NetworkRunError::Refused(why)) => {
                self.complain(format!("the network can't be run on an image, so nothing is detected in it: {why}"));
                return Vec::new();
            }
        };
        let wrong = output.numbers.iter().filter(|v| !v.is_finite()).count();
        if wrong > 0 {
            let all = output.numbers.len();
            self.complain(format!(
                "{wrong} of {all} numbers of the network's answer to a picture are none (NaN or infinite): there it sees nothing; check \
                 its weights, and `input.mean` and `input.std`"
            ));
        }
        let OnnxDetectorSettings { objects, threshold, .. } = &self.settings;
        match &self.settings.output {
            OnnxOutput::Mask(mask) => {
                let seen = mask.regions(&output, objects, *threshold, size);
                self.mask = Some(SeenMask { size: frame.intrinsics.size, objects: seen.pixels.into() });
                self.omitted = seen.omitted;
                seen.regions
            }
            OnnxOutput::Boxes(boxes) => boxes.regions(&output, objects, *threshold, [size, self.size]),
        }
    }

    fn omitted(&self) -> u64 {
        self.omitted
    }

    fn failure(&mut self) -> Option<String> {
        self.failure.take()
    }

    fn objects(&self) -> Vec<String> {
        self.settings.objects.iter().map(|o| o.object.clone()).collect()
    }

    fn mask(&self) -> Option<SeenMask> {
        self.mask.clone()
    }

    fn complaint(&mut self) -> Option<String> {
        self.complaint.take()
    }

    fn takes(&self) -> Duration {
        Duration::from_millis(30)
    }
}

inventory::submit! {
    Registered(&Kind::<dyn Detector> {
        name: "onnx",
        doc: "Finds objects by a network of your own in ONNX format, with a class for each pixel or boxes \
              as its output. The settings describe its input and output.",
        schema: || schemars::schema_for!(OnnxDetectorSettings),
        example: |_| Ok(json!({
            "file": "cup.onnx", "objects": [{ "class": 1, "object": "cup" }], "output": { "means": "mask", "values": "logits" },
        })),
        build: |value: &Value, _| Ok(Box::new(OnnxDetector::new(settings(value)?)?)),
    })
}
