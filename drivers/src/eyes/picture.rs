//! Pictures from files.

use super::solid::V3;
use super::texture::Texture;
use image::{ImageFormat, ImageReader, ImageResult, Limits, RgbImage};
use mobee_contract::KindError;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use std::fs::File;
use std::io::{BufRead, BufReader, Cursor, Seek};
use std::path::{Path, PathBuf};

/// The longest side that a picture may have, pixels.
pub(super) const LONGEST: u32 = 4096;
/// Pictures of a folder that are looked at, at most.
const MOST: usize = 100_000;

/// The pictures of a folder, in the order of their names: those that end in `.jpg`, `.jpeg` or `.png`, but for masks (`_mask.png`).
///
/// # Errors
/// If the folder can't be read, or has none.
pub fn list(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let at = folder.display();
    let entries = std::fs::read_dir(folder).map_err(|e| format!("can't read {at}: {e}"))?;
    let mut found = Vec::new();
    for entry in entries {
        let path = entry.map_err(|e| format!("can't read {at}: {e}"))?.path();
        let name = path.file_name().map(|n| n.to_string_lossy().to_lowercase()).unwrap_or_default();
        if [".jpg", ".jpeg", ".png"].iter().any(|e| name.ends_with(e)) && !name.ends_with("_mask.png") {
            found.push(path);
        }
        if found.len() > MOST {
            return Err(format!("there are more than {MOST} pictures in {at}"));
        }
    }
    if found.is_empty() {
        return Err(format!("there are no pictures (.jpg, .jpeg, .png) in {at}"));
    }
    found.sort();
    Ok(found)
}

/// A picture.
///
/// # Errors
/// If it can't be read, is broken, or larger than 4096x4096 pixels.
pub fn read(path: &Path) -> Result<RgbImage, String> {
    let picture = open(path)?.decode().map_err(|e| format!("{} is no whole picture: {e}", path.display()))?;
    Ok(picture.into_rgb8())
}

/// Width and height of a picture, by its first bytes.
///
/// # Errors
/// If it can't be read, is none, or too large.
pub fn size(path: &Path) -> Result<[u32; 2], String> {
    let at = path.display();
    let (width, height) = open(path)?.into_dimensions().map_err(|e| format!("{at} is no picture: {e}"))?;
    if width == 0 || height == 0 || width > LONGEST || height > LONGEST {
        return Err(format!("{at} is {width}x{height} pixels"));
    }
    Ok([width, height])
}

/// A picture in PNG format.
///
/// # Errors
/// If it is broken, or larger than 4096x4096 pixels.
pub(super) fn decode(png: &[u8]) -> ImageResult<RgbImage> {
    Ok(limited(ImageReader::with_format(Cursor::new(png), ImageFormat::Png)).decode()?.into_rgb8())
}

fn open(path: &Path) -> Result<ImageReader<BufReader<File>>, String> {
    let opened = ImageReader::open(path).and_then(ImageReader::with_guessed_format);
    opened.map(limited).map_err(|e| format!("can't read {}: {e}", path.display()))
}

fn limited<R: BufRead + Seek>(mut reader: ImageReader<R>) -> ImageReader<R> {
    let mut limits = Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(LONGEST), Some(LONGEST));
    reader.limits(limits);
    reader
}

/// Pictures for walls, drawn from a file or a folder.
///
/// # Errors
/// If there are none, or one that is drawn is broken.
pub fn textures(path: &Path, count: usize, rng: &mut ChaCha8Rng) -> Result<Vec<Texture>, KindError> {
    let wrong =
        |what| KindError::new("pictures", what, "give a JPEG or PNG file of at most 4096x4096 pixels, or a folder");
    let files = if path.is_dir() { list(path).map_err(wrong)? } else { vec![path.to_owned()] };
    let mut draw = || files.get(rng.random_range(0..files.len()));
    let drawn: Vec<&PathBuf> = (0..count).filter_map(|_| draw()).collect();
    let texture = |p: &PathBuf| {
        let picture = read(p)?;
        let (width, height) = picture.dimensions();
        let color = |u: f32, v: f32| {
            let at = |share: f32, n: u32| ((share * n as f32) as u32).min(n.saturating_sub(1));
            let [r, g, b] = picture.get_pixel(at(u, width), at(v, height)).0;
            V3::new(f32::from(r), f32::from(g), f32::from(b))
        };
        Ok(Texture::sampled(9, color))
    };
    drawn.into_iter().map(texture).collect::<Result<_, _>>().map_err(wrong)
}
