//! Tags in a picture.

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

/// A tag in a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct SeenTag {
    /// Which it is.
    pub id: u16,
    /// Its middle, pixels from the picture's upper left corner.
    pub center: [f64; 2],
    /// The corners of its black border, pixels: upper left, upper right, lower right, lower left as it is printed.
    pub corners: [[f64; 2]; 4],
    /// How many of its bits were read wrong.
    pub errors: u8,
    /// How far its bits were from being read otherwise, of 255.
    pub margin: f64,
}

/// The sizes of pictures that are looked at, pixels.
const EDGES: std::ops::RangeInclusive<usize> = 16..=4096;
/// The search is in tiles of so many pixels, and whole ones.
const TILE: usize = 4;
/// A tag's black border is so many pixels wide at least.
const LEAST: usize = 8;

/// More bits than this are not taken for misread.
const MOST_ERRORS: u8 = 2;

/// Looks for the tags of a family.
///
/// Edges and corners are found by `kornia-apriltag`; what is within them is read here, since its own reading of a quad depends on those that
/// it has read before, in an order that is never the same.
pub struct TagSeeker {
    codes: Codes,
    /// What is used again while pictures are of one size.
    work: Option<Work>,
}

struct Work {
    size: ImageSize,
    /// Without a family: it reads nothing.
    config: DecodeTagsConfig,
    /// Which pixels are black or white.
    pixels: Image<Pixel, 1, CpuAllocator>,
    tiles: TileMinMax,
    parts: UnionFind,
}

impl Work {
    fn new(size: ImageSize) -> Option<Work> {
        let mut config = DecodeTagsConfig::new(Vec::new());
        (config.downscale_factor, config.min_tag_width, config.normal_border) = (1, LEAST, true);
        let pixels = Image::from_size_val(size, Pixel::Skip, CpuAllocator).ok()?;
        let parts = UnionFind::new(size.width * size.height);
        Some(Work { size, config, pixels, tiles: TileMinMax::new(size, TILE), parts })
    }

    /// What has four straight edges, black within white.
    fn quads(&mut self, image: &Image<u8, 1, CpuAllocator>) -> Option<Vec<Quad>> {
        let least = self.config.min_white_black_difference;
        adaptive_threshold(image, &mut self.pixels, &mut self.tiles, least).ok()?;
        self.parts.reset();
        find_connected_components(&self.pixels, &mut self.parts).ok()?;
        let mut clusters = Default::default();
        find_gradient_clusters(&self.pixels, &mut self.parts, &mut clusters);
        let mut quads = fit_quads(&self.pixels, &mut clusters, &self.config);
        // without a family nothing is read, but edges are moved to where the picture's are
        decode_tags(image, &mut quads, &mut self.config, &mut GrayModelPair::new());
        Some(quads)
    }
}

impl TagSeeker {
    /// One for this family.
    pub fn new(family: TagFamilyName) -> TagSeeker {
        TagSeeker { codes: Codes::new(family), work: None }
    }

    /// All tags of a picture, each id once, in the order of their ids. A picture that is smaller than 16 or larger than 4096 pixels
    /// shows none.
    pub fn seek(&mut self, picture: &Picture) -> Vec<SeenTag> {
        self.look(picture).unwrap_or_default()
    }

    fn look(&mut self, picture: &Picture) -> Option<Vec<SeenTag>> {
        let size = [picture.width, picture.height];
        let is_whole = picture.rgb.len() == picture.width.saturating_mul(picture.height).saturating_mul(3);
        if !is_whole || !size.iter().all(|n| EDGES.contains(n)) {
            return None;
        }
        let [width, height] = size.map(|n| n.next_multiple_of(TILE));
        let size = ImageSize { width, height };
        let image = Image::<u8, 1, CpuAllocator>::new(size, gray(picture, width, height), CpuAllocator).ok()?;
        if self.work.as_ref().is_none_or(|w| w.size != size) {
            self.work = Work::new(size);
        }
        let quads = self.work.as_mut()?.quads(&image)?;
        let gray = Gray { width, height, data: image.as_slice() };
        let mut tags: Vec<SeenTag> = quads.iter().filter_map(|quad| self.tag(&gray, quad)).collect();
        // quads come in no order, and the inner and the outer edge of one border may both be among them
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
        let is_tag = is_finite && read.errors <= MOST_ERRORS;
        is_tag.then_some(SeenTag { id: read.id, center, corners, errors: read.errors, margin: read.margin })
    }
}

/// The brightness of each pixel; what is beyond the right and the lower border is as the border.
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
