//! Images and masks, from frames and from folders.

use super::mask_file;
use super::plane::Plane;
use mobee_contract::Frame;
use mobee_contract::picture::{self, PictureFile};
use std::path::Path;

pub use mobee_contract::picture::PictureFault;

/// Maximum number of pixels of all images of a folder: they are in memory at the same time.
const MAX_PIXELS: usize = 200_000_000;

/// A color image.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Red, green and blue of each pixel, row by row from the top.
    pub rgb: Vec<u8>,
}

/// The pixels of an image that belong to the object.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// One value per pixel, row by row from the top.
    pub data: Vec<bool>,
}

/// An image with the mask of the object.
#[derive(Clone, Debug, PartialEq)]
pub struct LabeledPicture {
    /// Name of the file without its extension.
    pub name: String,
    /// The image.
    pub picture: Picture,
    /// Mask of the object.
    pub mask: Mask,
}

fn fault(path: &Path, what: impl Into<String>, help: &str) -> PictureFault {
    PictureFault::new(path, what, help)
}

impl Picture {
    /// Copies the image of a frame; `None` if the number of its pixels is wrong.
    pub fn of(frame: &Frame) -> Option<Picture> {
        let [width, height] = frame.intrinsics.size.map(|n| n as usize);
        let is_whole = width > 0 && height > 0 && frame.pixels.len() == width.saturating_mul(height).saturating_mul(3);
        is_whole.then(|| Picture { width, height, rgb: frame.pixels.to_vec() })
    }

    /// Returns red, green and blue as planes, shrunk by an integer factor.
    pub fn planes(&self, shrink: usize) -> [Plane; 3] {
        [0, 1, 2].map(|c| {
            let data = self.rgb.chunks_exact(3).map(|p| f32::from(p[c])).collect();
            Plane { width: self.width, height: self.height, data }.shrunk(shrink)
        })
    }
}

impl Mask {
    /// Returns the pixels at which a plane is at least `threshold`.
    pub fn at_least(plane: &Plane, threshold: f32) -> Mask {
        let data = plane.data.iter().map(|v| *v >= threshold).collect();
        Mask { width: plane.width, height: plane.height, data }
    }

    /// Returns the mean position of its pixels, in the convention of regions, and their bounding
    /// box: left, top, right, bottom. `None` if it is empty.
    pub fn middle_and_box(&self) -> Option<([f64; 2], [f64; 4])> {
        let mut sum = [0.0; 2];
        let mut count = 0.0;
        let mut bounds = [f64::MAX, f64::MAX, f64::MIN, f64::MIN];
        for (k, _) in self.data.iter().enumerate().filter(|(_, inside)| **inside) {
            let [u, v] = [k % self.width, k / self.width].map(|n| n as f64);
            sum = [sum[0] + u + 0.5, sum[1] + v + 0.5];
            count += 1.0;
            bounds = [bounds[0].min(u), bounds[1].min(v), bounds[2].max(u + 1.0), bounds[3].max(v + 1.0)];
        }
        (count > 0.0).then(|| (sum.map(|s| s / count), bounds))
    }

    /// Returns a plane with 255 in the object and 0 elsewhere.
    pub fn plane(&self) -> Plane {
        let data = self.data.iter().map(|m| if *m { 255.0 } else { 0.0 }).collect();
        Plane { width: self.width, height: self.height, data }
    }
}

/// Reads all images of a folder with their masks, ordered by name: `NAME.jpg` (or `NAME.png`) with
/// `NAME_mask.png`. Other files are ignored.
///
/// # Errors
/// As for [`read_pictures`], and an image without a mask.
pub fn read_folder(folder: &Path) -> Result<Vec<LabeledPicture>, PictureFault> {
    let label = |(name, picture, mask): FolderPicture| Some(LabeledPicture { name, picture, mask: mask? });
    Ok(read_all(folder, true)?.into_iter().filter_map(label).collect())
}

/// Name of an image without its extension, the image, and its mask if there is one.
pub type FolderPicture = (String, Picture, Option<Mask>);

/// Reads all images of a folder, of which some or all may lack a mask.
///
/// # Errors
/// A file that can't be read, is broken or too large, a mask without an image, a mask of another
/// size than its image, an ambiguous mask, images of different sizes, a folder without images or
/// with more than fit in memory.
pub fn read_pictures(folder: &Path) -> Result<Vec<FolderPicture>, PictureFault> {
    read_all(folder, false)
}

fn read_all(folder: &Path, needs_masks: bool) -> Result<Vec<FolderPicture>, PictureFault> {
    let listed = picture::list(folder)?;
    if let Some(alone) = listed.lone_masks.first() {
        return Err(fault(alone, "this mask has no picture", "add NAME.jpg, or remove NAME_mask.png"));
    }
    let mut all: Vec<FolderPicture> = Vec::new();
    let mut pixels = 0;
    for PictureFile { path, name, mask } in listed.pictures {
        if mask.is_none() && name.to_ascii_lowercase().ends_with("_mask") && !needs_masks {
            return Err(fault(&path, "this mask is no PNG file", "save masks as NAME_mask.png: JPEG blurs them"));
        }
        if needs_masks && mask.is_none() {
            let what = "this picture has no mask";
            return Err(fault(&path, what, "add NAME_mask.png, white where the object is, or remove the picture"));
        }
        let picture = read_picture(&path)?;
        let [width, height] = [picture.width, picture.height];
        let mask = match mask {
            Some(at) => Some(read_mask_of(&at, [width, height])?),
            None => None,
        };
        if let Some((first, ..)) = all.first().filter(|(_, f, _)| (f.width, f.height) != (width, height)) {
            let what = format!("this picture is {width}x{height}, but {first} is another size");
            return Err(fault(&path, what, "give all pictures of a folder one size"));
        }
        pixels += width * height;
        if pixels > MAX_PIXELS {
            let what = format!("with this picture, the folder has more than {} million pixels", MAX_PIXELS / 1_000_000);
            return Err(fault(&path, what, "give fewer pictures, or smaller ones: a few dozen of 640x480 are plenty"));
        }
        all.push((name, picture, mask));
    }
    Ok(all)
}

/// Reads the mask of an image of this size.
fn read_mask_of(path: &Path, [width, height]: [usize; 2]) -> Result<Mask, PictureFault> {
    let mask = read_mask(path)?;
    if (mask.width, mask.height) == (width, height) {
        return Ok(mask);
    }
    let what = format!("this mask is {}x{}, but its picture {width}x{height}", mask.width, mask.height);
    Err(fault(path, what, "make the mask as large as its picture is where it stands upright (EXIF)"))
}

/// Reads an image from a file.
///
/// # Errors
/// A file that can't be read, is broken, or too large.
pub fn read_picture(path: &Path) -> Result<Picture, PictureFault> {
    let rgb = picture::read(path)?;
    Ok(Picture { width: rgb.width() as usize, height: rgb.height() as usize, rgb: rgb.into_raw() })
}

/// Reads a mask from a file: white on black, one color or label on a background, or opaque on
/// transparent.
///
/// # Errors
/// As for [`read_picture`], and a mask with several labels.
pub fn read_mask(path: &Path) -> Result<Mask, PictureFault> {
    let picture = picture::open(path)?;
    let width = picture.width() as usize;
    let height = picture.height() as usize;
    let data = mask_file::object_pixels(&picture).map_err(|(what, help)| fault(path, what, help))?;
    Ok(Mask { width, height, data })
}
