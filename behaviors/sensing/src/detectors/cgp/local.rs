//! Nonlinear functions of a window around each pixel. Windows are clipped at the border.

use super::super::plane::Plane;
use super::filters::padded;
use super::numbers::{exp_near, floor};
use super::op::{greater, lesser};

/// Computes the extreme value in windows of `2 rx + 1` by `2 ry + 1` pixels. Values repeated beyond
/// the border are in the window anyway.
pub(super) fn extreme(a: &Plane, rx: usize, ry: usize, of: impl Fn(f32, f32) -> f32) -> Plane {
    let w = a.width;
    let h = a.height;
    let mut across = Vec::with_capacity(a.data.len());
    let mut wide = Vec::new();
    let mut next = Vec::new();
    for row in a.rows() {
        padded(row, rx, &mut wide);
        spans(&mut wide, &mut next, 2 * rx + 1, 1, &of);
        across.extend_from_slice(&wide[..w]);
    }
    let mut tall = Vec::with_capacity((h + 2 * ry) * w);
    let row = |y: usize| &across[y * w..(y + 1) * w];
    (0..ry).for_each(|_| tall.extend_from_slice(row(0)));
    tall.extend_from_slice(&across);
    (0..ry).for_each(|_| tall.extend_from_slice(row(h - 1)));
    spans(&mut tall, &mut next, 2 * ry + 1, w, &of);
    tall.truncate(w * h);
    a.like(tall)
}

/// Replaces each value by the extreme of `whole` values, `stride` apart, that start with it; values
/// too close to the end for that are meaningless. A span of any length is the union of two
/// overlapping ones with lengths that are powers of two.
fn spans(now: &mut Vec<f32>, next: &mut Vec<f32>, whole: usize, stride: usize, of: &impl Fn(f32, f32) -> f32) {
    let mut length = 1;
    while length < whole {
        let by = length.min(whole - length);
        next.clear();
        next.extend(now.iter().zip(&now[by * stride..]).map(|(a, b)| of(*a, *b)));
        next.resize(now.len(), 0.0);
        std::mem::swap(now, next);
        length += by;
    }
}

/// Computes the median in windows of `2 r + 1` by `2 r + 1` pixels, `r` 1 or 2; at the border, of
/// the pixels inside the image.
pub(super) fn median(a: &Plane, r: usize) -> Plane {
    let w = a.width;
    let h = a.height;
    let mut out = Vec::with_capacity(a.data.len());
    let mut window: Vec<f32> = Vec::with_capacity(25);
    let mut slow = |x: usize, y: usize| {
        window.clear();
        for row in y.saturating_sub(r)..(y + r + 1).min(h) {
            let row = &a.data[row * w..(row + 1) * w];
            window.extend_from_slice(&row[x.saturating_sub(r)..(x + r + 1).min(w)]);
        }
        let middle = window.len() / 2;
        *window.select_nth_unstable_by(middle, f32::total_cmp).1
    };
    for y in 0..h {
        if y < r || y + r >= h || w <= 2 * r {
            out.extend((0..w).map(|x| slow(x, y)));
            continue;
        }
        out.extend((0..r).map(|x| slow(x, y)));
        let rows = &a.data[(y - r) * w..(y + r + 1) * w];
        if r == 1 {
            medians(rows, w, &mut out, middle_of_nine);
        } else {
            medians(rows, w, &mut out, middle_of_25);
        }
        out.extend((w - r..w).map(|x| slow(x, y)));
    }
    a.like(out)
}

/// Number of adjacent pixels for which the median is computed at once.
const LANE_COUNT: usize = 8;
/// One value of each of these pixels.
type PixelLanes = [f32; LANE_COUNT];

/// Computes the medians of all whole windows in `N` rows of `w` pixels, `w` at least `N`. Each
/// column is sorted once for all windows that contain it; `middle` computes the median of `N`
/// sorted columns, which it is given as rows.
fn medians<const N: usize>(
    rows: &[f32],
    w: usize,
    out: &mut Vec<f32>,
    middle: impl Fn([[PixelLanes; N]; N]) -> PixelLanes,
) {
    let mut columns: [Vec<f32>; N] = std::array::from_fn(|k| rows[k * w..(k + 1) * w].to_vec());
    for j in (1..N).flat_map(|i| (1..=i).rev()) {
        if let ([.., low], [high, ..]) = columns.split_at_mut(j) {
            low.iter_mut()
                .zip(high)
                .for_each(|(low, high)| (*low, *high) = (lesser(*low, *high), greater(*low, *high)));
        }
    }
    let base = out.len();
    let count = w - (N - 1);
    out.resize(base + count, 0.0);
    let lanes = LANE_COUNT.min(count);
    for begin in (0..count).step_by(LANE_COUNT) {
        // Recompute some of the last ones rather than handle a shorter block.
        let begin = begin.min(count - lanes);
        let lane = |i: usize, j: usize| {
            let from = &columns[i][begin + j..];
            let mut lane = [0.0; LANE_COUNT];
            match from.first_chunk() {
                Some(whole) => lane = *whole,
                None => lane[..lanes].copy_from_slice(&from[..lanes]),
            }
            lane
        };
        let middle = middle(std::array::from_fn(|i| std::array::from_fn(|j| lane(i, j))));
        out[base + begin..base + begin + lanes].copy_from_slice(&middle[..lanes]);
    }
}

/// Computes the median of nine as the median of three: the greatest of the columns' minima, the
/// median of their medians, and the least of their maxima.
#[inline(always)]
fn middle_of_nine([mut least, mut middle, mut most]: [[PixelLanes; 3]; 3]) -> PixelLanes {
    select::<3, 2, 3>(&mut least);
    select::<3, 1, 2>(&mut middle);
    select::<3, 0, 1>(&mut most);
    let mut left = [least[2], middle[1], most[0]];
    select::<3, 1, 2>(&mut left);
    left[1]
}

/// Computes the median of 25.
///
/// A value in the `i`th place of its sorted column that would be in the `j`th place of its row,
/// were the row sorted too, is at least as great as `(i + 1) (j + 1)` values and not greater than
/// `(5 - i) (5 - j)`. Twelve values can therefore not be the median, six below it and six above. Of
/// the others, eight at a time, the minimum and the maximum are not the median either; the next
/// value replaces them.
#[inline(always)]
fn middle_of_25([mut a, mut b, mut c, mut d, mut e]: [[PixelLanes; 5]; 5]) -> PixelLanes {
    select::<5, 3, 5>(&mut a);
    select::<5, 2, 5>(&mut b);
    select::<5, 1, 4>(&mut c);
    select::<5, 0, 3>(&mut d);
    select::<5, 0, 2>(&mut e);
    let mut left = [a[3], a[4], b[2], b[3], b[4], c[1], c[2], c[3]];
    ends::<8, 0>(&mut left);
    left[7] = d[0];
    ends::<8, 1>(&mut left);
    left[7] = d[1];
    ends::<8, 2>(&mut left);
    left[7] = d[2];
    ends::<8, 3>(&mut left);
    left[7] = e[0];
    ends::<8, 4>(&mut left);
    left[7] = e[1];
    ends::<8, 5>(&mut left);
    left[6]
}

/// Moves the values that would be in the places `FROM` to `TO` (exclusive), were they sorted, into
/// these places, in any order.
#[inline(always)]
fn select<const N: usize, const FROM: usize, const TO: usize>(all: &mut [PixelLanes; N]) {
    (0..FROM).for_each(|k| (k + 1..N).for_each(|j| sort(all, k, j)));
    (TO..N).rev().for_each(|k| (FROM..k).for_each(|j| sort(all, j, k)));
}

/// Moves the minimum of the values from `FROM` on to `FROM`, and the maximum to the end.
#[inline(always)]
fn ends<const N: usize, const FROM: usize>(all: &mut [PixelLanes; N]) {
    let count = N - FROM;
    (0..count / 2).for_each(|i| sort(all, FROM + i, N - 1 - i));
    (FROM + 1..FROM + count.div_ceil(2)).for_each(|k| sort(all, FROM, k));
    (FROM + count / 2..N - 1).for_each(|k| sort(all, k, N - 1));
}

/// Sorts two of the values, in each lane.
#[inline(always)]
fn sort<const N: usize>(all: &mut [PixelLanes; N], low: usize, high: usize) {
    let a = all[low];
    let b = all[high];
    all[low] = std::array::from_fn(|k| lesser(a[k], b[k]));
    all[high] = std::array::from_fn(|k| greater(a[k], b[k]));
}

/// Smooths with a bilateral filter: weights fall with the distance in position and in value, both
/// with a standard deviation of 10. Differences of value are rounded down to integers.
pub(super) fn bilateral(a: &Plane, r: usize) -> Plane {
    let w = a.width;
    let h = a.height;
    let mut wide = Vec::new();
    let rows: Vec<Vec<f32>> = a
        .rows()
        .map(|row| {
            padded(row, r, &mut wide);
            wide.clone()
        })
        .collect();
    let row = |y: isize| &rows[y.clamp(0, h as isize - 1) as usize];
    let mut sum = a.data.clone();
    let mut all = vec![1.0f32; w * h];
    let mut weights = vec![0.0f32; w + 2 * r];
    let reach = r as isize;
    // The weight of two pixels for each other is the same: half of each window is enough.
    for (dy, dx) in (0..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dy, dx))).filter(|d| *d > (0, 0)) {
        let place = (dx * dx + dy * dy) as f32;
        // Offsets of the two pixels in a padded row.
        let here = (-dx).max(0) as usize;
        let there = dx.max(0) as usize;
        let n = w + 2 * r - dx.unsigned_abs();
        for y in -dy..h as isize {
            let one = &row(y)[here..here + n];
            let other = &row(y + dy)[there..there + n];
            for ((weight, a), b) in weights.iter_mut().zip(one).zip(other) {
                let steps = floor(lesser((a - b).abs(), 64.0));
                *weight = exp_near((steps * steps + place) * (-1.0 / 200.0));
            }
            let mut add = |y: isize, from: usize, values: &[f32]| {
                let at = y as usize * w..(y as usize + 1) * w;
                let weights = &weights[from..from + w];
                let to = sum[at.clone()].iter_mut().zip(&mut all[at]);
                for (((sum, all), weight), v) in to.zip(weights).zip(&values[from..from + w]) {
                    *sum += weight * v;
                    *all += weight;
                }
            };
            if y >= 0 {
                add(y, r - here, other);
            }
            if y + dy < h as isize {
                add(y + dy, r - there, one);
            }
        }
    }
    sum.iter_mut().zip(&all).for_each(|(s, a)| *s /= a);
    a.like(sum)
}

/// Computes the difference from the window's mean in standard deviations z, as 128 + 64 z.
pub(super) fn normalized(a: &Plane, rx: usize, ry: usize) -> Plane {
    let mean = a.box_mean(rx, ry);
    let square = a.map(|v| v * v).box_mean(rx, ry);
    let all = a.data.iter().zip(&mean.data).zip(&square.data);
    let score = |((a, m), s): ((&f32, &f32), &f32)| 128.0 + 64.0 * (a - m) / (greater(s - m * m, 0.0).sqrt() + 1.0);
    a.like(all.map(score).collect())
}
