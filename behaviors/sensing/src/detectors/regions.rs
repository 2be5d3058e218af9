//! Conversion of a likelihood to regions: threshold, opening, connected components, and selection.

use super::picture::Mask;
use super::plane::Plane;
use mobee_contract::{MAX_REGIONS, Region};
use serde::{Deserialize, Serialize};

/// Parameters of the conversion of a likelihood to a mask and its regions.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cut {
    /// Minimum value of a pixel of the object, above 0 and up to 255.
    pub threshold: f32,
    /// Open the mask by 3x3 pixels.
    pub open: bool,
    /// Minimum weight of a component as a share of the heaviest one's weight; 1: only the heaviest
    /// is kept.
    pub keep: f32,
}

/// A connected part of a mask.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Blob {
    /// Mean position of its pixels; the center of the upper left pixel of an image is (0.5, 0.5).
    pub centroid: [f64; 2],
    /// Left, top, right (exclusive) and bottom (exclusive), pixels.
    pub bounds: [usize; 4],
    /// Number of pixels.
    pub area: usize,
    /// It touches the image border, so part of it may be outside.
    pub is_clipped: bool,
    /// Mean over its pixels of the likelihood above the threshold, as a share of the maximum
    /// possible, 0 to 1.
    pub confidence: f64,
    /// Sum of the same over its pixels.
    pub weight: f64,
}

impl Blob {
    /// Converts it to a region of the object of this name.
    pub fn region(&self, object: &str) -> Region {
        Region {
            object: object.into(),
            center: self.centroid,
            bounds: self.bounds.map(|n| n as f64),
            area: self.area as f64,
            is_clipped: self.is_clipped,
            confidence: self.confidence,
            pose: None,
        }
    }
}

/// The regions of a mask.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Blobs {
    /// The heaviest regions, by decreasing weight: at most [`MAX_REGIONS`].
    pub kept: Vec<Blob>,
    /// Number of the other regions.
    pub omitted: u64,
}

impl Cut {
    /// Returns the mask and its regions. The mask contains all regions, the omitted ones too.
    pub fn apply(&self, likelihood: &Plane) -> (Mask, Blobs) {
        let mut mask = Mask::at_least(likelihood, self.threshold);
        if self.open {
            mask = opened(&mask);
        }
        let Components { labels, weights, blobs } = components(&mask, likelihood, self.threshold);
        let heaviest = weights.iter().copied().fold(0.0, f64::max);
        let is_kept = |weight: f64| weight >= f64::from(self.keep) * heaviest;
        for (m, label) in mask.data.iter_mut().zip(&labels) {
            *m = label.checked_sub(1).is_some_and(|l| is_kept(weights[l as usize]));
        }
        let all = weights.iter().filter(|w| is_kept(**w)).count();
        let mut kept: Vec<Blob> = heaviest_of(blobs).into_iter().map(|(_, blob)| blob).collect();
        kept.retain(|b| is_kept(b.weight));
        let omitted = (all - kept.len()) as u64;
        (mask, Blobs { kept, omitted })
    }

    /// Returns whether its numbers are in their ranges.
    pub fn is_sound(&self) -> bool {
        self.threshold > 0.0 && self.threshold <= 255.0 && (0.0..=1.0).contains(&self.keep)
    }
}

/// Erodes and dilates by 3x3 pixels; the border's values are repeated beyond the border.
fn opened(mask: &Mask) -> Mask {
    let plane = mask.plane();
    let all = |v: f32| if v >= 254.9 { 255.0 } else { 0.0 };
    let any = |v: f32| if v >= 0.1 { 255.0 } else { 0.0 };
    Mask::at_least(&plane.box_mean(1, 1).map(all).box_mean(1, 1).map(any), 128.0)
}

/// Returns the [`MAX_REGIONS`] heaviest regions by decreasing weight; equal ones by their numbers.
fn heaviest_of(mut blobs: Vec<(u32, Blob)>) -> Vec<(u32, Blob)> {
    blobs.sort_by(|(m, a), (n, b)| b.weight.total_cmp(&a.weight).then(m.cmp(n)));
    blobs.truncate(MAX_REGIONS);
    blobs
}

/// Connected components of a mask.
struct Components {
    /// Number of each pixel's component from 1 on; 0: none.
    labels: Vec<u32>,
    /// Weight of each component.
    weights: Vec<f64>,
    /// Some components with their numbers, including the heaviest: there may be millions, and only
    /// hundreds are stored.
    blobs: Vec<(u32, Blob)>,
}

/// Finds the components of a mask with 4-connectivity.
fn components(mask: &Mask, likelihood: &Plane, threshold: f32) -> Components {
    let w = mask.width;
    let h = mask.height;
    let mut found = Components { labels: vec![0u32; mask.data.len()], weights: Vec::new(), blobs: Vec::new() };
    let labels = &mut found.labels;
    let mut open = Vec::new();
    for start in 0..mask.data.len() {
        if !mask.data[start] || labels[start] > 0 {
            continue;
        }
        let label = found.weights.len() as u32 + 1;
        let mut sum = [0.0; 2];
        let mut weight = 0.0;
        let mut area = 0;
        let mut bounds = [w, h, 0, 0];
        labels[start] = label;
        open.push(start);
        while let Some(i) = open.pop() {
            let x = i % w;
            let y = i / w;
            sum = [sum[0] + x as f64 + 0.5, sum[1] + y as f64 + 0.5];
            area += 1;
            weight += f64::from((likelihood.data[i] - threshold).max(0.0)) / f64::from(256.0 - threshold);
            bounds = [bounds[0].min(x), bounds[1].min(y), bounds[2].max(x + 1), bounds[3].max(y + 1)];
            let near = [(x > 0, i.wrapping_sub(1)), (x + 1 < w, i + 1), (y > 0, i.wrapping_sub(w)), (y + 1 < h, i + w)];
            for (_, j) in near.into_iter().filter(|(inside, _)| *inside) {
                if mask.data[j] && labels[j] == 0 {
                    labels[j] = label;
                    open.push(j);
                }
            }
        }
        found.weights.push(weight);
        let blob = Blob {
            centroid: sum.map(|s| s / area as f64),
            bounds,
            area,
            is_clipped: bounds[0] == 0 || bounds[1] == 0 || bounds[2] == w || bounds[3] == h,
            confidence: (weight / area as f64).clamp(0.0, 1.0),
            weight,
        };
        found.blobs.push((label, blob));
        if found.blobs.len() >= 4 * MAX_REGIONS {
            found.blobs = heaviest_of(std::mem::take(&mut found.blobs));
        }
    }
    found
}
