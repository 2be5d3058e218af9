//! How likely a color is the object's: two histograms, of the object and of what is beside it, and the logarithm of their ratio.
//!
//! Colors are opponent ones, so that shading moves one coordinate only: brightness, red against green, yellow against blue.

use super::picture::{LabeledPicture, Picture};
use super::plane::Plane;
use serde::{Deserialize, Serialize};

/// Bins of brightness, of red against green, of yellow against blue.
const BINS: [usize; 3] = [16, 32, 32];
/// Number of all bins.
const ALL: usize = BINS[0] * BINS[1] * BINS[2];
/// The difference of two opponents that one bin spans.
const SPAN: f32 = 8.0;
/// Pixels that are added to every bin, so that a color never seen tells nothing.
const PRIOR: f32 = 3.0;

/// Colors, and how often the object and the rest of the pictures have them.
#[derive(Clone, Debug)]
struct ColorCounts {
    object: Vec<f32>,
    beside: Vec<f32>,
}

impl Default for ColorCounts {
    fn default() -> Self {
        ColorCounts { object: vec![0.0; ALL], beside: vec![0.0; ALL] }
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
        // a prior in proportion to both, so that a color that was seen nowhere is as likely here as there
        let share = |n: f32, all: f32, of_both: f32| (n + PRIOR * of_both) / (all + PRIOR * ALL as f32 * of_both);
        let total = object.1 + beside.1;
        let level = |(o, b): (&f32, &f32)| {
            let ratio = share(*o, object.1, object.1 / total) / share(*b, beside.1, beside.1 / total);
            (128.0 + 25.0 * ratio.ln()).clamp(0.0, 255.0).round() as u8
        };
        ColorTable(object.0.iter().zip(&beside.0).map(level).collect())
    }
}

/// The logarithm of how much likelier each color is in the object than beside it, as 128 + 25 ln(ratio).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ColorTable(Vec<u8>);

impl ColorTable {
    /// Of these pictures.
    pub fn of<'a>(pictures: impl IntoIterator<Item = &'a LabeledPicture>) -> ColorTable {
        let mut counts = ColorCounts::default();
        pictures.into_iter().for_each(|p| counts.add(p));
        counts.table()
    }

    /// The likelihood of every pixel, made smaller by a whole factor afterwards.
    pub fn look(&self, picture: &Picture, shrink: usize) -> Plane {
        let data = picture.rgb.chunks_exact(3).map(|p| f32::from(self.0[bin([p[0], p[1], p[2]])])).collect();
        Plane { width: picture.width, height: picture.height, data }.shrunk(shrink)
    }

    /// Whether it has an entry for every color.
    pub fn is_whole(&self) -> bool {
        self.0.len() == ALL
    }
}

fn bin([r, g, b]: [u8; 3]) -> usize {
    let [red, green, blue] = [r, g, b].map(f32::from);
    let place = |v: f32, n: usize| (((v / SPAN) + n as f32 / 2.0).max(0.0) as usize).min(n - 1);
    let brightness = (u16::from(r) + u16::from(g) + u16::from(b)) as usize * BINS[0] / 766;
    (brightness * BINS[1] + place(red - green, BINS[1])) * BINS[2] + place((red + green) / 2.0 - blue, BINS[2])
}

/// Each bin with a half of itself and a quarter of each neighbor, along each of the three axes.
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
