//! Networks with an output of boxes around objects.

use super::network::NetworkOutput;
use super::settings::OnnxObject;
use mobee_contract::Region;
use schemars::JsonSchema;
use serde::Deserialize;

/// An output of boxes: for each box, four numbers for its place, then its scores.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BoxOutput {
    /// Name of the output; default: the first one.
    #[serde(default)]
    pub name: Option<String>,
    /// Orientation of the table: one box per row or per column.
    #[serde(default)]
    pub along: BoxesAlong,
    /// Meaning of the four numbers.
    #[serde(default)]
    pub place: BoxPlace,
    /// Unit of the four numbers.
    #[serde(default)]
    pub unit: BoxUnit,
    /// Meaning of the numbers after them.
    #[serde(default)]
    pub scores: BoxScores,
    /// Maximum overlap of two boxes of a class (intersection over union), 0 to 1; above it, only
    /// the box with the higher score is kept.
    #[serde(default = "overlap")]
    pub overlap: f64,
}

fn overlap() -> f64 {
    0.5
}

/// Orientation of the table of boxes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BoxesAlong {
    /// One box per row.
    #[default]
    Rows,
    /// One box per column.
    Columns,
}

/// Meaning of the four numbers of a box's place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BoxPlace {
    /// Left, top, right, bottom.
    #[default]
    Corners,
    /// Horizontal and vertical center, width, height.
    Middle,
}

/// Unit of the place of a box.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BoxUnit {
    /// Pixels of the network's input.
    #[default]
    Pixels,
    /// Shares of the image's width and height, 0 to 1.
    Shares,
}

/// Meaning of the scores of a box.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BoxScores {
    /// One score, then the number of the class if there is more than one class.
    #[default]
    One,
    /// A score for each class.
    Classes,
    /// The score of any object being in the box, then a score for each class.
    AnythingAndClasses,
}

impl BoxOutput {
    /// Returns the number of boxes, and of numbers per box.
    ///
    /// # Errors
    /// A description if the output does not contain boxes.
    pub fn sizes(&self, shape: &[usize]) -> Result<[usize; 2], String> {
        let [rows, columns] = match shape {
            [a, b] | [1, a, b] => [*a, *b],
            _ => return Err("boxes are a table, or one table for one image".into()),
        };
        let [count, numbers] = match self.along {
            BoxesAlong::Rows => [rows, columns],
            BoxesAlong::Columns => [columns, rows],
        };
        let least = if self.scores == BoxScores::AnythingAndClasses { 6 } else { 5 };
        match numbers >= least {
            true => Ok([count, numbers]),
            false => Err(format!("a box has at least {least} numbers, and these have {numbers}")),
        }
    }

    /// Returns the regions of all objects in an image, by decreasing score.
    ///
    /// # Arguments
    /// * `input`: size of the network's input, pixels.
    /// * `size`: size of the image, pixels.
    pub fn regions(
        &self,
        output: &NetworkOutput,
        objects: &[OnnxObject],
        threshold: f64,
        [size, input]: [[usize; 2]; 2],
    ) -> Vec<Region> {
        let Ok([count, numbers]) = self.sizes(&output.shape) else { return Vec::new() };
        let scale: [f64; 2] = std::array::from_fn(|i| match self.unit {
            BoxUnit::Pixels => size[i] as f64 / input[i].max(1) as f64,
            BoxUnit::Shares => size[i] as f64,
        });
        let mut found: Vec<(usize, Region)> = Vec::new();
        for k in 0..count {
            let number = |i: usize| {
                let at = match self.along {
                    BoxesAlong::Rows => k * numbers + i,
                    BoxesAlong::Columns => i * count + k,
                };
                output.numbers.get(at).map_or(f64::NAN, |v| f64::from(*v))
            };
            for object in objects {
                let score = self.score(&number, numbers, object.class);
                // Written so that NaN is not a box.
                if score >= threshold {
                    let bounds = self.bounds(&number, scale, size);
                    found.extend(bounds.map(|b| (object.class, region(&object.object, b, score.min(1.0), size))));
                }
            }
        }
        found.sort_by(|(_, a), (_, b)| b.confidence.total_cmp(&a.confidence));
        let mut kept: Vec<(usize, Region)> = Vec::new();
        for (class, region) in found {
            let is_known =
                |(other, r): &(usize, Region)| *other == class && shared(&r.bounds, &region.bounds) > self.overlap;
            if kept.len() < MAX_BOXES && !kept.iter().any(is_known) {
                kept.push((class, region));
            }
        }
        kept.into_iter().map(|(_, region)| region).collect()
    }

    fn score(&self, number: &impl Fn(usize) -> f64, numbers: usize, class: usize) -> f64 {
        let of_class = |first: usize| if first + class < numbers { number(first + class) } else { f64::NAN };
        match self.scores {
            BoxScores::One if numbers == 5 => {
                if class == 0 {
                    number(4)
                } else {
                    f64::NAN
                }
            }
            BoxScores::One => {
                if number(5) == class as f64 {
                    number(4)
                } else {
                    f64::NAN
                }
            }
            BoxScores::Classes => of_class(4),
            BoxScores::AnythingAndClasses => number(4) * of_class(5),
        }
    }

    /// Returns left, top, right and bottom in the image, pixels; `None` for an empty box.
    fn bounds(
        &self,
        number: &impl Fn(usize) -> f64,
        [sx, sy]: [f64; 2],
        [width, height]: [usize; 2],
    ) -> Option<[f64; 4]> {
        let [a, b, c, d] = [0, 1, 2, 3].map(number);
        let [left, top, right, bottom] = match self.place {
            BoxPlace::Corners => [a, b, c, d],
            BoxPlace::Middle => [a - c / 2.0, b - d / 2.0, a + c / 2.0, b + d / 2.0],
        };
        let within = |v: f64, most: usize| v.clamp(0.0, most as f64);
        let bounds = [
            within(left * sx, width),
            within(top * sy, height),
            within(right * sx, width),
            within(bottom * sy, height),
        ];
        (bounds[2] > bounds[0] && bounds[3] > bounds[1]).then_some(bounds)
    }
}

/// Maximum number of boxes in one image.
const MAX_BOXES: usize = 100;

fn region(object: &str, bounds: [f64; 4], confidence: f64, [width, height]: [usize; 2]) -> Region {
    let [left, top, right, bottom] = bounds;
    Region {
        object: object.into(),
        center: [(left + right) / 2.0, (top + bottom) / 2.0],
        bounds,
        area: (right - left) * (bottom - top),
        is_clipped: left <= 0.0 || top <= 0.0 || right >= width as f64 || bottom >= height as f64,
        confidence,
        pose: None,
    }
}

/// Returns the intersection over union of two boxes.
fn shared(a: &[f64; 4], b: &[f64; 4]) -> f64 {
    let along = |i: usize| (a[i + 2].min(b[i + 2]) - a[i].max(b[i])).max(0.0);
    let area = |r: &[f64; 4]| (r[2] - r[0]) * (r[3] - r[1]);
    let both = along(0) * along(1);
    both / (area(a) + area(b) - both)
}
