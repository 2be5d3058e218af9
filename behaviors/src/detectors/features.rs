//! What a small network is told about a pixel: color and texture in windows of several sizes around it, and what is a little
//! above, below and beside it. Never where in the picture it is: an object may be anywhere in later frames.

use super::plane::{Plane, brightness};

/// Numbers per pixel.
pub const FEATURES: usize = 36;

/// How far away it looks at its surroundings, pixels.
const ASIDE: isize = 12;

/// The features of all pixels, one plane each.
///
/// `likelihood` is what the colors alone say, [`ColorTable::look`](super::color::ColorTable::look).
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
    for (dx, dy) in [(ASIDE, 0), (-ASIDE, 0), (0, ASIDE), (0, -ASIDE)] {
        all.push(near.moved(dx, dy));
    }
    let wide = likelihood.box_mean(12, 12);
    for dy in [2 * ASIDE, -2 * ASIDE] {
        all.push(wide.moved(0, dy));
    }
    for color in colors {
        let near = color.box_mean(4, 4);
        all.extend([ASIDE, -ASIDE].map(|dy| near.moved(0, dy)));
    }
    all.push(spread(&brightness, 14));
    let mean = brightness.data.iter().sum::<f32>() / brightness.data.len().max(1) as f32;
    all.push(brightness.map(|v| v - mean));
    all
}

/// The standard deviation in windows of this half-width.
fn spread(plane: &Plane, radius: usize) -> Plane {
    let mean = plane.box_mean(radius, radius);
    let square = plane.map(|v| v * v).box_mean(radius, radius);
    square.zip(&mean, |s, m| (s - m * m).max(0.0).sqrt())
}
