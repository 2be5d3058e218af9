//! Pictures in files, as people see them: the one decoder of folder cameras, stickers, walls, training and evaluation.
//!
//! A picture is turned upright as its EXIF orientation says, 16 bits for each channel become 8, and transparent pixels show white paper.

use image::{DynamicImage, ImageDecoder, ImageReader, Limits, RgbImage};
use mobee_model::file::{MIB, open as open_file, read as read_file};
use std::io::{BufRead, BufReader, Cursor, Seek};
use std::path::{Path, PathBuf};

/// Greatest width or height of a picture, pixels.
pub const MAX_SIDE: u32 = 4096;
/// Greatest length of a picture's file.
const MAX_FILE_BYTES: u64 = 256 * MIB;
/// Greatest number of pictures in a folder.
const MAX_PICTURES: usize = 100_000;
/// Ending of a mask's file name, in small letters; the name of its picture precedes it.
pub const MASK_ENDING: &str = "_mask.png";
/// Endings of the names of pictures, in small letters.
const ENDINGS: [&str; 5] = [".jpg", ".jpeg", ".jpe", ".jfif", ".png"];
/// Endings of pictures in formats that are not decoded.
const OTHER_ENDINGS: [&str; 10] = [".bmp", ".gif", ".webp", ".tif", ".tiff", ".heic", ".heif", ".avif", ".ppm", ".pgm"];

/// A picture, mask or folder that can't be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}: {what}", path.display())]
pub struct PictureFault {
    /// The file or folder.
    pub path: PathBuf,
    /// The problem.
    pub what: String,
    /// The remedy.
    pub help: String,
}

impl PictureFault {
    /// A fault of the file or folder at `path`.
    pub fn new(path: &Path, what: impl Into<String>, help: impl Into<String>) -> PictureFault {
        PictureFault { path: path.to_owned(), what: what.into(), help: help.into() }
    }
}

/// The pictures of a folder.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PictureFolder {
    /// Its pictures in the order of their names, without the masks.
    pub pictures: Vec<PictureFile>,
    /// Masks whose picture is missing.
    pub lone_masks: Vec<PathBuf>,
}

/// A picture in a folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PictureFile {
    /// Its file.
    pub path: PathBuf,
    /// The file's name without its ending.
    pub name: String,
    /// Its mask, if there is one.
    pub mask: Option<PathBuf>,
}

/// Lists the pictures of a folder and their masks: `NAME.jpg` (or `.jpeg`, `.png`) and `NAME_mask.png`. Endings may be in capitals; hidden
/// files and files that are no pictures are skipped.
///
/// # Errors
/// A folder that can't be read or has no pictures, a picture in another format, two masks of one picture, more than 100,000 pictures.
pub fn list(folder: &Path) -> Result<PictureFolder, PictureFault> {
    let unreadable =
        |e: std::io::Error| PictureFault::new(folder, format!("can't read it: {e}"), "give a folder of pictures");
    let (mut names, mut pictures, mut masks) = (Vec::new(), Vec::new(), Vec::new());
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        names.push(entry.map_err(unreadable)?.file_name());
        if names.len() > 4 * MAX_PICTURES {
            break;
        }
    }
    names.sort();
    for name in names {
        let (path, name) = (folder.join(&name), name.to_string_lossy().into_owned());
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

/// The paths of a folder's pictures in the order of their names.
///
/// # Errors
/// As for [`list`], and a folder of masks alone.
pub fn list_paths(folder: &Path) -> Result<Vec<PathBuf>, PictureFault> {
    let pictures = list(folder)?.pictures;
    if pictures.is_empty() { Err(no_pictures(folder)) } else { Ok(pictures.into_iter().map(|p| p.path).collect()) }
}

fn no_pictures(folder: &Path) -> PictureFault {
    let help = "give a folder of JPEG or PNG files";
    PictureFault::new(folder, "there are no pictures (.jpg, .jpeg, .png) in it", help)
}

/// The name before one of these endings, which it may have in capitals.
fn without_ending<'a>(name: &'a str, endings: &[&str]) -> Option<&'a str> {
    let stem = |ending: &&str| {
        let (stem, last) = name.split_at_checked(name.len().checked_sub(ending.len())?)?;
        (last.eq_ignore_ascii_case(ending) && !stem.is_empty()).then_some(stem)
    };
    endings.iter().find_map(stem)
}

/// Reads a picture: red, green and blue, 8 bits each.
///
/// # Errors
/// As for [`open`].
pub fn read(path: &Path) -> Result<RgbImage, PictureFault> {
    open(path).map(on_white)
}

/// Reads a picture or mask with all its channels, upright.
///
/// # Errors
/// A file that can't be read, is no regular file, is damaged, not JPEG or PNG, or has more than 4096x4096 pixels.
pub fn open(path: &Path) -> Result<DynamicImage, PictureFault> {
    let bytes = read_file(path, MAX_FILE_BYTES).map_err(|e| unreadable(path, &e))?;
    upright(&bytes).map_err(|e| PictureFault::new(path, format!("this is no whole picture: {e}"), HELP))
}

/// Width and height of a picture as [`read`] returns it, from the head of its file.
///
/// # Errors
/// As for [`open`], but damage behind the head is not noticed.
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

/// Decodes a picture from the bytes of its file.
///
/// # Errors
/// As for [`open`], in words.
pub fn decode(bytes: &[u8]) -> Result<RgbImage, String> {
    upright(bytes).map(on_white)
}

/// Remedy for a file that is no picture.
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

/// The decoder of a picture within the limits, and how its picture must be turned.
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

/// Whether a JPEG goes on to its end: the decoder shows gray where it does not.
fn ends_jpeg(bytes: &[u8]) -> bool {
    let mut rest = bytes.get(2..).unwrap_or_default();
    loop {
        // segments begin with a marker; behind the last one of a scan there is its data
        match rest {
            [0xff, 0xd9, ..] => return true,
            // filling, stuffed data and restarts
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

/// Colors of 8 bits; what is transparent shows white.
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
