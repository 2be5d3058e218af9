//! What cameras see, and what was found in it.

use crate::body::entity;
use crate::palette;
use crate::stream::{Stream, Written};
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder};
use mobee_contract::{Frame, Region};
use rerun::{Boxes2D, EncodedImage, Points2D};

/// Of a hundred: pictures for people to look at.
const QUALITY: u8 = 80;

/// The entity of a camera: its sensor's and its own name.
pub(crate) fn path(camera: &str) -> String {
    let parts: Vec<String> = camera.split('/').map(entity).collect();
    format!("eyes/{}", parts.join("/"))
}

/// Draws a picture, and boxes and centers of what was found in it.
///
/// # Errors
/// In words. A picture that is not what it says is left out.
pub(crate) fn show(stream: &Stream, eye: &str, frame: &Frame, regions: &[Region]) -> Written {
    let [width, height] = frame.intrinsics.size;
    let mut jpeg = Vec::new();
    let encoder = JpegEncoder::new_with_quality(&mut jpeg, QUALITY);
    if encoder.write_image(&frame.pixels, width, height, ExtendedColorType::Rgb8).is_ok() {
        let picture = EncodedImage::from_file_contents(jpeg).with_media_type("image/jpeg");
        stream.log(&format!("{eye}/picture"), &picture)?;
    }
    let ends = |i: usize, k: usize| regions.iter().map(move |r| (r.bounds[i] as f32, r.bounds[k] as f32));
    let sizes = ends(2, 3).zip(ends(0, 1)).map(|((right, bottom), (left, top))| (right - left, bottom - top));
    let boxes = Boxes2D::from_mins_and_sizes(ends(0, 1), sizes)
        .with_colors([palette::NEAR])
        .with_labels(regions.iter().map(|r| r.object.clone()));
    stream.log(&format!("{eye}/regions"), &boxes)?;
    let centers = regions.iter().map(|r| (r.center[0] as f32, r.center[1] as f32));
    stream.log(&format!("{eye}/centers"), &Points2D::new(centers).with_colors([palette::NEAR]).with_radii([2.0]))
}
