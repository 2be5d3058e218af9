//! Networks with an output for each pixel.

use super::network::NetworkOutput;
use super::settings::{OnnxLayout, OnnxObject};
use crate::detectors::plane::Plane;
use crate::detectors::regions::Cut;
use mobee_contract::Region;
use schemars::JsonSchema;
use serde::Deserialize;

/// An output with one number for each class, for each pixel or block of pixels.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MaskOutput {
    /// Name of the output; default: the first one.
    #[serde(default)]
    pub name: Option<String>,
    /// Meaning of its numbers.
    #[serde(default)]
    pub values: MaskValues,
    /// Order of its dimensions.
    #[serde(default)]
    pub layout: OnnxLayout,
    /// Open the masks by 3x3 pixels, which removes specks.
    #[serde(default = "open")]
    pub open: bool,
    /// Minimum weight of a region, as a share of the heaviest region's weight, 0 to 1; lighter ones
    /// are dropped.
    #[serde(default = "keep")]
    pub keep: f64,
}

fn open() -> bool {
    true
}
fn keep() -> f64 {
    0.3
}

/// Meaning of the numbers of a mask.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MaskValues {
    /// Logits: converted by the logistic function for one class, by softmax for several.
    #[default]
    Logits,
    /// Probabilities, 0 to 1.
    Probabilities,
}

/// Detections in a mask.
pub struct SeenByMask {
    /// The regions of all objects.
    pub regions: Vec<Region>,
    /// Number of regions beyond the maximum.
    pub omitted: u64,
    /// Object of each pixel, counted from 1; 0: none.
    pub pixels: Vec<u8>,
}

impl MaskOutput {
    /// Returns channels, rows and columns of an output.
    ///
    /// # Errors
    /// A description if the output is not a mask.
    pub fn sizes(&self, shape: &[usize]) -> Result<[usize; 3], String> {
        let sizes = match (shape, self.layout) {
            ([h, w], _) | ([1, h, w], _) => [1, *h, *w],
            ([1, c, h, w], OnnxLayout::Nchw) => [*c, *h, *w],
            ([1, h, w, c], OnnxLayout::Nhwc) => [*c, *h, *w],
            _ => return Err("a mask has the dimensions image (1), channel, row and column".into()),
        };
        if sizes.contains(&0) { Err("a mask has pixels".into()) } else { Ok(sizes) }
    }

    /// Returns the likelihood of a class for each pixel, 0 to 255.
    fn likelihood(&self, output: &NetworkOutput, class: usize) -> Option<Plane> {
        let [channels, height, width] = self.sizes(&output.shape).ok()?;
        let pixels = width * height;
        let value = |channel: usize, pixel: usize| {
            let at = match self.layout {
                OnnxLayout::Nchw => channel * pixels + pixel,
                OnnxLayout::Nhwc => pixel * channels + channel,
            };
            output.numbers.get(at).copied().unwrap_or(f32::NAN)
        };
        let share = |pixel: usize| {
            let own = value(class, pixel);
            match self.values {
                MaskValues::Probabilities => own,
                MaskValues::Logits if channels == 1 => 1.0 / (1.0 + (-own).exp()),
                MaskValues::Logits => 1.0 / (0..channels).map(|c| (value(c, pixel) - own).exp()).sum::<f32>(),
            }
        };
        // NaN and infinity count as background.
        let bounded = |share: f32| if share.is_finite() { 255.0 * share.clamp(0.0, 1.0) } else { 0.0 };
        (class < channels).then(|| Plane { width, height, data: (0..pixels).map(|k| bounded(share(k))).collect() })
    }

    /// Returns the detections in an image of this size, pixels.
    pub fn regions(
        &self,
        output: &NetworkOutput,
        objects: &[OnnxObject],
        threshold: f64,
        size: [usize; 2],
    ) -> SeenByMask {
        let cut = Cut { threshold: (255.0 * threshold) as f32, open: self.open, keep: self.keep as f32 };
        let mut seen = SeenByMask { regions: Vec::new(), omitted: 0, pixels: vec![0; size[0] * size[1]] };
        for (object, number) in objects.iter().zip(1..=u8::MAX) {
            let Some(likelihood) = self.likelihood(output, object.class) else { continue };
            let (mask, blobs) = cut.apply(&likelihood.stretched(size));
            for (pixel, _) in seen.pixels.iter_mut().zip(&mask.data).filter(|(_, inside)| **inside) {
                *pixel = number;
            }
            seen.regions.extend(blobs.kept.iter().map(|blob| blob.region(&object.object)));
            seen.omitted += blobs.omitted;
        }
        seen
    }
}
