//! Decoding of a quad in an image, if it is a tag.

use super::family::TagFamilyName;
use kornia_apriltag::family::TagFamily;
use nalgebra::{Matrix3, Vector3};

/// A grayscale image, row by row.
pub struct Gray<'a> {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Brightness of each pixel.
    pub data: &'a [u8],
}

impl Gray<'_> {
    /// Returns the interpolated brightness at a position, pixels from the upper left corner; `None`
    /// outside.
    fn at(&self, [x, y]: [f64; 2]) -> Option<f64> {
        let x = x - 0.5;
        let y = y - 0.5;
        let is_inside = x >= 0.0 && y >= 0.0 && x < self.width as f64 - 1.0 && y < self.height as f64 - 1.0;
        let (column, row) = is_inside.then_some((x as usize, y as usize))?;
        let value = |c: usize, r: usize| self.data.get(r * self.width + c).map(|v| f64::from(*v));
        let s = x - column as f64;
        let t = y - row as f64;
        let above = value(column, row)? * (1.0 - s) + value(column + 1, row)? * s;
        let below = value(column, row + 1)? * (1.0 - s) + value(column + 1, row + 1)? * s;
        Some(above * (1.0 - t) + below * t)
    }
}

/// Result of decoding a quad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DecodedTag {
    /// Number of the tag.
    pub id: u16,
    /// Number of misread bits.
    pub errors: u8,
    /// Rotation of the tag in the quad, in quarter turns.
    pub quarters: u8,
    /// Decision margin: the mean distance of the bits from the threshold, of the white or of the
    /// black ones, whichever is less.
    pub margin: f64,
}

/// Codes of a family, and the positions of their bits.
pub struct Codes {
    cells: usize,
    /// Columns and rows of the bits within the border, in the order of the code.
    bits: Vec<[usize; 2]>,
    codes: Vec<u64>,
}

/// Share of a cell's difference from its neighbors that is added to it: the lens blurs small tags.
const SHARPENING: f64 = 0.25;

impl Codes {
    /// Creates the codes of a family.
    pub fn new(family: TagFamilyName) -> Codes {
        let all: TagFamily = family.kind().into();
        let place = |n: &i8| usize::try_from(*n).unwrap_or(0);
        let bits = all.bit_x.iter().zip(&all.bit_y).map(|(x, y)| [place(x), place(y)]).collect();
        let codes = all.code_data.iter().map(|code| *code as u64).collect();
        Codes { cells: family.cells_at_border(), bits, codes }
    }

    /// Decodes a quad; `None` if it is not a black border within a white one, or extends beyond the
    /// image.
    ///
    /// # Arguments
    /// * `place`: maps a position in the quad, with its border from -1 to 1, to the image.
    pub fn read(&self, gray: &Gray, place: impl Fn(f64, f64) -> [f64; 2]) -> Option<DecodedTag> {
        let side = self.cells + 2;
        let own = |k: usize| (k as f64 - 0.5) / self.cells as f64 * 2.0 - 1.0;
        let mut values = Vec::with_capacity(side * side);
        for (y, x) in (0..side).flat_map(|y| (0..side).map(move |x| (y, x))) {
            values.push(gray.at(place(own(x), own(y)))?);
        }
        let value = |x: usize, y: usize| values.get(y * side + x).copied().unwrap_or(0.0);
        let ring = |inset: usize| {
            let last = side - 1 - inset;
            let is_on = move |x: usize, y: usize| {
                (inset..=last).contains(&x)
                    && (inset..=last).contains(&y)
                    && (x == inset || y == inset || x == last || y == last)
            };
            let all = (0..side).flat_map(move |y| (0..side).map(move |x| (x, y)));
            all.filter(move |(x, y)| is_on(*x, *y)).map(|(x, y)| (own(x), own(y), value(x, y)))
        };
        let white = plane(ring(0))?;
        let black = plane(ring(1))?;
        let shade = |of: &Vector3<f64>, x: usize, y: usize| of.dot(&Vector3::new(own(x), own(y), 1.0));
        // Brightness of a cell, counted within the border, relative to the middle between black and
        // white.
        let above = |x: usize, y: usize| {
            let x = x + 1;
            let y = y + 1;
            let around = value(x - 1, y) + value(x + 1, y) + value(x, y - 1) + value(x, y + 1);
            value(x, y) + SHARPENING * (4.0 * value(x, y) - around) - (shade(&white, x, y) + shade(&black, x, y)) / 2.0
        };
        if white.z <= black.z {
            return None;
        }
        let mut sums = [0.0; 2];
        let mut counts = [0.0; 2];
        for [x, y] in &self.bits {
            let score = above(*x, *y);
            let k = if score > 0.0 { 0 } else { 1 };
            sums[k] += score.abs();
            counts[k] += 1.0;
        }
        let mean = |k: usize| if counts[k] > 0.0 { sums[k] / counts[k] } else { 0.0 };
        let margin = mean(0).min(mean(1)).min(255.0);
        let mut best: Option<DecodedTag> = None;
        for quarters in 0..4u8 {
            let code = self.bits.iter().fold(0u64, |code, [x, y]| {
                let [x, y] = (0..quarters).fold([*x, *y], |[x, y], _| [self.cells - 1 - y, x]);
                code << 1 | u64::from(above(x, y) > 0.0)
            });
            for (of, id) in self.codes.iter().zip(0u16..) {
                let errors = (of ^ code).count_ones() as u8;
                if best.is_none_or(|b| errors < b.errors) {
                    best = Some(DecodedTag { id, errors, quarters, margin });
                }
            }
        }
        best
    }
}

/// Fits the plane `a x + b y + c` to samples `(x, y, value)` by least squares.
fn plane(samples: impl Iterator<Item = (f64, f64, f64)>) -> Option<Vector3<f64>> {
    let mut normal = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for (x, y, value) in samples {
        let row = Vector3::new(x, y, 1.0);
        normal += row * row.transpose();
        right += row * value;
    }
    Some(normal.cholesky()?.solve(&right))
}
