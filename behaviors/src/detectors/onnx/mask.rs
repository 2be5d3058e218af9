//! A network that tells what each pixel is.

use super::network::Told;
use super::settings::{OnnxLayout, OnnxObject};
use crate::detectors::plane::Plane;
use crate::detectors::regions::Cut;
use mobee_contract::Region;
use schemars::JsonSchema;
use serde::Deserialize;

/// An output that tells for each pixel, or each block of pixels, what it is: one number for each class.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MaskOutput {
    /// The output's name; default: the first one.
    #[serde(default)]
    pub name: Option<String>,
    /// What its numbers are.
    #[serde(default)]
    pub values: MaskValues,
    /// The order of its dimensions.
    #[serde(default)]
    pub layout: OnnxLayout,
    /// Whether masks are opened by 3x3 pixels, which drops specks.
    #[serde(default = "open")]
    pub open: bool,
    /// Regions with less than this share of the weightiest one's weight are dropped, 0 to 1.
    #[serde(default = "keep")]
    pub keep: f64,
}

fn open() -> bool {
    true
}
fn keep() -> f64 {
    0.3
}

/// What the numbers of a mask are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MaskValues {
    /// Logits: of one class by the logistic function, of several by softmax.
    #[default]
    Logits,
    /// Probabilities, 0 to 1.
    Probabilities,
}

/// What a mask shows.
pub struct SeenByMask {
    /// The regions of all objects.
    pub regions: Vec<Region>,
    /// The number of those that are left out.
    pub omitted: u64,
    /// The object that each pixel was taken for, counted from 1; 0: none.
    pub pixels: Vec<u8>,
}

impl MaskOutput {
    /// Channels, rows, columns of an output.
    ///
    /// # Errors
    /// In words, if it is no mask.
    pub fn sizes(&self, shape: &[usize]) -> Result<[usize; 3], String> {
        let sizes = match (shape, self.layout) {
            ([h, w], _) | ([1, h, w], _) => [1, *h, *w],
            ([1, c, h, w], OnnxLayout::Nchw) => [*c, *h, *w],
            ([1, h, w, c], OnnxLayout::Nhwc) => [*c, *h, *w],
            _ => return Err("a mask has the dimensions picture (1), channel, row and column".into()),
        };
        if sizes.contains(&0) { Err("a mask has pixels".into()) } else { Ok(sizes) }
    }

    /// How likely each pixel is of a class, 0 to 255.
    fn likelihood(&self, told: &Told, class: usize) -> Option<Plane> {
        let [channels, height, width] = self.sizes(&told.shape).ok()?;
        let pixels = width * height;
        let value = |channel: usize, pixel: usize| {
            let at = match self.layout {
                OnnxLayout::Nchw => channel * pixels + pixel,
                OnnxLayout::Nhwc => pixel * channels + channel,
            };
            told.numbers.get(at).copied().unwrap_or(f32::NAN)
        };
        let share = |pixel: usize| {
            let own = value(class, pixel);
            match self.values {
                MaskValues::Probabilities => own,
                MaskValues::Logits if channels == 1 => 1.0 / (1.0 + (-own).exp()),
                MaskValues::Logits => 1.0 / (0..channels).map(|c| (value(c, pixel) - own).exp()).sum::<f32>(),
            }
        };
        // what is no number is not the object
        let bounded = |share: f32| if share.is_finite() { 255.0 * share.clamp(0.0, 1.0) } else { 0.0 };
        (class < channels).then(|| Plane { width, height, data: (0..pixels).map(|k| bounded(share(k))).collect() })
    }

    /// What is seen in a picture of this size.
    pub fn regions(&self, told: &Told, objects: &[OnnxObject], threshold: f64, size: [usize; 2]) -> SeenByMask {
        let cut = Cut { threshold: (255.0 * threshold) as f32, open: self.open, keep: self.keep as f32 };
        let mut seen = SeenByMask { regions: Vec::new(), omitted: 0, pixels: vec![0; size[0] * size[1]] };
        for (object, number) in objects.iter().zip(1..=u8::MAX) {
            let Some(likelihood) = self.likelihood(told, object.class) else { continue };
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
