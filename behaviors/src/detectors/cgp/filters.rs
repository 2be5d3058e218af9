//! Filters by convolution, by the whole picture's values, and moves. At the border, pictures go on with their border's values.

use super::super::plane::Plane;
use std::f32::consts::PI;

/// The least and the greatest value.
pub(super) fn range(a: &Plane) -> (f32, f32) {
    a.data.iter().fold((f32::MAX, f32::MIN), |(l, m), v| (l.min(*v), m.max(*v)))
}

/// The mean of all values.
pub(super) fn mean(a: &Plane) -> f32 {
    a.data.iter().sum::<f32>() / a.data.len().max(1) as f32
}

/// Stretched to 0 to 255; a constant becomes 0.
pub(super) fn normalized(a: &Plane) -> Plane {
    let (least, most) = range(a);
    let by = if most > least { 255.0 / (most - least) } else { 0.0 };
    a.map(|v| (v - least) * by)
}

/// Values 0 to 255 replaced by the share of pixels that are not above them, 0 to 255.
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

/// Smoothed by a Gaussian of these odd apertures, with the width that such an aperture usually has.
pub(super) fn gauss(a: &Plane, kx: usize, ky: usize) -> Plane {
    let kernel = |k: usize| -> Vec<f32> {
        let sigma = 0.3 * ((k as f32 - 1.0) * 0.5 - 1.0) + 0.8;
        let weight = |i: usize| (-(i as f32 - (k / 2) as f32).powi(2) / (2.0 * sigma * sigma)).exp();
        let sum: f32 = (0..k).map(weight).sum();
        (0..k).map(|i| weight(i) / sum).collect()
    };
    separable(a, &kernel(kx), &kernel(ky))
}

/// Convolved with odd kernels across and down.
fn separable(a: &Plane, across: &[f32], down: &[f32]) -> Plane {
    let (w, h) = (a.width, a.height);
    let r = across.len() / 2;
    let mut middle = vec![0.0f32; w * h];
    let mut padded = vec![0.0f32; w + 2 * r];
    for (row, to) in a.rows().zip(middle.chunks_exact_mut(w)) {
        padded[..r].fill(row[0]);
        padded[r..r + w].copy_from_slice(row);
        padded[r + w..].fill(row[w - 1]);
        for (k, weight) in across.iter().enumerate() {
            to.iter_mut().zip(&padded[k..k + w]).for_each(|(to, v)| *to += weight * v);
        }
    }
    let r = down.len() / 2;
    let mut out = vec![0.0f32; w * h];
    for (y, to) in out.chunks_exact_mut(w).enumerate() {
        for (k, weight) in down.iter().enumerate() {
            let y = (y + k).saturating_sub(r).min(h - 1);
            to.iter_mut().zip(&middle[y * w..(y + 1) * w]).for_each(|(to, v)| *to += weight * v);
        }
    }
    a.like(out)
}

/// Slopes across and down.
pub(super) fn sobel(a: &Plane) -> (Plane, Plane) {
    let (slope, smooth) = ([-1.0, 0.0, 1.0], [1.0, 2.0, 1.0]);
    (separable(a, &slope, &smooth), separable(a, &smooth, &slope))
}

/// The sum of second slopes, after smoothing if the aperture is above 3.
pub(super) fn laplace(a: &Plane, k: usize) -> Plane {
    let smooth = if k > 3 { gauss(a, k, k) } else { a.clone() };
    let (bend, only) = ([1.0, -2.0, 1.0], [1.0]);
    separable(&smooth, &bend, &only).zip(&separable(&smooth, &only, &bend), |x, y| x + y)
}

/// Edges as 255 (Canny 1986): steepest along the slope, and at least `low` steep where joined with what is at least `high` steep.
pub(super) fn canny(a: &Plane, high: f32, low: f32) -> Plane {
    let (low, high) = (low.min(high), low.max(high));
    let (across, down) = sobel(a);
    let steep = across.zip(&down, |x, y| x.abs() + y.abs());
    let (w, h) = (a.width, a.height);
    let mut out = Plane::filled(w, h, 0.0);
    let mut open = Vec::new();
    let mut is_edge = vec![false; w * h];
    for y in 1..h.saturating_sub(1) {
        for x in 1..w.saturating_sub(1) {
            let i = y * w + x;
            let (sx, sy, m) = (across.data[i], down.data[i], steep.data[i]);
            // the two neighbors along the slope, by its octant
            let step = match (sx.abs(), sy.abs()) {
                (x, y) if y <= 0.414 * x => 1,
                (x, y) if x <= 0.414 * y => w,
                _ if (sx > 0.0) == (sy > 0.0) => w + 1,
                _ => w - 1,
            };
            is_edge[i] = m > low && m > steep.data[i - step] && m >= steep.data[i + step];
            if is_edge[i] && m > high {
                out.data[i] = 255.0;
                open.push(i);
            }
        }
    }
    while let Some(i) = open.pop() {
        for j in [i - w - 1, i - w, i - w + 1, i - 1, i + 1, i + w - 1, i + w, i + w + 1] {
            if is_edge[j] && out.data[j] == 0.0 {
                out.data[j] = 255.0;
                open.push(j);
            }
        }
    }
    out
}

/// Moved to the right and down; what leaves the picture comes in at the other side.
pub(super) fn wrapped(a: &Plane, dx: isize, dy: isize) -> Plane {
    let mut out = Vec::with_capacity(a.data.len());
    let (w, h) = (a.width, a.height);
    let left = (-dx).rem_euclid(w as isize) as usize;
    for y in 0..h {
        let from = (y as isize - dy).rem_euclid(h as isize) as usize * w;
        let row = &a.data[from..from + w];
        out.extend_from_slice(&row[left..]);
        out.extend_from_slice(&row[..left]);
    }
    a.like(out)
}

/// The strength of waves of a frequency (0 to 16) and orientation (eighths of half a turn), in 9x9 pixels.
pub(super) fn gabor(a: &Plane, frequency: u8, angle: i8) -> Plane {
    let variance = 2.0 * PI * PI;
    let k = PI * 2f32.powf(-(f32::from(frequency.min(16)) + 2.0) / 2.0);
    let (sin, cos) = (f32::from(angle) * PI / 8.0).sin_cos();
    let (w, h) = (a.width, a.height);
    let (mut real, mut imaginary) = (vec![0.0f32; w * h], vec![0.0f32; w * h]);
    let padded: Vec<f32> = a
        .rows()
        .flat_map(|row| {
            let side = |v: f32| std::iter::repeat_n(v, 4);
            side(row[0]).chain(row.iter().copied()).chain(side(row[w - 1]))
        })
        .collect();
    for dy in 0..9usize {
        for dx in 0..9usize {
            let (x, y) = (dx as f32 - 4.0, dy as f32 - 4.0);
            let bell = k * k / variance * (-k * k * (x * x + y * y) / (2.0 * variance)).exp();
            let wave = k * (cos * x + sin * y);
            let (re, im) = (bell * (wave.cos() - (-variance / 2.0).exp()), bell * wave.sin());
            for (row, (real, imaginary)) in real.chunks_exact_mut(w).zip(imaginary.chunks_exact_mut(w)).enumerate() {
                let from = (row + dy).saturating_sub(4).min(h - 1) * (w + 8) + dx;
                for ((r, i), v) in real.iter_mut().zip(imaginary).zip(&padded[from..from + w]) {
                    *r += re * v;
                    *i += im * v;
                }
            }
        }
    }
    a.like(real.iter().zip(&imaginary).map(|(r, i)| (r * r + i * i).sqrt()).collect())
}
