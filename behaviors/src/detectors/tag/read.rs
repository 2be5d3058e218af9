//! What a quad in a picture says, if it is a tag.

use super::family::TagFamilyName;
use kornia_apriltag::family::TagFamily;
use nalgebra::{Matrix3, Vector3};

/// A gray picture, row by row.
pub struct Gray<'a> {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// The brightness of each pixel.
    pub data: &'a [u8],
}

impl Gray<'_> {
    /// The brightness at a place, pixels from the upper left corner, interpolated; `None` outside.
    fn at(&self, [x, y]: [f64; 2]) -> Option<f64> {
        let (x, y) = (x - 0.5, y - 0.5);
        let is_inside = x >= 0.0 && y >= 0.0 && x < self.width as f64 - 1.0 && y < self.height as f64 - 1.0;
        let (column, row) = is_inside.then_some((x as usize, y as usize))?;
        let value = |c: usize, r: usize| self.data.get(r * self.width + c).map(|v| f64::from(*v));
        let (s, t) = (x - column as f64, y - row as f64);
        let above = value(column, row)? * (1.0 - s) + value(column + 1, row)? * s;
        let below = value(column, row + 1)? * (1.0 - s) + value(column + 1, row + 1)? * s;
        Some(above * (1.0 - t) + below * t)
    }
}

/// What was read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Which tag it is.
    pub id: u16,
    /// How many bits were read wrong.
    pub errors: u8,
    /// By how many quarters the tag is turned in the quad.
    pub quarters: u8,
    /// The mean distance of its bits from being read otherwise, of the white or of the black ones, whichever is less.
    pub margin: f64,
}

/// The codes of a family, and where their bits are.
pub struct Codes {
    cells: usize,
    /// Columns and rows of the bits within the border, the first bit first.
    bits: Vec<[usize; 2]>,
    codes: Vec<u64>,
}

/// How much of what a cell differs from its neighbors is added to it: the lens blurs small tags.
const SHARPER: f64 = 0.25;

impl Codes {
    /// Those of a family.
    pub fn new(family: TagFamilyName) -> Codes {
        let all: TagFamily = family.kind().into();
        let place = |n: &i8| usize::try_from(*n).unwrap_or(0);
        let bits = all.bit_x.iter().zip(&all.bit_y).map(|(x, y)| [place(x), place(y)]).collect();
        let codes = all.code_data.iter().map(|code| *code as u64).collect();
        Codes { cells: family.cells_at_border(), bits, codes }
    }

    /// What a quad says; `None` if it is no black border within a white one, or reaches out of the picture.
    ///
    /// # Arguments
    /// * `place`: where in the picture a place of the quad is, whose border is from -1 to 1.
    pub fn read(&self, gray: &Gray, place: impl Fn(f64, f64) -> [f64; 2]) -> Option<Reading> {
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
        let (white, black) = (plane(ring(0))?, plane(ring(1))?);
        let shade = |of: &Vector3<f64>, x: usize, y: usize| of.dot(&Vector3::new(own(x), own(y), 1.0));
        // by how much a cell, counted within the border, is above the middle between black and white
        let above = |x: usize, y: usize| {
            let (x, y) = (x + 1, y + 1);
            let around = value(x - 1, y) + value(x + 1, y) + value(x, y - 1) + value(x, y + 1);
            value(x, y) + SHARPER * (4.0 * value(x, y) - around) - (shade(&white, x, y) + shade(&black, x, y)) / 2.0
        };
        if white.z <= black.z {
            return None;
        }
        let (mut sums, mut counts) = ([0.0; 2], [0.0; 2]);
        for [x, y] in &self.bits {
            let score = above(*x, *y);
            let (sum, count) =
                if score > 0.0 { (&mut sums[0], &mut counts[0]) } else { (&mut sums[1], &mut counts[1]) };
            (*sum, *count) = (*sum + score.abs(), *count + 1.0);
        }
        let mean = |k: usize| if counts[k] > 0.0 { sums[k] / counts[k] } else { 0.0 };
        let margin = mean(0).min(mean(1)).min(255.0);
        let mut best: Option<Reading> = None;
        for quarters in 0..4u8 {
            let code = self.bits.iter().fold(0u64, |code, [x, y]| {
                let [x, y] = (0..quarters).fold([*x, *y], |[x, y], _| [self.cells - 1 - y, x]);
                code << 1 | u64::from(above(x, y) > 0.0)
            });
            for (of, id) in self.codes.iter().zip(0u16..) {
                let errors = (of ^ code).count_ones() as u8;
                if best.is_none_or(|b| errors < b.errors) {
                    best = Some(Reading { id, errors, quarters, margin });
                }
            }
        }
        best
    }
}

/// The plane `a x + b y + c` that fits samples `(x, y, value)` best.
fn plane(samples: impl Iterator<Item = (f64, f64, f64)>) -> Option<Vector3<f64>> {
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (x, y, value) in samples {
        let row = Vector3::new(x, y, 1.0);
        normal += row * row.transpose();
        right += row * value;
    }
    Some(normal.cholesky()?.solve(&right))
}
