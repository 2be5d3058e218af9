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
    // an input channel, and constants
    Input,
    Blank,
    Const,
    Nop,
    // two images
    Add,
    Sub,
    Mul,
    AbsDiff,
    Avg,
    Min,
    Max,
    // an image and a number
    AddC,
    SubC,
    MulC,
    MinC,
    MaxC,
    // each pixel by itself, and by the whole picture
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

/// What is beyond this is cut off; what is no number is 0.
const LARGEST: f32 = 1e6;

impl Op {
    /// How many images it takes.
    pub fn arity(self) -> usize {
        match self {
            Input | Blank | Const => 0,
            Add | Sub | Mul | AbsDiff | Avg | Min | Max => 2,
            _ => 1,
        }
    }

    /// Its image of one or two others. Unary functions use `a` alone; the result is finite.
    pub fn apply(self, node: &ImageNode, a: &Plane, b: &Plane) -> Plane {
        let (p, x, y) = (node.p0, node.p1, node.p2);
        // an aperture is odd, 3 to 17
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

/// The lesser of two numbers, in one instruction: `f32::min` also minds what is none.
#[inline(always)]
pub(super) fn lesser(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The greater of two numbers.
#[inline(always)]
pub(super) fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// What is beyond [`LARGEST`] is cut off; what is no number is 0.
#[inline(always)]
fn bounded(v: f32) -> f32 {
    let v = if v.is_nan() { 0.0 } else { v };
    greater(lesser(v, LARGEST), -LARGEST)
}

fn finite(mut a: Plane) -> Plane {
    a.data.iter_mut().for_each(|v| *v = bounded(*v));
    a
}

/// A function of every pixel, in one pass.
fn each(a: &Plane, f: impl Fn(f32) -> f32) -> Plane {
    a.map(|v| bounded(f(v)))
}

/// A function of the pixels of two images.
fn both(a: &Plane, b: &Plane, f: impl Fn(f32, f32) -> f32) -> Plane {
    a.zip(b, |a, b| bounded(f(a, b)))
}
