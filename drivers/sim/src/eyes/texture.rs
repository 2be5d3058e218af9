//! Periodic textures: generated from a seed, or read from a file.

use super::solid::V3;
use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// A square texture that repeats infinitely.
pub struct Texture {
    /// Binary logarithm of its side in pixels.
    bits: u32,
    /// Red, green, blue, and padding.
    texels: Vec<[u8; 4]>,
}

/// Three times two to the power of 22: near it, numbers of single precision have no fractional digits.
const WHOLE: f32 = 12_582_912.0;
/// Binary logarithm of the side of generated textures.
const DRAWN: u32 = 8;

impl Texture {
    /// Color at a position, in pixels of the texture.
    #[inline(always)]
    pub fn at(&self, u: f32, v: f32) -> [f32; 3] {
        let mask = (1u32 << self.bits) - 1;
        // the last bits of the sum are the nearest whole number, which is faster than any conversion
        let [u, v] = [u, v].map(|x| (x + WHOLE).to_bits() & mask);
        let [r, g, b, _] = self.texels.get((v << self.bits | u) as usize).copied().unwrap_or_default();
        [r, g, b].map(f32::from)
    }

    /// Pixels along its side.
    pub fn side(&self) -> f32 {
        (1u32 << self.bits) as f32
    }

    /// Samples a texture from the color at each position `(u, v)` from 0 to 1, `v` downward.
    pub fn sampled(bits: u32, color: impl Fn(f32, f32) -> V3) -> Texture {
        let side = 1u32 << bits;
        let texel = |k: u32| {
            let at = |n: u32| (n as f32 + 0.5) / side as f32;
            let c = color(at(k % side), at(k / side)).map(|x| x.clamp(0.0, 255.0) as u8);
            [c.x, c.y, c.z, 0]
        };
        Texture { bits, texels: (0..side * side).map(texel).collect() }
    }

    /// Wooden boards around a gray of 128, to multiply colors by.
    pub fn wood(contrast: f32, rng: &mut ChaCha8Rng) -> Texture {
        let warp = LatticeNoise::new(4, rng);
        let fine = LatticeNoise::new(32, rng);
        let boards = rng.random_range(2..6) as f32;
        let shades: Vec<f32> = (0..8).map(|_| rng.random_range(-0.3..0.3)).collect();
        Texture::sampled(DRAWN, |u, v| {
            let shade = shades.get((u * boards) as usize).copied().unwrap_or(0.0);
            let rings = ((u * 6.0 + 0.8 * warp.at(u, v)) * std::f32::consts::TAU * 4.0).sin() * 0.25;
            let seam = if (u * boards).fract() < 0.02 { -0.6 } else { 0.0 };
            let tone = shade + rings + 0.7 * fine.at(u, v * 0.125) + seam;
            V3::new(1.0, 1.0 - 0.04 * tone, 1.0 - 0.1 * tone) * (128.0 * (1.0 + contrast * tone))
        })
    }

    /// Cloth or rough plaster of about this color.
    pub fn rough(color: V3, contrast: f32, rng: &mut ChaCha8Rng) -> Texture {
        let octaves: Vec<LatticeNoise> = [3, 9, 27, 81].map(|n| LatticeNoise::new(n, rng)).into();
        Texture::sampled(DRAWN, |u, v| {
            let tone = octaves.iter().zip([0.5, 0.4, 0.3, 0.3]).map(|(n, w)| w * n.at(u, v)).sum::<f32>();
            color * (1.0 + contrast * tone)
        })
    }

    /// Tiles of two shades of this color.
    pub fn tiles(color: V3, contrast: f32, rng: &mut ChaCha8Rng) -> Texture {
        let count = rng.random_range(1..5) as f32 * 2.0;
        let noise = LatticeNoise::new(48, rng);
        Texture::sampled(DRAWN, |u, v| {
            let odd = ((u * count) as u32 + (v * count) as u32) % 2;
            let joint = (u * count).fract() < 0.04 || (v * count).fract() < 0.04;
            let tone = if joint { -0.6 } else { 0.6 * (odd as f32 - 0.5) } + 0.3 * noise.at(u, v);
            color * (1.0 + contrast * tone)
        })
    }

    /// A wall of this color with clutter: rectangles of random colors that stand for shelves, books and
    /// posters.
    pub fn clutter(color: V3, contrast: f32, rng: &mut ChaCha8Rng) -> Texture {
        let mut wall = Texture::rough(color, contrast, rng);
        let side = 1usize << wall.bits;
        for _ in 0..(40.0 * contrast) as u32 {
            let [left, top] = [0; 2].map(|_: u32| rng.random_range(0..side));
            let [wide, high] = [rng.random_range(4..48), rng.random_range(4..64)];
            let paint = any_color(rng).map(|c| c as u8);
            for y in (top..top + high).map(|y| y % side) {
                for x in (left..left + wide).map(|x| x % side) {
                    if let Some(texel) = wall.texels.get_mut(y * side + x) {
                        *texel = [paint.x, paint.y, paint.z, 0];
                    }
                }
            }
        }
        wall
    }
}

/// Random color, dull ones more often than bright ones.
pub fn any_color(rng: &mut ChaCha8Rng) -> V3 {
    let saturation: f32 = rng.random_range(0.0f32..1.0).powi(2);
    from_hsv(rng.random_range(0.0..360.0), saturation, rng.random_range(50.0..240.0))
}

/// A color from its hue (degrees), saturation (0 to 1) and value (0 to 255).
pub fn from_hsv(hue: f32, saturation: f32, value: f32) -> V3 {
    let channel = |n: f32| {
        let k = (n + hue / 60.0).rem_euclid(6.0);
        value * (1.0 - saturation * k.min(4.0 - k).clamp(0.0, 1.0))
    };
    V3::new(channel(5.0), channel(3.0), channel(1.0))
}

/// Hue (degrees), saturation (0 to 1) and value of a color.
pub fn to_hsv(c: V3) -> [f32; 3] {
    let (most, least) = (c.max(), c.min());
    let range = (most - least).max(1e-6);
    let sixth = if most == c.x {
        (c.y - c.z) / range
    } else if most == c.y {
        2.0 + (c.z - c.x) / range
    } else {
        4.0 + (c.x - c.y) / range
    };
    [(60.0 * sixth).rem_euclid(360.0), (most - least) / most.max(1e-6), most]
}

/// Smooth periodic noise on a lattice, about -1 to 1.
struct LatticeNoise {
    cells: usize,
    values: Vec<f32>,
}

impl LatticeNoise {
    fn new(cells: usize, rng: &mut ChaCha8Rng) -> LatticeNoise {
        LatticeNoise { cells, values: (0..cells * cells).map(|_| rng.random_range(-1.0..1.0)).collect() }
    }

    fn at(&self, u: f32, v: f32) -> f32 {
        let place = |x: f32| {
            let x = x * self.cells as f32;
            let t = x.fract();
            (x as usize, t * t * (3.0 - 2.0 * t))
        };
        let ((x, s), (y, t)) = (place(u), place(v));
        let value = |x: usize, y: usize| self.values.get(y % self.cells * self.cells + x % self.cells).unwrap_or(&0.0);
        let row = |y: usize| value(x, y) * (1.0 - s) + value(x + 1, y) * s;
        row(y) * (1.0 - t) + row(y + 1) * t
    }
}
