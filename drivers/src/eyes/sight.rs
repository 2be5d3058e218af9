//! Which shape each pixel sees, and how far away it is: a depth buffer, tile by tile.

use super::lens::{NOTHING, Rays, TILE, TILE_HEIGHT, TILE_WIDTH, Tile, TileBounds, overlaps};
use super::solid::Form;

/// The number of no shape.
pub const NOBODY: u32 = u32::MAX;

/// What a tile sees.
pub struct TileSight<'a> {
    /// The pixel in its upper left corner.
    pub corner: [usize; 2],
    /// Its rays.
    pub tile: &'a Tile,
    /// Along the optical axis, meters; infinite where nothing is.
    pub depth: &'a [f32; TILE],
    /// The number of the shape; [`NOBODY`] where nothing is.
    pub solid: &'a [u32; TILE],
}

/// Looks at shapes in the eye's frame, and tells what each tile sees, row by row.
///
/// # Performance
/// A shape is met with the tiles that its box in the picture overlaps, and with no other.
pub fn look(rays: &Rays, forms: &[Form], mut tell: impl FnMut(TileSight)) {
    let bounds: Vec<(u32, &Form, TileBounds)> = (0u32..).zip(forms).map(|(k, f)| (k, f, f.bounds())).collect();
    let mut here: Vec<&(u32, &Form, TileBounds)> = Vec::with_capacity(bounds.len());
    for (row, band) in rays.bands.iter().enumerate() {
        here.clear();
        here.extend(bounds.iter().filter(|(.., b)| *b != NOTHING && overlaps(b, &band.bounds)));
        for (column, tile) in band.tiles.iter().enumerate() {
            let (mut depth, mut solid) = ([f32::INFINITY; TILE], [NOBODY; TILE]);
            for (number, form, _) in here.iter().filter(|(.., b)| overlaps(b, &tile.bounds)) {
                form.cast(tile, *number, &mut depth, &mut solid);
            }
            let corner = [column * TILE_WIDTH, row * TILE_HEIGHT];
            tell(TileSight { corner, tile, depth: &depth, solid: &solid });
        }
    }
}

/// Copies what a tile says of its pixels into a picture, row by row, without what is beyond the border.
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
