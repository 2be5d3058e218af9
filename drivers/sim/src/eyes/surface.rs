//! Unlit surfaces of the pixels of a tile: depth, normal and color.

use super::lens::{TILE, Tile};
use super::solid::{CameraForm, V3};
use super::sticker::{self, Sticker, Stickers};
use super::texture::Texture;

/// One number for each pixel of a tile.
pub type Numbers = [f32; TILE];

/// Visible surfaces of a tile.
pub struct TileSurfaces {
    /// Depth along the optical axis, meters.
    pub depth: Numbers,
    /// Unit normal: x, y and z in the camera frame.
    pub normal: [Numbers; 3],
    /// Red, green and blue, 0 to 255.
    pub color: [Numbers; 3],
    /// Share of the lamp that is reflected, 0 to 1.
    pub gloss: Numbers,
}

impl TileSurfaces {
    /// Creates empty surfaces.
    pub fn new() -> TileSurfaces {
        let none = [0.0; TILE];
        TileSurfaces { depth: none, normal: [none; 3], color: [none; 3], gloss: none }
    }

    /// A run of consecutive pixels, from `first` on.
    pub fn run<'a>(&'a mut self, tile: &'a Tile, first: usize, count: usize) -> Run<'a> {
        let [nx, ny, nz] = self.normal.each_mut().map(|n| part(n, first, count));
        let [red, green, blue] = self.color.each_mut().map(|c| part(c, first, count));
        let depth = part(&mut self.depth, first, count);
        let gloss = part(&mut self.gloss, first, count);
        let ray = |of: &'a Numbers| of.get(first..first + count).unwrap_or_default();
        Run { x: ray(&tile.x), y: ray(&tile.y), depth, nx, ny, nz, red, green, blue, gloss }
    }
}

fn part(of: &mut Numbers, first: usize, count: usize) -> &mut [f32] {
    of.get_mut(first..first + count).unwrap_or_default()
}

/// Consecutive pixels of a tile; all slices have the same length.
#[allow(missing_docs, reason = "as in `TileSurfaces`, and the rays `(x, y, 1)`")]
pub struct Run<'a> {
    pub x: &'a [f32],
    pub y: &'a [f32],
    pub depth: &'a mut [f32],
    pub nx: &'a mut [f32],
    pub ny: &'a mut [f32],
    pub nz: &'a mut [f32],
    pub red: &'a mut [f32],
    pub green: &'a mut [f32],
    pub blue: &'a mut [f32],
    pub gloss: &'a mut [f32],
}

/// Appearance of a shape.
#[derive(Clone, Copy, Debug)]
pub struct Paint {
    /// Its color, 0 to 255.
    pub color: V3,
    /// True if it has a wood texture, as tables do.
    pub wood: bool,
    /// Share of the lamp that it reflects, 0 to 1.
    pub gloss: f32,
    /// Images on its sides, if it is a box.
    pub stickers: Stickers,
}

/// Sources of textures.
#[derive(Clone, Copy)]
pub struct Materials<'a> {
    /// Wood texture, and its pixels per meter.
    pub wood: (&'a Texture, f32),
    /// Images on objects.
    pub stickers: &'a [Sticker],
    /// Distance between the rays of adjacent pixels, across and down, at a depth of one.
    pub pitch: [f32; 2],
}

/// Number of rays per pixel edge that sample images on objects: edge detectors resolve tenths of pixels.
const WITHIN: u8 = 4;

impl Run<'_> {
    /// Renders one shape in all of these pixels.
    pub fn see(&mut self, form: &CameraForm, paint: &Paint, materials: Materials) {
        self.red.fill(paint.color.x);
        self.green.fill(paint.color.y);
        self.blue.fill(paint.color.z);
        self.gloss.fill(paint.gloss);
        match *form {
            CameraForm::Ball { center, radius } => {
                let scale = 1.0 / radius;
                self.face(|at| (at - center) * scale);
            }
            CameraForm::Rod(rod) => {
                let scale = 1.0 / rod.radius;
                // tolerates rounding at the edge of a flat end
                let flat = if rod.round { f32::INFINITY } else { rod.half * 0.9999 };
                self.face(|at| {
                    let from = at - rod.center;
                    let along = from.x * rod.axis.x + from.y * rod.axis.y + from.z * rod.axis.z;
                    let side = (from - rod.axis * along.max(-rod.half).min(rod.half)) * scale;
                    let end = rod.axis * 1f32.copysign(along);
                    if along.abs() > flat { end } else { side }
                });
            }
            CameraForm::Box { axes: [a, b, c], eye, half } => {
                let own = |at: V3| V3::new(inner(a, at), inner(b, at), inner(c, at)) + eye;
                self.face(|at| {
                    let own = own(at);
                    let over = own.abs() - half;
                    let [a, b, c] = [(a, own.x), (b, own.y), (c, own.z)].map(|(axis, s)| axis * 1f32.copysign(s));
                    let second = if over.y > over.z { b } else { c };
                    if over.x > over.y.max(over.z) { a } else { second }
                });
                if paint.wood {
                    self.grain(materials.wood, |at| {
                        let own = own(at);
                        let over = own.abs() - half;
                        let first = over.x > over.y.max(over.z);
                        let second = over.y > over.z;
                        [if first { own.y } else { own.x }, if first | second { own.z } else { own.y }]
                    });
                }
                for (side, sticker) in paint.stickers.iter().enumerate() {
                    if let Some(sticker) = sticker.and_then(|k| materials.stickers.get(usize::from(k))) {
                        self.stick(sticker, side, ([a, b, c], eye, half), materials.pitch);
                    }
                }
            }
        }
    }

    /// Sets the normals, computed from the points in the camera frame.
    #[inline(always)]
    fn face(&mut self, normal: impl Fn(V3) -> V3) {
        let at = self.x.iter().zip(self.y).zip(self.depth.iter());
        let n = self.nx.iter_mut().zip(self.ny.iter_mut()).zip(self.nz.iter_mut());
        for (((x, y), t), ((nx, ny), nz)) in at.zip(n) {
            let n = normal(V3::new(x * t, y * t, *t));
            (*nx, *ny, *nz) = (n.x, n.y, n.z);
        }
    }

    /// Renders the image on a side of a box, averaged over several rays per pixel.
    fn stick(&mut self, of: &Sticker, side: usize, (axes, eye, half): ([V3; 3], V3, V3), pitch: [f32; 2]) {
        let axis = side / 2;
        let sign = if side % 2 == 1 { -1.0 } else { 1.0 };
        let [right, down] = sticker::axes(side);
        let (Some(far), Some(from)) = (half.get(axis).map(|h| h * sign), eye.get(axis)) else { return };
        // the camera does not see that side
        if (from - far) * sign <= 0.0 {
            return;
        }
        let met = |x: f32, y: f32| {
            let ray = V3::new(x, y, 1.0);
            let ray = V3::new(inner(axes[0], ray), inner(axes[1], ray), inner(axes[2], ray));
            eye + ray * ((far - from) / ray.get(axis).copied().unwrap_or(0.0))
        };
        let steps = || (0..WITHIN).map(|k| (f32::from(k) + 0.5) / f32::from(WITHIN) - 0.5);
        let rays = self.x.iter().zip(self.y);
        let colors = self.red.iter_mut().zip(self.green.iter_mut()).zip(self.blue.iter_mut());
        for ((x, y), ((red, green), blue)) in rays.zip(colors) {
            let over = met(*x, *y).abs() - half;
            // skips other sides, with a tolerance for rounding
            if over.iter().any(|o| o.is_nan() || *o > 1e-4) {
                continue;
            }
            let own = V3::new(*red, *green, *blue);
            let mut sum = V3::zeros();
            for (dx, dy) in steps().flat_map(|dy| steps().map(move |dx| (dx, dy))) {
                let at = met(x + dx * pitch[0], y + dy * pitch[1]);
                sum += of.at([inner(right, at), inner(down, at)]).unwrap_or(own);
            }
            let mean = sum / f32::from(WITHIN * WITHIN);
            (*red, *green, *blue) = (mean.x, mean.y, mean.z);
        }
    }

    /// Multiplies the color by a texture around gray.
    #[inline(always)]
    fn grain(&mut self, (texture, scale): (&Texture, f32), place: impl Fn(V3) -> [f32; 2]) {
        let (mut us, mut vs) = ([0.0f32; TILE], [0.0f32; TILE]);
        let at = self.x.iter().zip(self.y).zip(self.depth.iter());
        for (((x, y), t), (u, v)) in at.zip(us.iter_mut().zip(&mut vs)) {
            let [a, b] = place(V3::new(x * t, y * t, *t));
            (*u, *v) = (a * scale, b * scale);
        }
        let colors = self.red.iter_mut().zip(self.green.iter_mut()).zip(self.blue.iter_mut());
        for ((u, v), ((r, g), b)) in us.iter().zip(&vs).zip(colors) {
            let [red, green, blue] = texture.at(*u, *v);
            *r *= red * (1.0 / 128.0);
            *g *= green * (1.0 / 128.0);
            *b *= blue * (1.0 / 128.0);
        }
    }
}

/// Inner product, written so that it is vectorized.
#[inline(always)]
fn inner(a: V3, b: V3) -> f32 {
    a.x * b.x + a.y * b.y + a.z * b.z
}
