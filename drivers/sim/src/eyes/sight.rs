//! Rasterizer: the shape that each pixel shows, and its depth, tile by tile.

use super::lens::{NOTHING, Rays, TILE, TILE_HEIGHT, TILE_WIDTH, Tile, TileBounds, overlaps};
use super::solid::CameraForm;

/// Index that stands for no shape.
pub const NOBODY: u32 = u32::MAX;

/// Visible shapes of a tile.
pub struct TileSight<'a> {
    /// Pixel in its upper left corner.
    pub corner: [usize; 2],
    /// Its rays.
    pub tile: &'a Tile,
    /// Depth along the optical axis, meters; infinite where no shape is.
    pub depth: &'a [f32; TILE],
    /// Index of the shape; [`NOBODY`] where there is none.
    pub solid: &'a [u32; TILE],
}

/// Rasterizes shapes in the camera frame, and passes the result on tile by tile, row by row.
///
/// # Performance
/// A shape is tested only with the tiles that its bounds overlap.
pub fn look(rays: &Rays, forms: &[CameraForm], mut tell: impl FnMut(TileSight)) {
    let bounds: Vec<(u32, &CameraForm, TileBounds)> = (0u32..).zip(forms).map(|(k, f)| (k, f, f.bounds())).collect();
    let mut here: Vec<&(u32, &CameraForm, TileBounds)> = Vec::with_capacity(bounds.len());
    for (row, band) in rays.bands.iter().enumerate() {
        here.clear();
        here.extend(bounds.iter().filter(|(.., b)| *b != NOTHING && overlaps(b, &band.bounds)));
        for (column, tile) in band.tiles.iter().enumerate() {
            let mut depth = [f32::INFINITY; TILE];
            let mut solid = [NOBODY; TILE];
            for (number, form, _) in here.iter().filter(|(.., b)| overlaps(b, &tile.bounds)) {
                form.cast(tile, *number, &mut depth, &mut solid);
            }
            let corner = [column * TILE_WIDTH, row * TILE_HEIGHT];
            tell(TileSight { corner, tile, depth: &depth, solid: &solid });
        }
    }
}

/// Copies the values of a tile into an image, without the part beyond the border.
pub fn lay<T: Copy>(corner: [usize; 2], of: &[T; TILE], picture: &mut [T], [width, height]: [usize; 2]) {
    let [left, top] = corner;
    let wide = TILE_WIDTH.min(width.saturating_sub(left));
    for (row, y) in of.chunks_exact(TILE_WIDTH).zip(top..height) {
        let start = y * width + left;
        if let (Some(to), Some(from)) = (picture.get_mut(start..start + wide), row.get(..wide)) {
            to.copy_from_slice(from);
        }
    }
}
