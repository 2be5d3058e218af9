//! Families of tags, and the images of their tags.

use super::super::picture::Picture;
use kornia_apriltag::family::{TagFamily, TagFamilyKind};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A family of tags, by the number of bits of a tag and the minimum Hamming distance of two tags.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum TagFamilyName {
    /// 36 bits, distance 11, 587 tags: hardly any false detections.
    #[default]
    #[serde(rename = "36h11")]
    Bits36Apart11,
    /// 25 bits, distance 9, 35 tags.
    #[serde(rename = "25h9")]
    Bits25Apart9,
    /// 16 bits, distance 5, 30 tags: large bits for small tags, but frequent false detections.
    #[serde(rename = "16h5")]
    Bits16Apart5,
}

impl TagFamilyName {
    /// All families.
    pub const ALL: [TagFamilyName; 3] =
        [TagFamilyName::Bits36Apart11, TagFamilyName::Bits25Apart9, TagFamilyName::Bits16Apart5];

    /// Name in settings.
    pub fn name(self) -> &'static str {
        match self {
            TagFamilyName::Bits36Apart11 => "36h11",
            TagFamilyName::Bits25Apart9 => "25h9",
            TagFamilyName::Bits16Apart5 => "16h5",
        }
    }

    /// Family in the detector's library.
    pub(super) fn kind(self) -> TagFamilyKind {
        match self {
            TagFamilyName::Bits36Apart11 => TagFamilyKind::Tag36H11,
            TagFamilyName::Bits25Apart9 => TagFamilyKind::Tag25H9,
            TagFamilyName::Bits16Apart5 => TagFamilyKind::Tag16H5,
        }
    }

    /// Number of tags: their ids are below this.
    pub fn count(self) -> u16 {
        match self {
            TagFamilyName::Bits36Apart11 => 587,
            TagFamilyName::Bits25Apart9 => 35,
            TagFamilyName::Bits16Apart5 => 30,
        }
    }

    /// Edge of a tag's image including its white margin, relative to the edge of its black border,
    /// which is the size of a tag.
    pub fn edge_of_picture(self) -> f64 {
        let cells = self.cells_at_border() as f64;
        (cells + 2.0) / cells
    }

    /// Width of the black border, in bits: two more than the code's.
    pub(super) fn cells_at_border(self) -> usize {
        match self {
            TagFamilyName::Bits36Apart11 => 8,
            TagFamilyName::Bits25Apart9 => 7,
            TagFamilyName::Bits16Apart5 => 6,
        }
    }

    /// Draws a tag with a white margin of one bit around it; `None` if the family has no such tag,
    /// or the image would be empty or larger than 4096 pixels.
    ///
    /// # Arguments
    /// * `pixels`: edge of one bit, pixels.
    pub fn picture(self, id: u16, pixels: usize) -> Option<Picture> {
        let family: TagFamily = self.kind().into();
        let code = *family.code_data.get(usize::from(id))?;
        let border = self.cells_at_border();
        let side = border + 2;
        if pixels == 0 || side.checked_mul(pixels)? > 4096 {
            return None;
        }
        let mut is_white = vec![true; side * side];
        for (y, x) in (1..=border).flat_map(|y| (1..=border).map(move |x| (y, x))) {
            *is_white.get_mut(y * side + x)? = false;
        }
        for (k, (x, y)) in family.bit_x.iter().zip(&family.bit_y).enumerate() {
            let x = usize::try_from(*x).ok()? + 1;
            let y = usize::try_from(*y).ok()? + 1;
            let shift = family.nbits.checked_sub(k + 1)?;
            *is_white.get_mut(y * side + x)? = code >> shift & 1 == 1;
        }
        let edge = side * pixels;
        let at = |k: usize| is_white.get(k / edge / pixels * side + k % edge / pixels);
        let value = |k: usize| if at(k) == Some(&true) { 255u8 } else { 0 };
        Some(Picture { width: edge, height: edge, rgb: (0..edge * edge).flat_map(|k| [value(k); 3]).collect() })
    }
}
