//! Camera projection in both directions: a pinhole with Brown-Conrady distortion in OpenCV's convention, and
//! the ray of every pixel.

use mobee_contract::Intrinsics;

/// Pixels in a row of a tile.
pub const TILE_WIDTH: usize = 16;
/// Rows of a tile.
pub const TILE_HEIGHT: usize = 8;
/// Pixels of a tile.
pub const TILE: usize = TILE_WIDTH * TILE_HEIGHT;

/// Projects a direction `(x, y, 1)` of the camera frame (z along the axis, x right, y down) to pixels from
/// the upper left corner of the image.
pub fn project(lens: &Intrinsics, [x, y]: [f64; 2]) -> [f64; 2] {
    let [x, y] = bend(lens.distortion, [x, y]);
    let ([fx, fy], [cx, cy]) = (lens.focal, lens.center);
    [fx * x + cx, fy * y + cy]
}

/// Direction `(x, y, 1)` of a pixel position; `None` if there is none, because the lens polynomial folds the
/// image over there.
pub fn unproject(lens: &Intrinsics, [u, v]: [f64; 2]) -> Option<[f64; 2]> {
    let ([fx, fy], [cx, cy]) = (lens.focal, lens.center);
    let seen = [(u - cx) / fx, (v - cy) / fy];
    let mut at = seen;
    for _ in 0..50 {
        let [bx, by] = bend(lens.distortion, at);
        let [ex, ey] = [seen[0] - bx, seen[1] - by];
        if ex.abs().max(ey.abs()) < 1e-12 {
            // beyond the fold the same position is seen mirrored, which no real lens does
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

/// Applies the distortion to a direction.
fn bend([k1, k2, p1, p2]: [f64; 4], [x, y]: [f64; 2]) -> [f64; 2] {
    let r2 = x * x + y * y;
    let radial = 1.0 + r2 * (k1 + r2 * k2);
    let bent_x = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
    let bent_y = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
    [bent_x, bent_y]
}

/// Jacobian of the distortion.
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

/// Least determinant of the Jacobian between the axis and this direction: positive on the near side of the
/// first fold.
fn slope(distortion: [f64; 4], [x, y]: [f64; 2]) -> f64 {
    let steps = (0..=16).map(|k| f64::from(k) / 16.0);
    let det = |share: f64| {
        let [[a, b], [c, d]] = jacobian(distortion, [x * share, y * share]);
        a * d - b * c
    };
    steps.map(det).fold(f64::INFINITY, f64::min)
}

/// Smallest box around something visible: least and greatest x, least and greatest y of its directions `(x,
/// y, 1)`.
pub type TileBounds = [f32; 4];

/// True if two boxes overlap.
pub fn overlaps(a: &TileBounds, b: &TileBounds) -> bool {
    a[0] <= b[1] && b[0] <= a[1] && a[2] <= b[3] && b[2] <= a[3]
}

/// Smallest box that contains both.
pub fn union(a: TileBounds, b: TileBounds) -> TileBounds {
    [a[0].min(b[0]), a[1].max(b[1]), a[2].min(b[2]), a[3].max(b[3])]
}

/// Empty box.
pub const NOTHING: TileBounds = [f32::INFINITY, f32::NEG_INFINITY, f32::INFINITY, f32::NEG_INFINITY];

/// A tile of adjacent pixels, row by row.
pub struct Tile {
    /// x of the directions `(x, y, 1)` of the pixels' centers.
    pub x: [f32; TILE],
    /// y of these directions.
    pub y: [f32; TILE],
    /// Box around the directions.
    pub bounds: TileBounds,
}

/// A row of tiles.
pub struct Band {
    /// Box around the tiles.
    pub bounds: TileBounds,
    /// Tiles from left to right.
    pub tiles: Vec<Tile>,
}

/// Rays of all pixels, in tiles. The bounds of a tile exclude invisible objects for any distortion.
pub struct Rays {
    /// Bands from the top.
    pub bands: Vec<Band>,
    /// Width and height of the image, pixels.
    pub size: [usize; 2],
}

impl Rays {
    /// Computes the rays of all pixels of an image. Tiles may extend beyond its right and lower border.
    ///
    /// # Errors
    /// A pixel without a direction.
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
                    // pixels beyond the border repeat the border's ray: they are never shown, and must not
                    // enlarge the bounds
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
