//! Pictures and masks: from frames and from folders.

use super::plane::Plane;
use image::{ImageReader, Limits};
use mobee_contract::Frame;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// What ends the name of a mask's file; what is before it is the name of its picture.
const MASK: &str = "_mask.png";
/// The longest side that a picture may have, pixels.
const LONGEST: u32 = 4096;
/// The most pixels that the pictures of a folder may have together: all of them are in memory at once.
const MOST: usize = 200_000_000;

/// A color picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Red, green and blue of each pixel, row by row from the top.
    pub rgb: Vec<u8>,
}

/// Which pixels are the object.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// One per pixel, row by row from the top.
    pub data: Vec<bool>,
}

/// A picture of which it is known where the object is.
#[derive(Clone, Debug, PartialEq)]
pub struct LabeledPicture {
    /// The file's name without its ending.
    pub name: String,
    /// The picture.
    pub picture: Picture,
    /// Where the object is.
    pub mask: Mask,
}

/// What is wrong with a picture, a mask or a folder of them.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{}: {what}", path.display())]
pub struct PictureFault {
    /// The file or folder.
    pub path: PathBuf,
    /// What is wrong with it.
    pub what: String,
    /// What to do about it.
    pub help: String,
}

fn fault(path: &Path, what: impl Into<String>, help: &str) -> PictureFault {
    PictureFault { path: path.to_owned(), what: what.into(), help: help.into() }
}

impl Picture {
    /// What a frame shows; `None` if it is not what it says.
    pub fn of(frame: &Frame) -> Option<Picture> {
        let [width, height] = frame.intrinsics.size.map(|n| n as usize);
        let is_whole = width > 0 && height > 0 && frame.pixels.len() == width.saturating_mul(height).saturating_mul(3);
        is_whole.then(|| Picture { width, height, rgb: frame.pixels.to_vec() })
    }

    /// Red, green and blue as planes, made smaller by a whole factor.
    pub fn planes(&self, shrink: usize) -> [Plane; 3] {
        [0, 1, 2].map(|c| {
            let data = self.rgb.chunks_exact(3).map(|p| f32::from(p[c])).collect();
            Plane { width: self.width, height: self.height, data }.shrunk(shrink)
        })
    }
}

impl Mask {
    /// Where a plane is at least this.
    pub fn at_least(plane: &Plane, threshold: f32) -> Mask {
        let data = plane.data.iter().map(|v| *v >= threshold).collect();
        Mask { width: plane.width, height: plane.height, data }
    }

    /// The mean place of its pixels, as regions tell it, and what encloses them: left, top, right, bottom. `None` if it has none.
    pub fn middle_and_box(&self) -> Option<([f64; 2], [f64; 4])> {
        let (mut sum, mut count) = ([0.0; 2], 0.0);
        let mut bounds = [f64::MAX, f64::MAX, f64::MIN, f64::MIN];
        for (k, _) in self.data.iter().enumerate().filter(|(_, inside)| **inside) {
            let [u, v] = [k % self.width, k / self.width].map(|n| n as f64);
            (sum, count) = ([sum[0] + u + 0.5, sum[1] + v + 0.5], count + 1.0);
            bounds = [bounds[0].min(u), bounds[1].min(v), bounds[2].max(u + 1.0), bounds[3].max(v + 1.0)];
        }
        (count > 0.0).then(|| (sum.map(|s| s / count), bounds))
    }

    /// 255 in the object, 0 elsewhere.
    pub fn plane(&self) -> Plane {
        let data = self.data.iter().map(|m| if *m { 255.0 } else { 0.0 }).collect();
        Plane { width: self.width, height: self.height, data }
    }
}

/// All pictures of a folder with their masks, in the order of their names: `NAME.jpg` (or `NAME.png`) with `NAME_mask.png`.
/// Other files are left alone.
///
/// # Errors
/// As for [`read_pictures`], and a picture without mask.
pub fn read_folder(folder: &Path) -> Result<Vec<LabeledPicture>, PictureFault> {
    let label = |(name, picture, mask): FolderPicture| Some(LabeledPicture { name, picture, mask: mask? });
    Ok(read_all(folder, true)?.into_iter().filter_map(label).collect())
}

/// A picture's name without its ending, the picture, and where the object is in it, as far as that is known.
pub type FolderPicture = (String, Picture, Option<Mask>);

/// The same of pictures of which some or all have no mask.
///
/// # Errors
/// A file that can't be read, is broken or too large, a mask without picture, a mask of another size than its picture, pictures of
/// different sizes, a folder without pictures or with more than memory should hold.
pub fn read_pictures(folder: &Path) -> Result<Vec<FolderPicture>, PictureFault> {
    read_all(folder, false)
}

fn read_all(folder: &Path, needs_masks: bool) -> Result<Vec<FolderPicture>, PictureFault> {
    let unreadable = |e: std::io::Error| fault(folder, e.to_string(), "give a folder with NAME.jpg and NAME_mask.png");
    let mut names = BTreeSet::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        names.insert(entry.map_err(unreadable)?.file_name().to_string_lossy().into_owned());
    }
    let stem = |name: &str| {
        let is_picture = !name.ends_with(MASK);
        let stem = [".jpg", ".jpeg", ".png"].iter().find_map(|e| name.strip_suffix(e)).filter(|_| is_picture);
        stem.map(str::to_owned)
    };
    let stems: BTreeSet<String> = names.iter().filter_map(|n| stem(n)).collect();
    if let Some(alone) = names.iter().find(|n| n.strip_suffix(MASK).is_some_and(|s| !stems.contains(s))) {
        return Err(fault(&folder.join(alone), "this mask has no picture", "add NAME.jpg, or remove NAME_mask.png"));
    }
    let (mut all, mut pixels): (Vec<FolderPicture>, usize) = (Vec::new(), 0);
    for (name, stem) in names.iter().filter_map(|n| stem(n).map(|s| (n, s))) {
        let (at, mask_at) = (folder.join(name), folder.join(format!("{stem}{MASK}")));
        let has_mask = names.contains(&format!("{stem}{MASK}"));
        if needs_masks && !has_mask {
            let what = "this picture has no mask";
            return Err(fault(&at, what, "add NAME_mask.png, white where the object is, or remove the picture"));
        }
        let picture = read_picture(&at)?;
        let mask = if has_mask { Some(read_mask(&mask_at)?) } else { None };
        let [width, height] = [picture.width, picture.height];
        if let Some(m) = mask.as_ref().filter(|m| (m.width, m.height) != (width, height)) {
            let what = format!("this mask is {}x{}, but its picture {width}x{height}", m.width, m.height);
            return Err(fault(&mask_at, what, "make the mask as large as its picture"));
        }
        if let Some((first, ..)) = all.first().filter(|(_, f, _)| (f.width, f.height) != (width, height)) {
            let what = format!("this picture is {width}x{height}, but {first} is another size");
            return Err(fault(&at, what, "give all pictures of a folder one size"));
        }
        pixels += width * height;
        if pixels > MOST {
            let what = format!("with this picture, the folder has more than {} million pixels", MOST / 1_000_000);
            return Err(fault(&at, what, "give fewer pictures, or smaller ones: a few dozen of 640x480 are plenty"));
        }
        all.push((stem, picture, mask));
    }
    if all.is_empty() {
        return Err(fault(folder, "there are no pictures in it", "give a folder with NAME.jpg and NAME_mask.png"));
    }
    Ok(all)
}

/// A picture from a file.
///
/// # Errors
/// If it can't be read, is broken, or too large.
pub fn read_picture(path: &Path) -> Result<Picture, PictureFault> {
    let rgb = decode(path)?.into_rgb8();
    Ok(Picture { width: rgb.width() as usize, height: rgb.height() as usize, rgb: rgb.into_raw() })
}

/// A mask from a file: the object is where it is at least half bright.
///
/// # Errors
/// As [`read_picture`].
pub fn read_mask(path: &Path) -> Result<Mask, PictureFault> {
    let grey = decode(path)?.into_luma8();
    let (width, height) = (grey.width() as usize, grey.height() as usize);
    Ok(Mask { width, height, data: grey.into_raw().into_iter().map(|v| v >= 128).collect() })
}

fn decode(path: &Path) -> Result<image::DynamicImage, PictureFault> {
    let help = "replace it by a whole JPEG or PNG file of at most 4096x4096 pixels";
    let read = ImageReader::open(path).and_then(ImageReader::with_guessed_format);
    let mut reader = read.map_err(|e| fault(path, e.to_string(), "check the name and the permissions"))?;
    let mut limits = Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(LONGEST), Some(LONGEST));
    reader.limits(limits);
    reader.decode().map_err(|e| fault(path, format!("this is no whole picture: {e}"), help))
}
