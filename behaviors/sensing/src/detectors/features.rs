//! Features of a pixel for a small network: color and texture in windows of several sizes around
//! it, and at offsets above, below and beside it. The position in the image is not a feature: the
//! object may be anywhere in later frames.

use super::plane::{Plane, brightness};

/// Number of features per pixel.
pub const FEATURES: usize = 36;

/// Distance of the offset windows, pixels.
const OFFSET_PX: isize = 12;

/// Computes the features of all pixels, one plane each.
///
/// `likelihood`: the color likelihood, [`ColorTable::look`](super::color::ColorTable::look).
pub fn features(rgb: &[Plane; 3], likelihood: &Plane) -> Vec<Plane> {
    let brightness = brightness(rgb);
    let [r, g, b] = rgb;
    let opponents = [r.zip(g, |r, g| r - g), r.zip(g, |r, g| r + g).zip(b, |sum, b| sum / 2.0 - b)];
    let colors = [&brightness, &opponents[0], &opponents[1]];
    let mut all = Vec::with_capacity(FEATURES);
    for color in colors {
        all.push(color.clone());
        all.extend([1, 4, 10].map(|r| color.box_mean(r, r)));
    }
    for radius in [2, 7] {
        all.push(spread(&brightness, radius));
    }
    all.push(spread(&opponents[0], 4));
    let slope = |dx, dy| brightness.zip(&brightness.moved(dx, dy), |a, b| (a - b).abs());
    for slope in [slope(1, 0), slope(0, 1), slope(1, 1), slope(-1, 1)] {
        all.push(slope.box_mean(3, 3));
    }
    for radius in [1, 4, 10] {
        all.push(likelihood.box_mean(radius, radius));
    }
    let near = likelihood.box_mean(5, 5);
    for (dx, dy) in [(OFFSET_PX, 0), (-OFFSET_PX, 0), (0, OFFSET_PX), (0, -OFFSET_PX)] {
        all.push(near.moved(dx, dy));
    }
    let wide = likelihood.box_mean(12, 12);
    for dy in [2 * OFFSET_PX, -2 * OFFSET_PX] {
        all.push(wide.moved(0, dy));
    }
    for color in colors {
        let near = color.box_mean(4, 4);
        all.extend([OFFSET_PX, -OFFSET_PX].map(|dy| near.moved(0, dy)));
    }
    all.push(spread(&brightness, 14));
    let mean = brightness.data.iter().sum::<f32>() / brightness.data.len().max(1) as f32;
    all.push(brightness.map(|v| v - mean));
    all
}

/// Computes the standard deviation in windows of this half-width.
fn spread(plane: &Plane, radius: usize) -> Plane {
    let mean = plane.box_mean(radius, radius);
    let square = plane.map(|v| v * v).box_mean(radius, radius);
    square.zip(&mean, |s, m| (s - m * m).max(0.0).sqrt())
}
