//! How a camera projects, both ways: a pinhole with the distortion of Brown and Conrady as OpenCV writes it, and the ray of every pixel.

use mobee_contract::Intrinsics;

/// Pixels in a row of a tile.
pub const TILE_WIDTH: usize = 16;
/// Rows of a tile.
pub const TILE_HEIGHT: usize = 8;
/// Pixels of a tile.
pub const TILE: usize = TILE_WIDTH * TILE_HEIGHT;

/// Where a direction `(x, y, 1)` of the camera's frame (z along the axis, x right, y down) is seen: pixels from the picture's upper
/// left corner.
pub fn project(lens: &Intrinsics, [x, y]: [f64; 2]) -> [f64; 2] {
    let [x, y] = bend(lens.distortion, [x, y]);
    let ([fx, fy], [cx, cy]) = (lens.focal, lens.center);
    [fx * x + cx, fy * y + cy]
}

/// The direction `(x, y, 1)` that is seen at a place of the picture; `None` if none is, because the lens's polynomial folds the
/// picture over there.
pub fn unproject(lens: &Intrinsics, [u, v]: [f64; 2]) -> Option<[f64; 2]> {
    let ([fx, fy], [cx, cy]) = (lens.focal, lens.center);
    let seen = [(u - cx) / fx, (v - cy) / fy];
    let mut at = seen;
    for _ in 0..50 {
        let [bx, by] = bend(lens.distortion, at);
        let [ex, ey] = [seen[0] - bx, seen[1] - by];
        if ex.abs().max(ey.abs()) < 1e-12 {
            // what is beyond the fold is seen at the same place, mirrored: no real lens does that
            return (slope(lens.distortion, at) > 0.0).then_some(at);
        }
        let [[a, b], [c, d]] = jacobian(lens.distortion, at);
        let det = a * d - b * c;
        if det.is_nan() || det.abs() < 1e-9 {
            return None;
        }
        at = [at[0] + (d * ex - b * ey) / det, at[1] + (a * ey - c * ex) / det];
    }
    None
}

/// What the lens makes of a direction.
fn bend([k1, k2, p1, p2]: [f64; 4], [x, y]: [f64; 2]) -> [f64; 2] {
    let r2 = x * x + y * y;
    let radial = 1.0 + r2 * (k1 + r2 * k2);
    let bent_x = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
    let bent_y = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
    [bent_x, bent_y]
}

/// How that changes with the direction.
fn jacobian([k1, k2, p1, p2]: [f64; 4], [x, y]: [f64; 2]) -> [[f64; 2]; 2] {
    let r2 = x * x + y * y;
    let radial = 1.0 + r2 * (k1 + r2 * k2);
    let grows = 2.0 * (k1 + 2.0 * r2 * k2);
    let across = x * y * grows + 2.0 * (p1 * x + p2 * y);
    [
        [radial + x * x * grows + 2.0 * p1 * y + 6.0 * p2 * x, across],
        [across, radial + y * y * grows + 6.0 * p1 * y + 2.0 * p2 * x],
    ]
}

/// Whether the picture grows outward: positive on the near side of the first fold, along the whole way from the axis.
fn slope(distortion: [f64; 4], [x, y]: [f64; 2]) -> f64 {
    let steps = (0..=16).map(|k| f64::from(k) / 16.0);
    let det = |share: f64| {
        let [[a, b], [c, d]] = jacobian(distortion, [x * share, y * share]);
        a * d - b * c
    };
    steps.map(det).fold(f64::INFINITY, f64::min)
}

/// The smallest box that holds something seen: least and greatest x, least and greatest y of its directions `(x, y, 1)`.
pub type TileBounds = [f32; 4];

/// Whether two boxes overlap.
pub fn overlaps(a: &TileBounds, b: &TileBounds) -> bool {
    a[0] <= b[1] && b[0] <= a[1] && a[2] <= b[3] && b[2] <= a[3]
}

/// The box that holds both.
pub fn union(a: TileBounds, b: TileBounds) -> TileBounds {
    [a[0].min(b[0]), a[1].max(b[1]), a[2].min(b[2]), a[3].max(b[3])]
}

/// A box that holds nothing.
pub const NOTHING: TileBounds = [f32::INFINITY, f32::NEG_INFINITY, f32::INFINITY, f32::NEG_INFINITY];

/// Some pixels that lie together, row by row.
pub struct Tile {
    /// The directions `(x, y, 1)` of their middles.
    pub x: [f32; TILE],
    /// See `x`.
    pub y: [f32; TILE],
    /// What holds them.
    pub bounds: TileBounds,
}

/// A row of tiles.
pub struct Band {
    /// What holds them.
    pub bounds: TileBounds,
    /// From left to right.
    pub tiles: Vec<Tile>,
}

/// The ray of every pixel, in tiles: what an object can't be seen in is told by a tile's bounds, whatever the lens bends.
pub struct Rays {
    /// From the top.
    pub bands: Vec<Band>,
    /// Width and height of the picture, pixels.
    pub size: [usize; 2],
}

impl Rays {
    /// Of all pixels of a picture. Tiles may reach beyond its right and lower border.
    ///
    /// # Errors
    /// The place of a pixel that no direction is seen at, pixels.
    pub fn new(lens: &Intrinsics) -> Result<Rays, [u32; 2]> {
        let [width, height] = lens.size;
        let last = |n: u32, k: usize| u32::try_from(k).unwrap_or(n).min(n.saturating_sub(1));
        let size = lens.size.map(|n| n as usize);
        let mut bands = Vec::new();
        for top in (0..size[1]).step_by(TILE_HEIGHT) {
            let mut band = Band { bounds: NOTHING, tiles: Vec::new() };
            for left in (0..size[0]).step_by(TILE_WIDTH) {
                let mut tile = Tile { x: [0.0; TILE], y: [0.0; TILE], bounds: NOTHING };
                for (k, (tx, ty)) in tile.x.iter_mut().zip(&mut tile.y).enumerate() {
                    // pixels beyond the border are as the one at the border: seen by nobody, and not beyond the lens's bounds
                    let at = [last(width, left + k % TILE_WIDTH), last(height, top + k / TILE_WIDTH)];
                    let [x, y] = unproject(lens, at.map(|n| f64::from(n) + 0.5)).ok_or(at)?;
                    (*tx, *ty) = (x as f32, y as f32);
                    tile.bounds = union(tile.bounds, [*tx, *tx, *ty, *ty]);
                }
                band.bounds = union(band.bounds, tile.bounds);
                band.tiles.push(tile);
            }
            bands.push(band);
        }
        Ok(Rays { bands, size })
    }
}
