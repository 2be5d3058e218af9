//! The function set.

use super::super::plane::Plane;
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
        let out = match self {
            Input | Nop => a.clone(),
            Blank => Plane::filled(a.width, a.height, 0.0),
            Const => Plane::filled(a.width, a.height, p),
            Add => a.zip(b, |a, b| a + b),
            Sub => a.zip(b, |a, b| a - b),
            Mul => a.zip(b, |a, b| a * b),
            AbsDiff => a.zip(b, |a, b| (a - b).abs()),
            Avg => a.zip(b, |a, b| 0.5 * (a + b)),
            Min => a.zip(b, f32::min),
            Max => a.zip(b, f32::max),
            AddC => a.map(|a| a + p),
            SubC => a.map(|a| a - p),
            MulC => a.map(|a| a * p),
            MinC => a.map(|a| a.min(p)),
            MaxC => a.map(|a| a.max(p)),
            Log => a.map(f32::ln),
            Exp => a.map(f32::exp),
            Sqrt => a.map(f32::sqrt),
            Pow => a.map(|a| a.powf(p)),
            Normalize => filters::normalized(a),
            Equalize => filters::equalized(a),
            MinValue => Plane::filled(a.width, a.height, filters::range(a).0),
            MaxValue => Plane::filled(a.width, a.height, filters::range(a).1),
            MeanValue => Plane::filled(a.width, a.height, filters::mean(a)),
            Threshold => a.map(|a| if a > p { 255.0 } else { 0.0 }),
            ThresholdInv => a.map(|a| if a > p { 0.0 } else { 255.0 }),
            Dilate => local::extreme(a, times, times, f32::max),
            Erode => local::extreme(a, times, times, f32::min),
            Gauss => filters::gauss(a, aperture(x), aperture(x)),
            GaussXy => filters::gauss(a, aperture(x), aperture(y)),
            Median => local::median(a, if x.unsigned_abs() < 5 { 1 } else { 2 }),
            Bilateral => local::bilateral(a, aperture(x).min(7) / 2),
            BoxBlur => a.box_mean(aperture(x) / 2, aperture(x) / 2),
            SobelX => filters::sobel(a).0,
            SobelY => filters::sobel(a).1,
            Sobel => {
                let (across, down) = filters::sobel(a);
                across.zip(&down, |x, y| x.hypot(y))
            }
            Laplace => filters::laplace(a, aperture(x)),
            Canny => filters::canny(a, p, 10.0),
            Unsharpen => a.zip(&filters::gauss(a, aperture(x), aperture(x)), |a, g| a + 1.5 * (a - g)),
            LocalMin => local::extreme(a, window(x), window(y), f32::min),
            LocalMax => local::extreme(a, window(x), window(y), f32::max),
            LocalMean => a.box_mean(window(x), window(y)),
            LocalNormalize => local::normalized(a, window(x), window(y)),
            Shift => filters::wrapped(a, x.into(), y.into()),
            ShiftUp => filters::wrapped(a, 0, -1),
            ShiftDown => filters::wrapped(a, 0, 1),
            ShiftLeft => filters::wrapped(a, -1, 0),
            ShiftRight => filters::wrapped(a, 1, 0),
            Rescale => {
                let by = 2 + (x.unsigned_abs() as usize) % 3;
                a.shrunk(by).grown(by, a.width, a.height)
            }
            Gabor => filters::gabor(a, node.frequency, node.angle),
            ResizeGabor => filters::gabor(&a.shrunk(2), node.frequency, node.angle).grown(2, a.width, a.height),
        };
        let mut out = out;
        out.data.iter_mut().for_each(|v| *v = if v.is_nan() { 0.0 } else { v.clamp(-LARGEST, LARGEST) });
        out
    }
}
