//! A network that tells boxes around what it finds.

use super::network::Told;
use super::settings::OnnxObject;
use mobee_contract::Region;
use schemars::JsonSchema;
use serde::Deserialize;

/// An output that tells boxes: for each, four numbers of its place, then its scores.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BoxOutput {
    /// The output's name; default: the first one.
    #[serde(default)]
    pub name: Option<String>,
    /// Whether each box is a row or a column of the output.
    #[serde(default)]
    pub along: BoxesAlong,
    /// What the four numbers are.
    #[serde(default)]
    pub place: BoxPlace,
    /// What they count.
    #[serde(default)]
    pub unit: BoxUnit,
    /// What comes after them.
    #[serde(default)]
    pub scores: BoxScores,
    /// Of two boxes of a class that share more than this of what they cover together, the surer one is kept, 0 to 1.
    #[serde(default = "overlap")]
    pub overlap: f64,
}

fn overlap() -> f64 {
    0.5
}

/// How boxes lie in the output.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BoxesAlong {
    /// Each is a row.
    #[default]
    Rows,
    /// Each is a column.
    Columns,
}

/// What tells a box's place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BoxPlace {
    /// Left, top, right, bottom.
    #[default]
    Corners,
    /// Its middle across and down, its width and height.
    Middle,
}

/// In what places are counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BoxUnit {
    /// Pixels of the network's input.
    #[default]
    Pixels,
    /// Shares of the picture's width and height, 0 to 1.
    Shares,
}

/// What tells how sure a box is, and of what.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BoxScores {
    /// One score, and then the class's number, if there is more than one class.
    #[default]
    One,
    /// A score for each class.
    Classes,
    /// How sure it is that there is anything, then a score for each class.
    AnythingAndClasses,
}

impl BoxOutput {
    /// How many boxes there are, and how many numbers each has.
    ///
    /// # Errors
    /// In words, if they are no boxes.
    pub fn sizes(&self, shape: &[usize]) -> Result<[usize; 2], String> {
        let [rows, columns] = match shape {
            [a, b] | [1, a, b] => [*a, *b],
            _ => return Err("boxes are a table, or one table for one picture".into()),
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

    /// The regions of all objects in a picture of this size, the surest first.
    ///
    /// # Arguments
    /// * `input`: the size of what went into the network, pixels.
    pub fn regions(
        &self,
        told: &Told,
        objects: &[OnnxObject],
        threshold: f64,
        [size, input]: [[usize; 2]; 2],
    ) -> Vec<Region> {
        let Ok([count, numbers]) = self.sizes(&told.shape) else { return Vec::new() };
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
                told.numbers.get(at).map_or(f64::NAN, |v| f64::from(*v))
            };
            for object in objects {
                let score = self.score(&number, numbers, object.class);
                // written so that what is no number is no box
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
            if kept.len() < MOST && !kept.iter().any(is_known) {
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

    /// Left, top, right and bottom in the picture, pixels; `None` if nothing is between them.
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

/// So many boxes are told of a picture, at most.
const MOST: usize = 100;

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

/// What two boxes share, of what they cover together.
fn shared(a: &[f64; 4], b: &[f64; 4]) -> f64 {
    let along = |i: usize| (a[i + 2].min(b[i + 2]) - a[i].max(b[i])).max(0.0);
    let area = |r: &[f64; 4]| (r[2] - r[0]) * (r[3] - r[1]);
    let both = along(0) * along(1);
    both / (area(a) + area(b) - both)
}
