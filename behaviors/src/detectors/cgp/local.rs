//! Functions of a window around each pixel that are no convolutions. At the border, windows are cut.

use super::super::plane::Plane;

/// The extreme value in windows of `2 rx + 1` by `2 ry + 1` pixels.
pub(super) fn extreme(a: &Plane, rx: usize, ry: usize, of: impl Fn(f32, f32) -> f32) -> Plane {
    let across = spans(a, rx, true, &of);
    spans(&across, ry, false, &of)
}

/// Extremes along rows or columns. A span of any length is two overlapping ones whose lengths are a power of two.
fn spans(a: &Plane, r: usize, along_rows: bool, of: &impl Fn(f32, f32) -> f32) -> Plane {
    let (mut now, mut length) = (a.clone(), 1);
    // `now` holds extremes of `length` pixels from each on; moving clamps, which repeats what is in the window already
    let moved = |p: &Plane, by: isize| if along_rows { p.moved(by, 0) } else { p.moved(0, by) };
    let whole = 2 * r + 1;
    while 2 * length <= whole {
        now = now.zip(&moved(&now, -(length as isize)), of);
        length *= 2;
    }
    let rest = whole - length;
    if rest > 0 {
        now = now.zip(&moved(&now, -(rest as isize)), of);
    }
    // from the window's first pixel to its middle; near the border the windows that begin before it are made anew
    let mut out = moved(&now, r as isize);
    let (w, h) = (a.width, a.height);
    let (lines, stride, next, n) = if along_rows { (h, w, 1, w) } else { (w, 1, w, h) };
    for line in 0..lines {
        for i in 0..r.min(n) {
            let at = |i: usize| a.data[line * stride + i * next];
            out.data[line * stride + i * next] = (0..(i + r + 1).min(n)).map(at).fold(at(i), of);
        }
    }
    out
}

/// The median in windows of `2 r + 1` by `2 r + 1` pixels.
pub(super) fn median(a: &Plane, r: usize) -> Plane {
    let mut seen: Vec<f32> = Vec::with_capacity(25);
    let mut out = Vec::with_capacity(a.data.len());
    for y in 0..a.height {
        for x in 0..a.width {
            seen.clear();
            for row in y.saturating_sub(r)..(y + r + 1).min(a.height) {
                let row = &a.data[row * a.width..(row + 1) * a.width];
                seen.extend_from_slice(&row[x.saturating_sub(r)..(x + r + 1).min(a.width)]);
            }
            let middle = seen.len() / 2;
            out.push(*seen.select_nth_unstable_by(middle, f32::total_cmp).1);
        }
    }
    a.like(out)
}

/// Smoothed by what is near in place and in value, both with a standard deviation of 10.
pub(super) fn bilateral(a: &Plane, r: usize) -> Plane {
    let bell = |square: f32| (-square / 200.0).exp();
    let near: Vec<f32> = (0..=64).map(|d| bell((d * d) as f32)).collect();
    let (mut sum, mut all) = (Plane::filled(a.width, a.height, 0.0), vec![0.0f32; a.data.len()]);
    let r = r as isize;
    for dy in -r..=r {
        for dx in -r..=r {
            let place = bell((dx * dx + dy * dy) as f32);
            let other = a.moved(dx, dy);
            for (((sum, all), v), o) in sum.data.iter_mut().zip(&mut all).zip(&a.data).zip(&other.data) {
                let weight = place * near[((v - o).abs() as usize).min(64)];
                *sum += weight * o;
                *all += weight;
            }
        }
    }
    sum.data.iter_mut().zip(&all).for_each(|(s, a)| *s /= a);
    sum
}

/// How far above the window's mean, in standard deviations, as 128 + 64 z.
pub(super) fn normalized(a: &Plane, rx: usize, ry: usize) -> Plane {
    let mean = a.box_mean(rx, ry);
    let square = a.map(|v| v * v).box_mean(rx, ry);
    let spread = square.zip(&mean, |s, m| (s - m * m).max(0.0).sqrt() + 1.0);
    a.zip(&mean, |a, m| a - m).zip(&spread, |d, s| 128.0 + 64.0 * d / s)
}
