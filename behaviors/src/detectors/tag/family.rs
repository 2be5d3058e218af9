//! Families of tags, and their pictures.

use super::super::picture::Picture;
use kornia_apriltag::family::{TagFamily, TagFamilyKind};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A family of tags: how many bits each has, and by how many any two differ at least.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum TagFamilyName {
    /// 36 bits, 11 apart, 587 tags: what is hardly ever seen where it is not.
    #[default]
    #[serde(rename = "36h11")]
    Bits36Apart11,
    /// 25 bits, 9 apart, 35 tags.
    #[serde(rename = "25h9")]
    Bits25Apart9,
    /// 16 bits, 5 apart, 30 tags: large bits for small tags, and often seen where none is.
    #[serde(rename = "16h5")]
    Bits16Apart5,
}

impl TagFamilyName {
    /// All of them.
    pub const ALL: [TagFamilyName; 3] =
        [TagFamilyName::Bits36Apart11, TagFamilyName::Bits25Apart9, TagFamilyName::Bits16Apart5];

    /// As settings write it.
    pub fn name(self) -> &'static str {
        match self {
            TagFamilyName::Bits36Apart11 => "36h11",
            TagFamilyName::Bits25Apart9 => "25h9",
            TagFamilyName::Bits16Apart5 => "16h5",
        }
    }

    /// What the detector calls it.
    pub(super) fn kind(self) -> TagFamilyKind {
        match self {
            TagFamilyName::Bits36Apart11 => TagFamilyKind::Tag36H11,
            TagFamilyName::Bits25Apart9 => TagFamilyKind::Tag25H9,
            TagFamilyName::Bits16Apart5 => TagFamilyKind::Tag16H5,
        }
    }

    /// How many tags it has: their ids are below this.
    pub fn count(self) -> u16 {
        match self {
            TagFamilyName::Bits36Apart11 => 587,
            TagFamilyName::Bits25Apart9 => 35,
            TagFamilyName::Bits16Apart5 => 30,
        }
    }

    /// The edge of a tag's picture, its white margin with it, for one of the black border, which is what a tag's size means.
    pub fn edge_of_picture(self) -> f64 {
        let cells = self.cells_at_border() as f64;
        (cells + 2.0) / cells
    }

    /// The width of the black border, in bits: two more than the code's.
    pub(super) fn cells_at_border(self) -> usize {
        match self {
            TagFamilyName::Bits36Apart11 => 8,
            TagFamilyName::Bits25Apart9 => 7,
            TagFamilyName::Bits16Apart5 => 6,
        }
    }

    /// The picture of a tag, with a white margin of one bit around it; `None` if the family has no such tag, or the picture would be
    /// larger than 4096 pixels or empty.
    ///
    /// # Arguments
    /// * `pixels`: the edge of one bit.
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
            let (x, y) = (usize::try_from(*x).ok()? + 1, usize::try_from(*y).ok()? + 1);
            let shift = family.nbits.checked_sub(k + 1)?;
            *is_white.get_mut(y * side + x)? = code >> shift & 1 == 1;
        }
        let edge = side * pixels;
        let at = |k: usize| is_white.get(k / edge / pixels * side + k % edge / pixels);
        let value = |k: usize| if at(k) == Some(&true) { 255u8 } else { 0 };
        Some(Picture { width: edge, height: edge, rgb: (0..edge * edge).flat_map(|k| [value(k); 3]).collect() })
    }
}
