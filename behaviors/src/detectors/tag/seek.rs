//! Tags in a picture.

use super::super::picture::Picture;
use super::family::TagFamilyName;
use kornia_apriltag::{AprilTagDecoder, DecodeTagsConfig};
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

/// Looks for the tags of a family.
pub struct TagSeeker {
    family: TagFamilyName,
    /// What is used again while pictures are of one size.
    work: Option<([usize; 2], AprilTagDecoder)>,
}

impl TagSeeker {
    /// One for this family.
    pub fn new(family: TagFamilyName) -> TagSeeker {
        TagSeeker { family, work: None }
    }

    /// All tags of a picture, each id once, in the order of their ids. A picture that is smaller than 16 or larger than 4096 pixels
    /// shows none.
    pub fn seek(&mut self, picture: &Picture) -> Vec<SeenTag> {
        let size = [picture.width, picture.height];
        let is_whole = picture.rgb.len() == picture.width.saturating_mul(picture.height).saturating_mul(3);
        if !is_whole || !size.iter().all(|n| EDGES.contains(n)) {
            return Vec::new();
        }
        let [width, height] = size.map(|n| n.next_multiple_of(TILE));
        let Some(decoder) = self.decoder([width, height]) else { return Vec::new() };
        let gray = gray(picture, width, height);
        let image = Image::<u8, 1, CpuAllocator>::new(ImageSize { width, height }, gray, CpuAllocator);
        let found = image.ok().and_then(|image| decoder.decode(&image).ok()).unwrap_or_default();
        decoder.clear();
        let mut tags: Vec<SeenTag> = found
            .iter()
            .filter_map(|d| {
                let at = |x: f32, y: f32| {
                    let p = d.quad.homography_project(x, y);
                    [f64::from(p.x), f64::from(p.y)]
                };
                let corners = [at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)];
                let center = [f64::from(d.center.x), f64::from(d.center.y)];
                let is_finite = corners.iter().chain([&center]).flatten().all(|n| n.is_finite());
                let margin = f64::from(d.decision_margin);
                is_finite.then_some(SeenTag { id: d.id, center, corners, errors: d.hamming, margin })
            })
            .collect();
        // the detector goes through its candidates in no order, and may find the inner and the outer edge of one border
        let order = |a: &SeenTag, b: &SeenTag| {
            let surer = a.errors.cmp(&b.errors).then(b.margin.total_cmp(&a.margin));
            let left = a.center[0].total_cmp(&b.center[0]).then(a.center[1].total_cmp(&b.center[1]));
            a.id.cmp(&b.id).then(surer).then(left)
        };
        tags.sort_by(order);
        tags.dedup_by_key(|t| t.id);
        tags
    }

    fn decoder(&mut self, size: [usize; 2]) -> Option<&mut AprilTagDecoder> {
        if self.work.as_ref().is_none_or(|(of, _)| *of != size) {
            let mut config = DecodeTagsConfig::new(vec![self.family.kind()]);
            // small tags of small pictures are what it is for
            (config.downscale_factor, config.min_tag_width) = (1, LEAST);
            let [width, height] = size;
            let decoder = AprilTagDecoder::new(config, ImageSize { width, height }).ok()?;
            self.work = Some((size, decoder));
        }
        self.work.as_mut().map(|(_, decoder)| decoder)
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
