//! Image files: the only decoder, for folder cameras, stickers, walls, training and evaluation.
//!
//! An image is rotated upright by its EXIF orientation, 16-bit channels are reduced to 8 bits, and transparent pixels
//! become white.

use image::{DynamicImage, ImageDecoder, ImageReader, Limits, RgbImage};
use mobee_model::file::{MIB, open as open_file, read as read_file};
use std::io::{BufRead, BufReader, Cursor, Seek};
use std::path::{Path, PathBuf};

/// Greatest width or height of an image, pixels.
pub const MAX_SIDE: u32 = 4096;
/// Greatest size of an image file.
const MAX_FILE_BYTES: u64 = 256 * MIB;
/// Greatest number of images in a folder.
const MAX_PICTURES: usize = 100_000;
/// Suffix of a mask's file name, in lower case; it follows the name of the image.
pub const MASK_ENDING: &str = "_mask.png";
/// Suffixes of image files, in lower case.
const ENDINGS: [&str; 5] = [".jpg", ".jpeg", ".jpe", ".jfif", ".png"];
/// Suffixes of image formats that are not decoded.
const OTHER_ENDINGS: [&str; 10] = [".bmp", ".gif", ".webp", ".tif", ".tiff", ".heic", ".heif", ".avif", ".ppm", ".pgm"];

/// Error: an image, mask or folder that can't be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}: {what}", path.display())]
pub struct PictureFault {
    /// File or folder.
    pub path: PathBuf,
    /// Problem.
    pub what: String,
    /// Remedy.
    pub help: String,
}

impl PictureFault {
    /// Creates a fault of the file or folder at `path`.
    pub fn new(path: &Path, what: impl Into<String>, help: impl Into<String>) -> PictureFault {
        PictureFault { path: path.to_owned(), what: what.into(), help: help.into() }
    }
}

/// Images of a folder.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PictureFolder {
    /// Images in the order of their names, without the masks.
    pub pictures: Vec<PictureFile>,
    /// Masks whose image is missing.
    pub lone_masks: Vec<PathBuf>,
}

/// An image in a folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PictureFile {
    /// Path of the file.
    pub path: PathBuf,
    /// File name without its suffix.
    pub name: String,
    /// Path of its mask, if there is one.
    pub mask: Option<PathBuf>,
}

/// Lists the images of a folder and their masks: `NAME.jpg` (or `.jpeg`, `.png`) and `NAME_mask.png`. Suffixes may be
/// in upper case; hidden files and files of other kinds are skipped.
///
/// # Errors
/// A folder that can't be read or has no images, an image in another format, two masks of one image, more than
/// 100,000 images.
pub fn list(folder: &Path) -> Result<PictureFolder, PictureFault> {
    let unreadable =
        |e: std::io::Error| PictureFault::new(folder, format!("can't read it: {e}"), "give a folder of pictures");
    let mut names = Vec::new();
    let mut pictures = Vec::new();
    let mut masks = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        names.push(entry.map_err(unreadable)?.file_name());
        if names.len() > 4 * MAX_PICTURES {
            break;
        }
    }
    names.sort();
    for name in names {
        let path = folder.join(&name);
        let name = name.to_string_lossy().into_owned();
        if name.starts_with('.') {
            continue;
        }
        if let Some(of) = without_ending(&name, &[MASK_ENDING]) {
            masks.push((of.to_owned(), path));
        } else if let Some(stem) = without_ending(&name, &ENDINGS) {
            pictures.push(PictureFile { path, name: stem.to_owned(), mask: None });
        } else if without_ending(&name, &OTHER_ENDINGS).is_some() {
            let help = "convert it to PNG or JPEG, or take it out of the folder";
            return Err(PictureFault::new(&path, "pictures of this format can't be read", help));
        }
    }
    if pictures.is_empty() && masks.is_empty() {
        return Err(no_pictures(folder));
    }
    if pictures.len() > MAX_PICTURES {
        let what = format!("there are more than {MAX_PICTURES} pictures in it");
        return Err(PictureFault::new(folder, what, "give fewer pictures"));
    }
    let mut lone_masks = Vec::new();
    for (of, path) in masks {
        let mut is_alone = true;
        for picture in pictures.iter_mut().filter(|p| p.name == of) {
            is_alone = false;
            if picture.mask.replace(path.clone()).is_some() {
                let what = format!("the picture {of} has another mask beside this one");
                return Err(PictureFault::new(&path, what, "remove one of them"));
            }
        }
        if is_alone {
            lone_masks.push(path);
        }
    }
    Ok(PictureFolder { pictures, lone_masks })
}

/// Paths of a folder's images in the order of their names.
///
/// # Errors
/// As for [`list`], and a folder that has only masks.
pub fn list_paths(folder: &Path) -> Result<Vec<PathBuf>, PictureFault> {
    let pictures = list(folder)?.pictures;
    if pictures.is_empty() { Err(no_pictures(folder)) } else { Ok(pictures.into_iter().map(|p| p.path).collect()) }
}

fn no_pictures(folder: &Path) -> PictureFault {
    let help = "give a folder of JPEG or PNG files";
    PictureFault::new(folder, "there are no pictures (.jpg, .jpeg, .png) in it", help)
}

/// Returns the name before one of these suffixes, ignoring case.
fn without_ending<'a>(name: &'a str, endings: &[&str]) -> Option<&'a str> {
    let stem = |ending: &&str| {
        let (stem, last) = name.split_at_checked(name.len().checked_sub(ending.len())?)?;
        (last.eq_ignore_ascii_case(ending) && !stem.is_empty()).then_some(stem)
    };
    endings.iter().find_map(stem)
}

/// Reads an image: red, green and blue, 8 bits each.
///
/// # Errors
/// As for [`open`].
pub fn read(path: &Path) -> Result<RgbImage, PictureFault> {
    open(path).map(on_white)
}

/// Reads an image or mask with all its channels, upright.
///
/// # Errors
/// A file that can't be read, is not a regular file, is damaged, is not JPEG or PNG, or has more than 4096x4096
/// pixels.
pub fn open(path: &Path) -> Result<DynamicImage, PictureFault> {
    let bytes = read_file(path, MAX_FILE_BYTES).map_err(|e| unreadable(path, &e))?;
    upright(&bytes).map_err(|e| PictureFault::new(path, format!("this is no whole picture: {e}"), HELP))
}

/// Width and height of an image as [`read`] returns it, from the head of its file.
///
/// # Errors
/// As for [`open`], but damage behind the head is not detected.
pub fn size(path: &Path) -> Result<[u32; 2], PictureFault> {
    let wrong = |what: String| PictureFault::new(path, what, HELP);
    let (decoder, orientation) = decoder(reader(path)?).map_err(|e| wrong(format!("this is no picture: {e}")))?;
    let (width, height) = decoder.dimensions();
    if width == 0 || height == 0 {
        return Err(wrong(format!("this picture is {width}x{height} pixels")));
    }
    let is_turned = orientation.to_exif() >= 5;
    Ok(if is_turned { [height, width] } else { [width, height] })
}

/// Decodes an image from the bytes of its file.
///
/// # Errors
/// As for [`open`], as text.
pub fn decode(bytes: &[u8]) -> Result<RgbImage, String> {
    upright(bytes).map(on_white)
}

/// Remedy for a file that is not a usable image.
const HELP: &str = "replace it by a whole JPEG or PNG file of at most 4096x4096 pixels";

fn unreadable(path: &Path, e: &std::io::Error) -> PictureFault {
    PictureFault::new(path, format!("can't read it: {e}"), "give a JPEG or PNG file; check its permissions")
}

fn reader(path: &Path) -> Result<ImageReader<BufReader<std::fs::File>>, PictureFault> {
    let wrong = |e: std::io::Error| unreadable(path, &e);
    let file = open_file(path).map_err(wrong)?;
    if file.metadata().map_err(wrong)?.len() > MAX_FILE_BYTES {
        return Err(PictureFault::new(path, format!("it has more than {} MiB", MAX_FILE_BYTES / MIB), HELP));
    }
    ImageReader::new(BufReader::new(file)).with_guessed_format().map_err(wrong)
}

/// Decoder of an image within the limits, and the orientation of the image.
fn decoder<'a, R: BufRead + Seek + 'a>(
    mut reader: ImageReader<R>,
) -> image::ImageResult<(impl ImageDecoder + 'a, image::metadata::Orientation)> {
    let mut limits = Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(MAX_SIDE), Some(MAX_SIDE));
    reader.limits(limits);
    let mut decoder = reader.into_decoder()?;
    let orientation = decoder.orientation()?;
    Ok((decoder, orientation))
}

fn upright(bytes: &[u8]) -> Result<DynamicImage, String> {
    let reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|e| e.to_string())?;
    let (decoder, orientation) = decoder(reader).map_err(|e| e.to_string())?;
    let mut picture = DynamicImage::from_decoder(decoder).map_err(|e| e.to_string())?;
    if bytes.starts_with(&[0xff, 0xd8]) && !ends_jpeg(bytes) {
        return Err("the file ends in the middle of it".into());
    }
    picture.apply_orientation(orientation);
    Ok(picture)
}

/// Returns whether a JPEG is complete: the decoder fills missing parts with gray.
fn ends_jpeg(bytes: &[u8]) -> bool {
    let mut rest = bytes.get(2..).unwrap_or_default();
    loop {
        // Segments begin with a marker; the last one of a scan is followed by its data.
        match rest {
            [0xff, 0xd9, ..] => return true,
            // padding, stuffed data and restart markers
            [0xff, 0xff, ..] => rest = rest.get(1..).unwrap_or_default(),
            [0xff, 0x00 | 0x01 | 0xd0..=0xd7, ..] => rest = rest.get(2..).unwrap_or_default(),
            [0xff, _, high, low, ..] => {
                let length = 2 + usize::from(u16::from_be_bytes([*high, *low]));
                rest = rest.get(length..).unwrap_or_default();
            }
            [] | [0xff, ..] => return false,
            _ => match rest.iter().position(|b| *b == 0xff) {
                Some(at) => rest = rest.get(at..).unwrap_or_default(),
                None => return false,
            },
        }
    }
}

/// Converts to 8-bit colors; transparent pixels become white.
fn on_white(picture: DynamicImage) -> RgbImage {
    if !picture.color().has_alpha() {
        return picture.into_rgb8();
    }
    let picture = picture.into_rgba8();
    let mut flat = RgbImage::new(picture.width(), picture.height());
    for (to, from) in flat.pixels_mut().zip(picture.pixels()) {
        let [red, green, blue, alpha] = from.0.map(u32::from);
        to.0 = [red, green, blue].map(|c| ((c * alpha + 255 * (255 - alpha) + 127) / 255).min(255) as u8);
    }
    flat
}
