//! Color likelihood: histograms of the object and of the background, and the logarithm of their
//! ratio.
//!
//! Colors are opponent coordinates, so that shading changes only one of them: brightness, red minus
//! green, yellow minus blue.

use super::picture::{LabeledPicture, Picture};
use super::plane::Plane;
use serde::{Deserialize, Serialize};

/// Number of bins of brightness, red minus green, and yellow minus blue.
const BINS: [usize; 3] = [16, 32, 32];
/// Total number of bins.
const BIN_COUNT: usize = BINS[0] * BINS[1] * BINS[2];
/// Width of a bin of an opponent coordinate.
const OPPONENT_BIN_WIDTH: f32 = 8.0;
/// Pixels added to every bin, so that a color that never occurred is neutral.
const PRIOR: f32 = 3.0;

/// Histograms of the colors of the object and of the background.
#[derive(Clone, Debug)]
struct ColorCounts {
    object: Vec<f32>,
    beside: Vec<f32>,
}

impl Default for ColorCounts {
    fn default() -> Self {
        ColorCounts { object: vec![0.0; BIN_COUNT], beside: vec![0.0; BIN_COUNT] }
    }
}

impl ColorCounts {
    fn add(&mut self, of: &LabeledPicture) {
        for (rgb, is_object) in of.picture.rgb.chunks_exact(3).zip(&of.mask.data) {
            let counts = if *is_object { &mut self.object } else { &mut self.beside };
            counts[bin([rgb[0], rgb[1], rgb[2]])] += 1.0;
        }
    }

    fn table(&self) -> ColorTable {
        let [object, beside] = [&self.object, &self.beside].map(|counts| {
            let counts = smoothed(&smoothed(counts));
            let all: f32 = counts.iter().sum();
            (counts, all.max(1.0))
        });
        // A prior in proportion to both, so that a color that never occurred is equally likely in
        // both.
        let share = |n: f32, all: f32, of_both: f32| (n + PRIOR * of_both) / (all + PRIOR * BIN_COUNT as f32 * of_both);
        let total = object.1 + beside.1;
        let level = |(o, b): (&f32, &f32)| {
            let ratio = share(*o, object.1, object.1 / total) / share(*b, beside.1, beside.1 / total);
            (128.0 + 25.0 * ratio.ln()).clamp(0.0, 255.0).round() as u8
        };
        ColorTable(object.0.iter().zip(&beside.0).map(level).collect())
    }
}

/// Log-likelihood ratio of each color between object and background, as 128 + 25 ln(ratio).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ColorTable(Vec<u8>);

impl ColorTable {
    /// Computes the table from labeled images.
    pub fn of<'a>(pictures: impl IntoIterator<Item = &'a LabeledPicture>) -> ColorTable {
        let mut counts = ColorCounts::default();
        pictures.into_iter().for_each(|p| counts.add(p));
        counts.table()
    }

    /// Returns the likelihood of every pixel, then shrunk by an integer factor.
    pub fn look(&self, picture: &Picture, shrink: usize) -> Plane {
        let data = picture.rgb.chunks_exact(3).map(|p| f32::from(self.0[bin([p[0], p[1], p[2]])])).collect();
        Plane { width: picture.width, height: picture.height, data }.shrunk(shrink)
    }

    /// Returns whether it has an entry for every color.
    pub fn is_whole(&self) -> bool {
        self.0.len() == BIN_COUNT
    }
}

fn bin([r, g, b]: [u8; 3]) -> usize {
    let [red, green, blue] = [r, g, b].map(f32::from);
    let place = |v: f32, n: usize| (((v / OPPONENT_BIN_WIDTH) + n as f32 / 2.0).max(0.0) as usize).min(n - 1);
    let brightness = (u16::from(r) + u16::from(g) + u16::from(b)) as usize * BINS[0] / 766;
    (brightness * BINS[1] + place(red - green, BINS[1])) * BINS[2] + place((red + green) / 2.0 - blue, BINS[2])
}

/// Smooths along each of the three axes: half of each bin plus a quarter of each neighbor.
fn smoothed(counts: &[f32]) -> Vec<f32> {
    let mut now = counts.to_vec();
    for (stride, n) in [(1, BINS[2]), (BINS[2], BINS[1]), (BINS[1] * BINS[2], BINS[0])] {
        let before = now.clone();
        for (i, to) in now.iter_mut().enumerate() {
            let place = i / stride % n;
            let below = before[if place > 0 { i - stride } else { i }];
            let above = before[if place + 1 < n { i + stride } else { i }];
            *to = 0.5 * before[i] + 0.25 * (below + above);
        }
    }
    now
}
