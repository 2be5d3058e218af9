//! Convolution filters, filters by the values of the whole image, and shifts. The border's values
//! are repeated beyond the border.

use super::super::plane::Plane;
use std::f32::consts::PI;

/// Returns the minimum and the maximum.
pub(super) fn range(a: &Plane) -> (f32, f32) {
    a.data.iter().fold((f32::MAX, f32::MIN), |(l, m), v| (l.min(*v), m.max(*v)))
}

/// Returns the mean of all values.
pub(super) fn mean(a: &Plane) -> f32 {
    a.data.iter().sum::<f32>() / a.data.len().max(1) as f32
}

/// Scales the values to 0 to 255; a constant image becomes 0.
pub(super) fn normalized(a: &Plane) -> Plane {
    let (least, most) = range(a);
    let by = if most > least { 255.0 / (most - least) } else { 0.0 };
    a.map(|v| (v - least) * by)
}

/// Equalizes the histogram: replaces each value, 0 to 255, by the share of pixels not above it, 0
/// to 255.
pub(super) fn equalized(a: &Plane) -> Plane {
    let mut counts = [0u32; 256];
    a.data.iter().for_each(|v| counts[*v as u8 as usize] += 1);
    let mut sum = 0;
    let share = counts.map(|n| {
        sum += n;
        255.0 * sum as f32 / a.data.len().max(1) as f32
    });
    a.map(|v| share[v as u8 as usize])
}

/// Smooths by a Gaussian of these odd apertures, with the standard deviation usual for each
/// aperture.
pub(super) fn gauss(a: &Plane, kx: usize, ky: usize) -> Plane {
    let kernel = |k: usize| -> Vec<f32> {
        let sigma = 0.3 * ((k as f32 - 1.0) * 0.5 - 1.0) + 0.8;
        let weight = |i: usize| (-(i as f32 - (k / 2) as f32).powi(2) / (2.0 * sigma * sigma)).exp();
        let sum: f32 = (0..k).map(weight).sum();
        (0..k).map(|i| weight(i) / sum).collect()
    };
    separable(a, &kernel(kx), &kernel(ky))
}

/// Number of adjacent pixels that are summed in registers.
const BLOCK: usize = 32;

/// Computes the weighted sum of a window's slices in `to`, which must be zero; `slice(k)` belongs to
/// the `k`th weight.
fn weighted<'a>(to: &mut [f32], weights: &[f32], slice: impl Fn(usize) -> &'a [f32]) {
    let (blocks, rest) = to.as_chunks_mut::<BLOCK>();
    let done = blocks.len() * BLOCK;
    for (i, block) in blocks.iter_mut().enumerate() {
        let mut sum = [0.0f32; BLOCK];
        for (k, weight) in weights.iter().enumerate() {
            let Some(values) = slice(k).get(i * BLOCK..).and_then(<[f32]>::first_chunk::<BLOCK>) else { continue };
            sum.iter_mut().zip(values).for_each(|(sum, v)| *sum += weight * v);
        }
        *block = sum;
    }
    for (k, weight) in weights.iter().enumerate() {
        rest.iter_mut().zip(&slice(k)[done..]).for_each(|(to, v)| *to += weight * v);
    }
}

/// Copies a row to `to` with `r` repetitions of its border values on each side.
pub(super) fn padded(row: &[f32], r: usize, to: &mut Vec<f32>) {
    to.clear();
    to.extend(std::iter::repeat_n(row[0], r));
    to.extend_from_slice(row);
    to.extend(std::iter::repeat_n(row[row.len() - 1], r));
}

/// Convolves the rows with odd kernels of equal length, once with each.
fn across<const N: usize>(a: &Plane, kernels: [&[f32]; N]) -> [Vec<f32>; N] {
    let w = a.width;
    let r = kernels[0].len() / 2;
    let mut out = [0; N].map(|_| vec![0.0f32; a.data.len()]);
    let mut wide = Vec::with_capacity(w + 2 * r);
    for (y, row) in a.rows().enumerate() {
        padded(row, r, &mut wide);
        for (out, kernel) in out.iter_mut().zip(kernels) {
            weighted(&mut out[y * w..(y + 1) * w], kernel, |k| &wide[k..k + w]);
        }
    }
    out
}

/// Computes a row of the sum of planes that are convolved along their columns, each with its odd
/// kernel.
fn down(to: &mut [f32], y: usize, h: usize, parts: &[(&[f32], &[f32])]) {
    let w = to.len();
    let weights: Vec<f32> = parts.iter().flat_map(|(_, kernel)| kernel.iter().copied()).collect();
    let rows: Vec<&[f32]> = parts
        .iter()
        .flat_map(|(plane, kernel)| {
            (0..kernel.len()).map(move |k| {
                let y = (y + k).saturating_sub(kernel.len() / 2).min(h - 1);
                &plane[y * w..(y + 1) * w]
            })
        })
        .collect();
    weighted(to, &weights, |k| rows[k]);
}

/// Convolves with odd kernels along rows and columns.
fn separable(a: &Plane, first: &[f32], then: &[f32]) -> Plane {
    let [middle] = across(a, [first]);
    let mut out = vec![0.0f32; a.data.len()];
    for (y, to) in out.chunks_exact_mut(a.width).enumerate() {
        down(to, y, a.height, &[(&middle, then)]);
    }
    a.like(out)
}

const SLOPE: [f32; 3] = [-1.0, 0.0, 1.0];
const SMOOTH: [f32; 3] = [1.0, 2.0, 1.0];

/// Computes the horizontal derivative.
pub(super) fn sobel_x(a: &Plane) -> Plane {
    separable(a, &SLOPE, &SMOOTH)
}

/// Computes the vertical derivative.
pub(super) fn sobel_y(a: &Plane) -> Plane {
    separable(a, &SMOOTH, &SLOPE)
}

/// Computes the sum of the second derivatives, after smoothing if the aperture is above 3.
pub(super) fn laplace(a: &Plane, k: usize) -> Plane {
    let smooth = if k > 3 { gauss(a, k, k) } else { a.clone() };
    let bend = [1.0, -2.0, 1.0];
    let only = [1.0];
    separable(&smooth, &bend, &only).zip(&separable(&smooth, &only, &bend), |x, y| x + y)
}

/// Detects edges, as 255 (Canny 1986): local maxima of the gradient along its direction, at least
/// `low` if connected to one of at least `high`.
pub(super) fn canny(a: &Plane, high: f32, low: f32) -> Plane {
    let (low, high) = (low.min(high), low.max(high));
    let across = sobel_x(a);
    let down = sobel_y(a);
    let steep = across.zip(&down, |x, y| x.abs() + y.abs());
    let w = a.width;
    let h = a.height;
    let mut out = Plane::filled(w, h, 0.0);
    if w < 3 || h < 3 {
        return out;
    }
    // 255 at local maxima.
    let mut ridge = vec![0.0f32; w * h];
    for y in 1..h - 1 {
        // The values at this offset from each pixel of the row except the first and the last.
        let from = |by: isize| {
            let at = (y * w + 1).wrapping_add_signed(by);
            &steep.data[at..at + w - 2]
        };
        let row = w as isize;
        let here = y * w + 1..(y + 1) * w - 1;
        let slopes = across.data[here.clone()].iter().zip(&down.data[here.clone()]);
        let level = from(-1).iter().zip(from(1));
        let upright = from(-row).iter().zip(from(row));
        let falling = from(-row - 1).iter().zip(from(row + 1));
        let rising = from(1 - row).iter().zip(from(row - 1));
        let all = slopes.zip(level).zip(upright).zip(falling).zip(rising).zip(from(0));
        for (to, (((((slope, level), upright), falling), rising), m)) in ridge[here].iter_mut().zip(all) {
            let (x, y) = (slope.0.abs(), slope.1.abs());
            // The two neighbors along the gradient, by its octant.
            let slanted = if (*slope.0 > 0.0) == (*slope.1 > 0.0) { falling } else { rising };
            let steepest = if x <= 0.414 * y { upright } else { slanted };
            let (before, after) = if y <= 0.414 * x { level } else { steepest };
            *to = if (*m > low) & (m > before) & (m >= after) { 255.0 } else { 0.0 };
        }
    }
    let mut open = Vec::new();
    for (i, _) in ridge.iter().zip(&steep.data).enumerate().filter(|(_, (ridge, m))| **ridge > 0.0 && **m > high) {
        out.data[i] = 255.0;
        open.push(i);
    }
    while let Some(i) = open.pop() {
        for j in [i - w - 1, i - w, i - w + 1, i - 1, i + 1, i + w - 1, i + w, i + w + 1] {
            if ridge[j] > 0.0 && out.data[j] == 0.0 {
                out.data[j] = 255.0;
                open.push(j);
            }
        }
    }
    out
}

/// Shifts the image to the right and down; what leaves it enters at the opposite side.
pub(super) fn wrapped(a: &Plane, dx: isize, dy: isize) -> Plane {
    let mut out = Vec::with_capacity(a.data.len());
    let w = a.width;
    let h = a.height;
    let left = (-dx).rem_euclid(w as isize) as usize;
    for y in 0..h {
        let from = (y as isize - dy).rem_euclid(h as isize) as usize * w;
        let row = &a.data[from..from + w];
        out.extend_from_slice(&row[left..]);
        out.extend_from_slice(&row[..left]);
    }
    a.like(out)
}

/// Computes the magnitude of a Gabor filter of a frequency (0 to 16) and orientation (multiples of
/// 22.5 degrees) in 9x9 pixels.
///
/// A wave is a sum of products of one horizontal and one vertical factor, as is its Gaussian
/// envelope: nine weights of each suffice.
pub(super) fn gabor(a: &Plane, frequency: u8, angle: i8) -> Plane {
    let variance = 2.0 * PI * PI;
    let k = PI * 2f32.powf(-(f32::from(frequency.min(16)) + 2.0) / 2.0);
    let (sin, cos) = (f32::from(angle) * PI / 8.0).sin_cos();
    let of = |by: &dyn Fn(f32) -> f32| -> [f32; 9] {
        std::array::from_fn(|i| {
            let x = i as f32 - 4.0;
            (-k * k * x * x / (2.0 * variance)).exp() * by(x)
        })
    };
    let [c, s, bell] = across(a, [&of(&|x| (k * cos * x).cos()), &of(&|x| (k * cos * x).sin()), &of(&|_| 1.0)]);
    let size = k * k / variance;
    let cosine = of(&|y| size * (k * sin * y).cos());
    let sine = of(&|y| size * (k * sin * y).sin());
    let minus_sine = sine.map(|v| -v);
    // Subtract the response to a constant image.
    let constant = of(&|_| -size * (-variance / 2.0).exp());
    let mut out = vec![0.0f32; a.data.len()];
    let mut imaginary = vec![0.0f32; a.width];
    for (y, real) in out.chunks_exact_mut(a.width).enumerate() {
        down(real, y, a.height, &[(&c, &cosine), (&s, &minus_sine), (&bell, &constant)]);
        imaginary.fill(0.0);
        down(&mut imaginary, y, a.height, &[(&c, &sine), (&s, &cosine)]);
        real.iter_mut().zip(&imaginary).for_each(|(r, i)| *r = (*r * *r + i * i).sqrt());
    }
    a.like(out)
}
