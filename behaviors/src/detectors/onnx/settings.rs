//! What a user says of a network: what goes in, and what comes out.

use super::boxes::BoxOutput;
use super::mask::MaskOutput;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Settings of the kind `onnx`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OnnxDetectorSettings {
    /// The network, in ONNX format, weights and all.
    #[schemars(extend("format" = "path"))]
    pub file: PathBuf,
    /// What goes in.
    #[serde(default)]
    pub input: OnnxInput,
    /// What comes out.
    pub output: OnnxOutput,
    /// Which class is which object; others are not told.
    pub objects: Vec<OnnxObject>,
    /// How sure the network must be, 0 to 1: of a pixel, or of a box.
    #[serde(default = "threshold")]
    pub threshold: f64,
    /// How much the network may use.
    #[serde(default)]
    pub limits: OnnxLimits,
}

/// How much a network may use in its process. One that needs more ends, and its detector fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct OnnxLimits {
    /// Memory, MiB, 64 to 1,000,000: the network, what is computed with it, and the program itself.
    pub memory_mib: u64,
    /// Processor time for one picture, s, 1 to 3600.
    pub seconds: u64,
}

impl Default for OnnxLimits {
    fn default() -> OnnxLimits {
        OnnxLimits { memory_mib: 2048, seconds: 10 }
    }
}

/// A class that the network knows, and an object.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OnnxObject {
    /// The class's number, from 0 on.
    #[serde(default)]
    pub class: usize,
    /// The object's name in the world.
    pub object: String,
}

/// How a picture goes in: stretched to a size, one number for each color of each pixel.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct OnnxInput {
    /// The input's name; default: the only one.
    pub name: Option<String>,
    /// Width and height, pixels; default: as the network says.
    pub size: Option<[usize; 2]>,
    /// The order of its dimensions.
    pub layout: OnnxLayout,
    /// The order of the colors.
    pub colors: OnnxColors,
    /// Subtracted from each color, which is 0 to 255.
    pub mean: [f64; 3],
    /// What is left is divided by this.
    pub std: [f64; 3],
}

impl Default for OnnxInput {
    fn default() -> OnnxInput {
        OnnxInput {
            name: None,
            size: None,
            layout: OnnxLayout::default(),
            colors: OnnxColors::default(),
            mean: [0.0; 3],
            std: [255.0; 3],
        }
    }
}

/// The order of dimensions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OnnxLayout {
    /// Picture, channel, row, column: as PyTorch has it.
    #[default]
    Nchw,
    /// Picture, row, column, channel: as TensorFlow has it.
    Nhwc,
}

/// The order of colors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OnnxColors {
    /// Red, green, blue.
    #[default]
    Rgb,
    /// Blue, green, red: as OpenCV has it.
    Bgr,
}

/// What comes out.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(tag = "means", rename_all = "snake_case")]
pub enum OnnxOutput {
    /// What each pixel is.
    Mask(MaskOutput),
    /// Boxes around what was found.
    Boxes(BoxOutput),
}

impl OnnxOutput {
    /// The output's name; `None`: the first one.
    pub fn name(&self) -> Option<&str> {
        match self {
            OnnxOutput::Mask(mask) => mask.name.as_deref(),
            OnnxOutput::Boxes(boxes) => boxes.name.as_deref(),
        }
    }
}

fn threshold() -> f64 {
    0.5
}
