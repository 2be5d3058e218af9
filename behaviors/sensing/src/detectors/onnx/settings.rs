//! Settings of an imported network: its file, its input and its output.

use super::boxes::BoxOutput;
use super::mask::MaskOutput;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Settings of the kind `onnx`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OnnxDetectorSettings {
    /// The network, in ONNX format, including its weights.
    #[schemars(extend("format" = "path"))]
    pub file: PathBuf,
    /// Format of the input.
    #[serde(default)]
    pub input: OnnxInput,
    /// Meaning of the output.
    pub output: OnnxOutput,
    /// Objects of the classes. Other classes are ignored.
    pub objects: Vec<OnnxObject>,
    /// Minimum likelihood of a pixel or score of a box, 0 to 1.
    #[serde(default = "threshold")]
    pub threshold: f64,
    /// Resource limits of the network.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub limits: OnnxLimits,
}

/// Resource limits of a network's process. A network that exceeds them is ended, and its detector
/// fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct OnnxLimits {
    /// Memory, MiB, 64 to 1,000,000: for the network, its computation, and the program itself.
    pub memory_mib: u64,
    /// Processor time for one image, s, 1 to 3600.
    pub seconds: u64,
}

impl Default for OnnxLimits {
    fn default() -> OnnxLimits {
        OnnxLimits { memory_mib: 2048, seconds: 10 }
    }
}

/// A class of the network, and its object.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OnnxObject {
    /// Number of the class, from 0 on.
    #[serde(default)]
    pub class: usize,
    /// Name of the object in the world.
    pub object: String,
}

/// Conversion of an image to the input: stretched to a size, one number for each color of each
/// pixel.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct OnnxInput {
    /// Name of the input; default: the only one.
    pub name: Option<String>,
    /// Width and height, pixels; default: those of the network.
    pub size: Option<[usize; 2]>,
    /// Order of the dimensions.
    pub layout: OnnxLayout,
    /// Order of the colors.
    pub colors: OnnxColors,
    /// Mean subtracted from each color, 0 to 255.
    pub mean: [f64; 3],
    /// Standard deviation that each difference is divided by.
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

/// Order of dimensions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OnnxLayout {
    /// Image, channel, row, column: as in PyTorch.
    #[default]
    Nchw,
    /// Image, row, column, channel: as in TensorFlow.
    Nhwc,
}

/// Order of colors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OnnxColors {
    /// Red, green, blue.
    #[default]
    Rgb,
    /// Blue, green, red: as in OpenCV.
    Bgr,
}

/// Meaning of the output.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(tag = "means", rename_all = "snake_case")]
pub enum OnnxOutput {
    /// A class for each pixel.
    Mask(MaskOutput),
    /// Boxes around objects.
    Boxes(BoxOutput),
}

impl OnnxOutput {
    /// Name of the output; `None`: the first one.
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
