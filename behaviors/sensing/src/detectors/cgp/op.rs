//! The function set.

use super::super::plane::Plane;
use super::numbers::{exp, ln, sign_of_power};
use super::program::ImageNode;
use super::{filters, local};
use serde::{Deserialize, Serialize};

/// An image function.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it; `apply` has the rest")]
pub enum Op {
    // An input channel, and constants.
    Input,
    Blank,
    Const,
    Nop,
    // Two images.
    Add,
    Sub,
    Mul,
    AbsDiff,
    Avg,
    Min,
    Max,
    // An image and a number.
    AddC,
    SubC,
    MulC,
    MinC,
    MaxC,
    // Each pixel by itself, and with the values of the whole image.
    Log,
    Exp,
    Sqrt,
    Pow,
    Normalize,
    Equalize,
    MinValue,
    MaxValue,
    MeanValue,
    Threshold,
    ThresholdInv,
    Dilate,
    Erode,
    Gauss,
    GaussXy,
    Median,
    Bilateral,
    BoxBlur,
    SobelX,
    SobelY,
    Sobel,
    Laplace,
    Canny,
    Unsharpen,
    LocalMin,
    LocalMax,
    LocalMean,
    LocalNormalize,
    Shift,
    ShiftUp,
    ShiftDown,
    ShiftLeft,
    ShiftRight,
    Rescale,
    Gabor,
    ResizeGabor,
}

use Op::*;

/// All functions.
#[rustfmt::skip]
pub const ALL_OPS: [Op; 52] = [
    Input, Blank, Const, Nop, Add, Sub, Mul, AbsDiff, Avg, Min, Max, AddC, SubC, MulC, MinC, MaxC, Log, Exp, Sqrt, Pow, Normalize,
    Equalize, MinValue, MaxValue, MeanValue, Threshold, ThresholdInv, Dilate, Erode, Gauss, GaussXy, Median, Bilateral, BoxBlur,
    SobelX, SobelY, Sobel, Laplace, Canny, Unsharpen, LocalMin, LocalMax, LocalMean, LocalNormalize, Shift, ShiftUp, ShiftDown,
    ShiftLeft, ShiftRight, Rescale, Gabor, ResizeGabor,
];

/// Maximum absolute value of a result; larger ones are clamped, and NaN becomes 0.
const MAX_VALUE: f32 = 1e6;

impl Op {
    /// Number of images that it takes.
    pub fn arity(self) -> usize {
        match self {
            Input | Blank | Const => 0,
            Add | Sub | Mul | AbsDiff | Avg | Min | Max => 2,
            _ => 1,
        }
    }

    /// Applies the function to one or two images. Unary functions use `a` alone; the result is
    /// finite.
    pub fn apply(self, node: &ImageNode, a: &Plane, b: &Plane) -> Plane {
        let p = node.p0;
        let x = node.p1;
        let y = node.p2;
        // Apertures are odd, 3 to 17.
        let aperture = |k: i8| (k.unsigned_abs() as usize | 1).clamp(3, 17);
        let window = |k: i8| (k.unsigned_abs() as usize).clamp(1, 16);
        let times = (x.unsigned_abs() as usize).clamp(1, 8);
        match self {
            Input | Nop => a.clone(),
            Blank => Plane::filled(a.width, a.height, 0.0),
            Const => Plane::filled(a.width, a.height, bounded(p)),
            Add => both(a, b, |a, b| a + b),
            Sub => both(a, b, |a, b| a - b),
            Mul => both(a, b, |a, b| a * b),
            AbsDiff => both(a, b, |a, b| (a - b).abs()),
            Avg => both(a, b, |a, b| 0.5 * (a + b)),
            Min => both(a, b, lesser),
            Max => both(a, b, greater),
            AddC => each(a, |a| a + p),
            SubC => each(a, |a| a - p),
            MulC => each(a, |a| a * p),
            MinC => each(a, |a| lesser(a, p)),
            MaxC => each(a, |a| greater(a, p)),
            Log => each(a, ln),
            Exp => each(a, exp),
            Sqrt => each(a, f32::sqrt),
            Pow => {
                let sign = sign_of_power(p);
                let size = each(a, |a| ln(a.abs())).map(|l| exp(p * l));
                both(a, &size, |a, size| size * if a < 0.0 { sign } else { 1.0 })
            }
            Normalize => finite(filters::normalized(a)),
            Equalize => filters::equalized(a),
            MinValue => Plane::filled(a.width, a.height, bounded(filters::range(a).0)),
            MaxValue => Plane::filled(a.width, a.height, bounded(filters::range(a).1)),
            MeanValue => Plane::filled(a.width, a.height, bounded(filters::mean(a))),
            Threshold => a.map(|a| if a > p { 255.0 } else { 0.0 }),
            ThresholdInv => a.map(|a| if a > p { 0.0 } else { 255.0 }),
            Dilate => finite(local::extreme(a, times, times, greater)),
            Erode => finite(local::extreme(a, times, times, lesser)),
            Gauss => finite(filters::gauss(a, aperture(x), aperture(x))),
            GaussXy => finite(filters::gauss(a, aperture(x), aperture(y))),
            Median => finite(local::median(a, if x.unsigned_abs() < 5 { 1 } else { 2 })),
            Bilateral => finite(local::bilateral(a, aperture(x).min(7) / 2)),
            BoxBlur => finite(a.box_mean(aperture(x) / 2, aperture(x) / 2)),
            SobelX => finite(filters::sobel_x(a)),
            SobelY => finite(filters::sobel_y(a)),
            Sobel => both(&filters::sobel_x(a), &filters::sobel_y(a), |x, y| (x * x + y * y).sqrt()),
            Laplace => finite(filters::laplace(a, aperture(x))),
            Canny => filters::canny(a, p, 10.0),
            Unsharpen => both(a, &filters::gauss(a, aperture(x), aperture(x)), |a, g| a + 1.5 * (a - g)),
            LocalMin => finite(local::extreme(a, window(x), window(y), lesser)),
            LocalMax => finite(local::extreme(a, window(x), window(y), greater)),
            LocalMean => finite(a.box_mean(window(x), window(y))),
            LocalNormalize => finite(local::normalized(a, window(x), window(y))),
            Shift => finite(filters::wrapped(a, x.into(), y.into())),
            ShiftUp => finite(filters::wrapped(a, 0, -1)),
            ShiftDown => finite(filters::wrapped(a, 0, 1)),
            ShiftLeft => finite(filters::wrapped(a, -1, 0)),
            ShiftRight => finite(filters::wrapped(a, 1, 0)),
            Rescale => {
                let by = 2 + (x.unsigned_abs() as usize) % 3;
                finite(a.shrunk(by).grown(by, a.width, a.height))
            }
            Gabor => finite(filters::gabor(a, node.frequency, node.angle)),
            ResizeGabor => finite(filters::gabor(&a.shrunk(2), node.frequency, node.angle).grown(2, a.width, a.height)),
        }
    }
}

/// Returns the lesser of two numbers, in one instruction: `f32::min` also handles NaN.
#[inline(always)]
pub(super) fn lesser(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Returns the greater of two numbers.
#[inline(always)]
pub(super) fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Clamps to [`MAX_VALUE`]; NaN becomes 0.
#[inline(always)]
fn bounded(v: f32) -> f32 {
    let v = if v.is_nan() { 0.0 } else { v };
    greater(lesser(v, MAX_VALUE), -MAX_VALUE)
}

fn finite(mut a: Plane) -> Plane {
    a.data.iter_mut().for_each(|v| *v = bounded(*v));
    a
}

/// Applies a function to every pixel, in one pass.
fn each(a: &Plane, f: impl Fn(f32) -> f32) -> Plane {
    a.map(|v| bounded(f(v)))
}

/// Applies a function to the pixels of two images.
fn both(a: &Plane, b: &Plane, f: impl Fn(f32, f32) -> f32) -> Plane {
    a.zip(b, |a, b| bounded(f(a, b)))
}
