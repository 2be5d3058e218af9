//! Search for tags in an image.

use super::super::picture::Picture;
use super::family::TagFamilyName;
use super::read::{Codes, Gray};
use kornia_apriltag::DecodeTagsConfig;
use kornia_apriltag::decoder::{GrayModelPair, decode_tags};
use kornia_apriltag::quad::{Quad, fit_quads};
use kornia_apriltag::segmentation::{find_connected_components, find_gradient_clusters};
use kornia_apriltag::threshold::{TileMinMax, adaptive_threshold};
use kornia_apriltag::union_find::UnionFind;
use kornia_apriltag::utils::Pixel;
use kornia_image::allocator::CpuAllocator;
use kornia_image::{Image, ImageSize};

/// A tag detected in an image.
#[derive(Clone, Debug, PartialEq)]
pub struct SeenTag {
    /// Number of the tag.
    pub id: u16,
    /// Center, pixels from the image's upper left corner.
    pub center: [f64; 2],
    /// Corners of its black border, pixels: upper left, upper right, lower right, lower left as
    /// printed.
    pub corners: [[f64; 2]; 4],
    /// Number of misread bits.
    pub errors: u8,
    /// Decision margin, 0 to 255.
    pub margin: f64,
}

/// Range of image widths and heights that are processed, pixels.
const EDGE_RANGE_PX: std::ops::RangeInclusive<usize> = 16..=4096;
/// Edge of a tile, pixels. The search uses whole tiles.
const TILE_PX: usize = 4;
/// Minimum width of a tag's black border, pixels.
const MIN_TAG_PX: usize = 8;

/// Maximum number of misread bits; a quad with more is not a tag.
const MAX_ERRORS: u8 = 2;

/// Detects the tags of a family.
///
/// Edges and corners are found by `kornia-apriltag`. The bits are decoded here: the library's
/// decoding of a quad depends on the quads decoded before it, which come in a varying order.
pub struct TagSeeker {
    codes: Codes,
    /// Buffers that are reused while the image size is constant.
    work: Option<TagBuffers>,
}

struct TagBuffers {
    size: ImageSize,
    /// Without a family: decodes nothing.
    config: DecodeTagsConfig,
    /// Binarized image.
    pixels: Image<Pixel, 1, CpuAllocator>,
    tiles: TileMinMax,
    parts: UnionFind,
}

impl TagBuffers {
    fn new(size: ImageSize) -> Option<TagBuffers> {
        let mut config = DecodeTagsConfig::new(Vec::new());
        (config.downscale_factor, config.min_tag_width, config.normal_border) = (1, MIN_TAG_PX, true);
        let pixels = Image::from_size_val(size, Pixel::Skip, CpuAllocator).ok()?;
        let parts = UnionFind::new(size.width * size.height);
        Some(TagBuffers { size, config, pixels, tiles: TileMinMax::new(size, TILE_PX), parts })
    }

    /// Finds quadrilaterals that are black within white.
    fn quads(&mut self, image: &Image<u8, 1, CpuAllocator>) -> Option<Vec<Quad>> {
        let least = self.config.min_white_black_difference;
        adaptive_threshold(image, &mut self.pixels, &mut self.tiles, least).ok()?;
        self.parts.reset();
        find_connected_components(&self.pixels, &mut self.parts).ok()?;
        let mut clusters = Default::default();
        find_gradient_clusters(&self.pixels, &mut self.parts, &mut clusters);
        let mut quads = fit_quads(&self.pixels, &mut clusters, &self.config);
        // Without a family nothing is decoded, but edges are refined to those of the image.
        decode_tags(image, &mut quads, &mut self.config, &mut GrayModelPair::new());
        Some(quads)
    }
}

impl TagSeeker {
    /// Creates a detector for this family.
    pub fn new(family: TagFamilyName) -> TagSeeker {
        TagSeeker { codes: Codes::new(family), work: None }
    }

    /// Returns all tags of an image, each id once, ordered by id; none in an image with an edge
    /// below 16 or above 4096 pixels.
    pub fn seek(&mut self, picture: &Picture) -> Vec<SeenTag> {
        self.look(picture).unwrap_or_default()
    }

    fn look(&mut self, picture: &Picture) -> Option<Vec<SeenTag>> {
        let size = [picture.width, picture.height];
        let is_whole = picture.rgb.len() == picture.width.saturating_mul(picture.height).saturating_mul(3);
        if !is_whole || !size.iter().all(|n| EDGE_RANGE_PX.contains(n)) {
            return None;
        }
        let [width, height] = size.map(|n| n.next_multiple_of(TILE_PX));
        let size = ImageSize { width, height };
        let image = Image::<u8, 1, CpuAllocator>::new(size, gray(picture, width, height), CpuAllocator).ok()?;
        if self.work.as_ref().is_none_or(|w| w.size != size) {
            self.work = TagBuffers::new(size);
        }
        let quads = self.work.as_mut()?.quads(&image)?;
        let gray = Gray { width, height, data: image.as_slice() };
        let mut tags: Vec<SeenTag> = quads.iter().filter_map(|quad| self.tag(&gray, quad)).collect();
        // Quads come in a varying order, and may include both the inner and the outer edge of one
        // border.
        let order = |a: &SeenTag, b: &SeenTag| {
            let surer = a.errors.cmp(&b.errors).then(b.margin.total_cmp(&a.margin));
            let left = a.center[0].total_cmp(&b.center[0]).then(a.center[1].total_cmp(&b.center[1]));
            a.id.cmp(&b.id).then(surer).then(left)
        };
        tags.sort_by(order);
        tags.dedup_by_key(|t| t.id);
        Some(tags)
    }

    fn tag(&self, gray: &Gray, quad: &Quad) -> Option<SeenTag> {
        let place = |x: f64, y: f64| {
            let p = quad.homography_project(x as f32, y as f32);
            [f64::from(p.x), f64::from(p.y)]
        };
        let read = self.codes.read(gray, place)?;
        let corner = |x: f64, y: f64| {
            let [x, y] = (0..read.quarters).fold([x, y], |[x, y], _| [-y, x]);
            place(x, y)
        };
        let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
        let center = place(0.0, 0.0);
        let is_finite = corners.iter().chain([&center]).flatten().all(|n| n.is_finite());
        let is_tag = is_finite && read.errors <= MAX_ERRORS;
        is_tag.then_some(SeenTag { id: read.id, center, corners, errors: read.errors, margin: read.margin })
    }
}

/// Converts an image to gray and extends it to the right and downward by its border pixels.
fn gray(picture: &Picture, width: usize, height: usize) -> Vec<u8> {
    let mut gray = Vec::with_capacity(width * height);
    for row in picture.rgb.chunks_exact(picture.width * 3) {
        let brightness = |p: &[u8]| match p {
            [r, g, b] => ((u32::from(*r) * 77 + u32::from(*g) * 150 + u32::from(*b) * 29) >> 8) as u8,
            _ => 0,
        };
        let start = gray.len();
        gray.extend(row.chunks_exact(3).map(brightness));
        let last = gray.last().copied().unwrap_or(0);
        gray.resize(start + width, last);
    }
    while gray.len() < width * height {
        gray.extend_from_within(gray.len() - width..);
    }
    gray
}
