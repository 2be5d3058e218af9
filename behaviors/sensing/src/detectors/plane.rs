//! A single channel of an image, and the neighborhood operations that all filters use.

/// Number of rows that are summed at once.
const ROWS_AT_ONCE: usize = 4;

/// Returns the mean of red, green and blue.
pub fn brightness([r, g, b]: &[Plane; 3]) -> Plane {
    r.zip(g, |r, g| r + g).zip(b, |sum, b| (sum + b) / 3.0)
}

/// One value per pixel, row by row from the top. Colors are 0 to 255.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` values.
    pub data: Vec<f32>,
}

impl Plane {
    /// Creates a plane with the same value everywhere.
    pub fn filled(width: usize, height: usize, value: f32) -> Plane {
        Plane { width, height, data: vec![value; width * height] }
    }

    /// Creates a plane of the same size with these values.
    pub fn like(&self, data: Vec<f32>) -> Plane {
        Plane { width: self.width, height: self.height, data }
    }

    /// Applies a function to every pixel.
    pub fn map(&self, f: impl Fn(f32) -> f32) -> Plane {
        self.like(self.data.iter().map(|v| f(*v)).collect())
    }

    /// Applies a function to every pixel and the same pixel of another plane of the same size.
    pub fn zip(&self, other: &Plane, f: impl Fn(f32, f32) -> f32) -> Plane {
        self.like(self.data.iter().zip(&other.data).map(|(a, b)| f(*a, *b)).collect())
    }

    /// Returns the rows.
    pub fn rows(&self) -> impl Iterator<Item = &[f32]> {
        self.data.chunks_exact(self.width.max(1))
    }

    /// Computes means over windows of `2 rx + 1` by `2 ry + 1` pixels, clipped at the border. The
    /// cost does not depend on the window.
    pub fn box_mean(&self, rx: usize, ry: usize) -> Plane {
        let w = self.width;
        let h = self.height;
        let mut across = Vec::with_capacity(w * h);
        let inverse: Vec<f32> = (0..w).map(|x| 1.0 / ((x + rx + 1).min(w) - x.saturating_sub(rx)) as f32).collect();
        // Each sum depends on the previous one; several rows at once hide this latency.
        let mut sums = vec![[0.0f32; ROWS_AT_ONCE]; w + 1];
        for rows in self.data.chunks(ROWS_AT_ONCE * w.max(1)) {
            let mut sum = [0.0f32; ROWS_AT_ONCE];
            let lanes: [&[f32]; ROWS_AT_ONCE] =
                std::array::from_fn(|k| rows.get(k * w..(k + 1) * w).unwrap_or(&rows[..w]));
            for (x, to) in sums[1..].iter_mut().enumerate() {
                for (sum, row) in sum.iter_mut().zip(lanes) {
                    *sum += row[x];
                }
                *to = sum;
            }
            for k in 0..rows.len() / w.max(1) {
                // Windows are clipped at the border.
                let from = rx.min(w);
                let to = w.saturating_sub(rx).max(from);
                let mean = |x: usize| (sums[(x + rx + 1).min(w)][k] - sums[x.saturating_sub(rx)][k]) * inverse[x];
                across.extend((0..from).map(mean));
                let ends = sums.get(2 * rx + 1..).unwrap_or_default().iter().zip(&sums);
                across.extend(ends.zip(&inverse[from..to]).map(|((b, a), inverse)| (b[k] - a[k]) * inverse));
                across.extend((to..w).map(mean));
            }
        }
        if ry == 0 {
            return self.like(across);
        }
        let row = |y: usize| &across[y * w..(y + 1) * w];
        let mut sum = vec![0.0f32; w];
        let mut out = Vec::with_capacity(w * h);
        let add = |sum: &mut Vec<f32>, y: usize| sum.iter_mut().zip(row(y)).for_each(|(s, v)| *s += v);
        (0..ry.min(h)).for_each(|y| add(&mut sum, y));
        for y in 0..h {
            if y + ry < h {
                add(&mut sum, y + ry);
            }
            if y > ry {
                sum.iter_mut().zip(row(y - ry - 1)).for_each(|(s, v)| *s -= v);
            }
            let inverse = 1.0 / ((y + ry + 1).min(h) - y.saturating_sub(ry)) as f32;
            out.extend(sum.iter().map(|s| s * inverse));
        }
        self.like(out)
    }

    /// Shifts the image by this many pixels to the right and down; the border's values fill the
    /// gap.
    pub fn moved(&self, dx: isize, dy: isize) -> Plane {
        let at = |i: usize, d: isize, n: usize| i.saturating_add_signed(-d).min(n.saturating_sub(1));
        let columns: Vec<usize> = (0..self.width).map(|x| at(x, dx, self.width)).collect();
        let mut data = Vec::with_capacity(self.data.len());
        for y in 0..self.height {
            let from = at(y, dy, self.height) * self.width;
            let row = &self.data[from..from + self.width];
            data.extend(columns.iter().map(|x| row[*x]));
        }
        self.like(data)
    }

    /// Shrinks by an integer factor; each pixel is the mean of the pixels that it covers.
    pub fn shrunk(&self, by: usize) -> Plane {
        if by <= 1 {
            return self.clone();
        }
        let w = self.width.div_ceil(by);
        let h = self.height.div_ceil(by);
        let mut out = Plane::filled(w, h, 0.0);
        for y in 0..h {
            let top = y * by;
            let bottom = ((y + 1) * by).min(self.height);
            for x in 0..w {
                let left = x * by;
                let right = ((x + 1) * by).min(self.width);
                let rows = (top..bottom).map(|y| &self.data[y * self.width + left..y * self.width + right]);
                let sum: f32 = rows.map(|r| r.iter().sum::<f32>()).sum();
                out.data[y * w + x] = sum / ((bottom - top) * (right - left)) as f32;
            }
        }
        out
    }

    /// Enlarges by an integer factor to a size, the inverse of [`Plane::shrunk`], by interpolation
    /// between pixel centers.
    pub fn grown(&self, by: usize, width: usize, height: usize) -> Plane {
        if by <= 1 || self.data.is_empty() {
            return self.clone();
        }
        self.interpolated([by as f32; 2], width, height)
    }

    /// Resizes by interpolation between pixel centers; if it gets much smaller, pixels are averaged
    /// first.
    pub fn stretched(&self, [width, height]: [usize; 2]) -> Plane {
        if [width, height] == [self.width, self.height] || self.data.is_empty() || width == 0 || height == 0 {
            return self.clone();
        }
        let by = (self.width / width).min(self.height / height).max(1);
        let scale = [(width * by) as f32 / self.width as f32, (height * by) as f32 / self.height as f32];
        self.shrunk(by).interpolated(scale, width, height)
    }

    /// Enlarges by these horizontal and vertical factors by interpolation, and crops to a size.
    fn interpolated(&self, scale: [f32; 2], width: usize, height: usize) -> Plane {
        let places = |n: usize, of: usize, by: f32| -> Vec<(usize, usize, f32)> {
            let place = |i: usize| {
                let at = ((i as f32 + 0.5) / by - 0.5).clamp(0.0, (of - 1) as f32);
                (at as usize, (at as usize + 1).min(of - 1), at.fract())
            };
            (0..n).map(place).collect()
        };
        let columns = places(width, self.width, scale[0]);
        let rows = places(height, self.height, scale[1]);
        let mut data = Vec::with_capacity(width * height);
        let mut between = vec![0.0f32; self.width];
        for (above, below, part) in rows {
            let row = |y: usize| &self.data[y * self.width..(y + 1) * self.width];
            for ((to, a), b) in between.iter_mut().zip(row(above)).zip(row(below)) {
                *to = a + part * (b - a);
            }
            data.extend(columns.iter().map(|(a, b, part)| between[*a] + part * (between[*b] - between[*a])));
        }
        Plane { width, height, data }
    }
}

/// Smooths a plane, but not across edges of `guide` (guided filter: He, Sun and Tang 2010). In each
/// window of half-width `r` the result is a linear function of the guide; a larger `eps` (squared
/// units of the guide) makes it more nearly constant.
pub fn guided(plane: &Plane, guide: &Plane, r: usize, eps: f32) -> Plane {
    let mean = guide.box_mean(r, r);
    let mean_p = plane.box_mean(r, r);
    let both = guide.zip(plane, |g, p| g * p).box_mean(r, r);
    let square = guide.zip(guide, |a, b| a * b).box_mean(r, r);
    let covariance = both.zip(&mean.zip(&mean_p, |m, p| m * p), |b, m| b - m);
    let variance = square.zip(&mean, |s, m| (s - m * m).max(0.0));
    let slope = covariance.zip(&variance, |c, v| c / (v + eps));
    let offset = mean_p.zip(&slope.zip(&mean, |s, m| s * m), |p, m| p - m);
    let slope = slope.box_mean(r, r);
    slope.zip(guide, |s, g| s * g).zip(&offset.box_mean(r, r), |a, b| a + b)
}
