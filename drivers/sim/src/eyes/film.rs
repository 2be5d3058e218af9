//! Model of optics and sensor: motion blur, defocus, vignetting, drifting white balance, and noise.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Number of noise values, which are drawn once; rows of images start anywhere in them.
const DRAWN: usize = 1 << 16;

/// Settings of optics and sensor.
#[derive(Clone, Copy, Debug)]
pub struct FilmSettings {
    /// Standard deviation of the noise per color and pixel, of 255.
    pub noise: f32,
    /// Loss of light in a corner relative to the center, 0 to 1.
    pub vignetting: f32,
    /// Amplitude of the drift of red and blue, as a share.
    pub drift: f32,
    /// True if each pixel is blurred with its neighbors.
    pub soft: bool,
}

/// Converts light to images.
pub struct Film {
    settings: FilmSettings,
    size: [usize; 2],
    /// Share of the light that reaches each pixel.
    share: Vec<f32>,
    noise: Vec<f32>,
    /// Phases of the drifts of red and blue.
    phase: [f64; 4],
    seed: u64,
}

/// Red, green and blue planes of an image, each row by row, 0 to 255.
pub type Planes = [Vec<f32>; 3];

impl Film {
    /// Creates the model for images of this size.
    pub fn new(settings: FilmSettings, size: [usize; 2], seed: u64) -> Film {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let [width, height] = size.map(|n| n as f32);
        let share = |k: usize| {
            let (x, y) = ((k % size[0]) as f32 + 0.5, (k / size[0]) as f32 + 0.5);
            let far = ((x * 2.0 / width - 1.0).powi(2) + (y * 2.0 / height - 1.0).powi(2)) / 2.0;
            1.0 - settings.vignetting * far
        };
        // the sum of twelve numbers from 0 to 1 is approximately normal
        let mut normal = || (0..12).map(|_| rng.random::<f32>()).sum::<f32>() - 6.0;
        let noise = (0..DRAWN + size[0]).map(|_| normal() * settings.noise).collect();
        let phase = std::array::from_fn(|_| rng.random_range(0.0..std::f64::consts::TAU));
        Film { settings, size, share: (0..size[0] * size[1]).map(share).collect(), noise, phase, seed }
    }

    /// Gains of red, green and blue at a time in seconds: two slow waves each, with periods of a minute and a
    /// quarter of it.
    fn white(&self, at: f64) -> [f32; 3] {
        let [a, b, c, d] = self.phase;
        let wave = |slow: f64, quick: f64| 0.7 * (at / 9.55 + slow).sin() + 0.3 * (at / 2.4 + quick).sin();
        let drift = f64::from(self.settings.drift);
        [(1.0 + drift * wave(a, b)) as f32, 1.0, (1.0 + drift * wave(c, d)) as f32]
    }

    /// Converts planes to an image: three bytes per pixel, row by row.
    ///
    /// # Arguments
    /// * `at`: time in seconds, for the drift; `number`: number of the image, for its noise.
    /// * `moved`: image motion during the exposure, pixels right and down.
    pub fn develop(&self, planes: &mut Planes, spare: &mut Vec<f32>, at: f64, number: u64, moved: [f32; 2]) -> Vec<u8> {
        let [width, height] = self.size;
        let mut bytes = vec![0u8; width * height * 3];
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed ^ number.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        for plane in planes.iter_mut() {
            smear(plane, spare, self.size, moved);
        }
        let side = if self.settings.soft { 0.25 } else { 0.0 };
        // with one more pixel at either end
        let mut padded = vec![0.0f32; width + 2];
        let mut done = [const { Vec::new() }; 3];
        for (y, out) in bytes.chunks_exact_mut(width * 3).enumerate() {
            let (above, below) =
                if self.settings.soft { (y.saturating_sub(1), (y + 1).min(height - 1)) } else { (y, y) };
            let share = self.share.get(y * width..(y + 1) * width).unwrap_or_default();
            for ((plane, white), done) in planes.iter().zip(self.white(at)).zip(&mut done) {
                let line = |y: usize| plane.get(y * width..(y + 1) * width).unwrap_or_default();
                pad(line(y), line(above), line(below), &mut padded);
                let begin = (rng.random::<u32>() as usize) % DRAWN;
                let noise = self.noise.get(begin..begin + width).unwrap_or_default();
                let part = |from: usize| padded.get(from..from + width).unwrap_or_default();
                let mixed = part(1).iter().zip(part(0).iter().zip(part(2)));
                done.clear();
                done.extend(mixed.zip(share.iter().zip(noise)).map(|((m, (l, r)), (s, n))| {
                    let v = (1.0 - 2.0 * side) * m + side * (l + r);
                    ((v * s * white + n).clamp(0.0, 255.0) + ROUND).to_bits()
                }));
            }
            let [red, green, blue] = &done;
            for (pixel, (r, (g, b))) in out.chunks_exact_mut(3).zip(red.iter().zip(green.iter().zip(blue))) {
                pixel.copy_from_slice(&[*r as u8, *g as u8, *b as u8]);
            }
        }
        bytes
    }
}

/// Rounds by addition: the last byte of the sum with a number from 0 to 255 is that number, rounded.
const ROUND: f32 = 8_388_608.0;

/// Half of a row and a quarter of the rows above and below, with the pixels at both ends duplicated.
fn pad(here: &[f32], above: &[f32], below: &[f32], out: &mut [f32]) {
    if let [first, middle @ .., last] = out {
        for (o, (h, (a, b))) in middle.iter_mut().zip(here.iter().zip(above.iter().zip(below))) {
            *o = 0.5 * h + 0.25 * (a + b);
        }
        *first = middle.first().copied().unwrap_or(0.0);
        *last = middle.last().copied().unwrap_or(0.0);
    }
}

/// Blurs a plane along a vector of this number of pixels, evenly, half of it to either side.
fn smear(plane: &mut Vec<f32>, spare: &mut Vec<f32>, [width, height]: [usize; 2], [dx, dy]: [f32; 2]) {
    let taps = (dx.abs().max(dy.abs()).ceil() as i32 + 1).min(MOST_TAPS);
    if taps < 2 || width == 0 || height == 0 {
        return;
    }
    spare.clear();
    spare.resize(plane.len(), 0.0);
    let each = 1.0 / taps as f32;
    for tap in 0..taps {
        let along = tap as f32 / (taps - 1) as f32 - 0.5;
        let (sx, sy) = ((along * dx).round() as isize, (along * dy).round() as isize);
        for (y, out) in spare.chunks_exact_mut(width).enumerate() {
            let from = y.saturating_add_signed(sy).min(height - 1) * width;
            let Some(row) = plane.get(from..from + width) else { continue };
            // beyond its border, the image continues with the border's color
            let shift = sx.unsigned_abs().min(width);
            let (border, moved, beyond) = if sx >= 0 {
                let (moved, beyond) = out.split_at_mut(width - shift);
                (row.last(), moved.iter_mut().zip(row.get(shift..).unwrap_or_default()), beyond)
            } else {
                let (beyond, moved) = out.split_at_mut(shift);
                (row.first(), moved.iter_mut().zip(row), beyond)
            };
            moved.for_each(|(o, r)| *o += each * r);
            beyond.iter_mut().for_each(|o| *o += each * border.copied().unwrap_or(0.0));
        }
    }
    std::mem::swap(plane, spare);
}

/// Largest number of copies averaged for a blur.
const MOST_TAPS: i32 = 64;
