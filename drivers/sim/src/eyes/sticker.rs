//! Images on the sides of boxes, or on cards at the sides of other objects, such as tags and labels.

use super::scenery::in_range;
use super::solid::V3;
use mobee_contract::{KindError, picture};
use mobee_model::{Object, Shape};
use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// An image on a side of an object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StickerSettings {
    /// Object that carries it, in the middle of a side of its first box. An object without a box has it on a
    /// card at that side.
    pub on: String,
    /// Side of the box or object, by its axes.
    #[serde(default)]
    pub side: BoxSide,
    /// Image file (JPEG or PNG).
    #[schemars(extend("format" = "path"))]
    pub picture: PathBuf,
    /// Width of the image, m.
    pub width_m: f64,
}

/// Side of a box, by its outer normal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum BoxSide {
    /// Positive x.
    #[serde(rename = "+x")]
    Right,
    /// Negative x.
    #[serde(rename = "-x")]
    Left,
    /// Positive y.
    #[serde(rename = "+y")]
    Back,
    /// Negative y.
    #[serde(rename = "-y")]
    Front,
    /// Positive z.
    #[default]
    #[serde(rename = "+z")]
    Top,
    /// Negative z.
    #[serde(rename = "-z")]
    Bottom,
}

impl BoxSide {
    /// Index in the [`Stickers`] of a box: twice its axis, plus one for the negative side.
    fn number(self) -> usize {
        match self {
            BoxSide::Right => 0,
            BoxSide::Left => 1,
            BoxSide::Back => 2,
            BoxSide::Front => 3,
            BoxSide::Top => 4,
            BoxSide::Bottom => 5,
        }
    }

    /// Frame of an image on this side, `box_from_sticker`: origin in its middle, x to the right and y down as
    /// it is read, z into the box. Up is the box's z axis, or its y axis on the sides along z.
    pub fn frame(self, size: &Vector3<f64>) -> Isometry3<f64> {
        let [axis, far] = [self.number() / 2, self.number() % 2];
        let out = Vector3::from_fn(|i, _| match (i == axis, far == 1) {
            (false, _) => 0.0,
            (true, true) => -1.0,
            (true, false) => 1.0,
        });
        let up = if axis == 2 { Vector3::y() } else { Vector3::z() };
        let axes = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[up.cross(&out), -up, -out]));
        let middle = out.component_mul(size) / 2.0;
        Isometry3::from_parts(middle.into(), UnitQuaternion::from_rotation_matrix(&axes))
    }
}

/// Sticker on each side of a box, by its index in the scenery.
pub type Stickers = [Option<u16>; 6];

/// An image with its place.
pub struct Sticker {
    on: String,
    side: BoxSide,
    /// Half of its width and height, meters.
    half: [f32; 2],
    /// Columns and rows.
    size: [u32; 2],
    /// Pixels, row by row.
    texels: Vec<[u8; 3]>,
}

impl StickerSettings {
    /// Checks every setting.
    ///
    /// # Errors
    /// Invalid settings, with the valid ranges.
    pub fn validate(&self) -> Result<(), KindError> {
        in_range(("width_m", self.width_m, 0.001, 10.0))
    }

    /// Reads the image.
    ///
    /// # Errors
    /// The image can't be read, is damaged or larger than 4096x4096 pixels.
    pub fn read(&self) -> Result<Sticker, KindError> {
        let picture = picture::read(&self.picture).map_err(|e| KindError::new("picture", e.to_string(), e.help))?;
        let (columns, rows) = picture.dimensions();
        let width = (self.width_m / 2.0) as f32;
        let half = [width, width * rows as f32 / columns.max(1) as f32];
        let texels = picture.pixels().map(|p| p.0).collect();
        Ok(Sticker { on: self.on.clone(), side: self.side, half, size: [columns, rows], texels })
    }
}

impl Sticker {
    /// Color at a position relative to its middle, meters right and down; `None` beside it.
    #[inline(always)]
    pub fn at(&self, [right, down]: [f32; 2]) -> Option<V3> {
        let share = |at: f32, half: f32, n: u32| {
            let share = (at / half + 1.0) / 2.0;
            (0.0..1.0).contains(&share).then(|| ((share * n as f32) as u32).min(n.saturating_sub(1)))
        };
        let (u, v) = (share(right, self.half[0], self.size[0])?, share(down, self.half[1], self.size[1])?);
        self.texels.get((v * self.size[0] + u) as usize).map(|c| V3::from(c.map(f32::from)))
    }
}

/// Thickness of a card, meters.
const CARD: f64 = 1e-3;

/// Cards on an object without a box: each a thin box at the side of the object, with its sticker on the outer
/// side, and with its pose in the object's frame.
pub fn cards<'a>(
    stickers: &'a [Sticker],
    object: &'a Object,
) -> impl Iterator<Item = (Shape, Isometry3<f64>, Stickers)> + 'a {
    on(stickers, &object.name).into_iter().enumerate().filter_map(move |(side, on_side)| {
        let sticker = stickers.get(usize::from(on_side?))?;
        let [right, down] = axes(side).map(|axis| axis.cast::<f64>());
        let out = down.cross(&right);
        let [width, height] = sticker.half.map(|half| 2.0 * f64::from(half));
        let size = right.abs() * width + down.abs() * height + out.abs() * CARD;
        let middle = object.middle();
        let at = middle + out * (object.extent(&out) + CARD / 2.0 - middle.dot(&out));
        let mut only = Stickers::default();
        *only.get_mut(side)? = on_side;
        Some((Shape::Box { size }, Isometry3::from_parts(at.into(), UnitQuaternion::identity()), only))
    })
}

/// Stickers of an object.
pub fn on(stickers: &[Sticker], object: &str) -> Stickers {
    let mut found = [None; 6];
    for (sticker, k) in stickers.iter().zip(0u16..).filter(|(s, _)| s.on == object) {
        if let Some(side) = found.get_mut(sticker.side.number()) {
            *side = Some(k);
        }
    }
    found
}

/// Directions to the right and down on each side of a box, in its own frame, in the order of [`Stickers`].
pub fn axes(side: usize) -> [V3; 2] {
    let up = if side / 2 == 2 { V3::y() } else { V3::z() };
    let mut out = V3::zeros();
    if let Some(along) = out.get_mut(side / 2) {
        *along = if side % 2 == 1 { -1.0 } else { 1.0 };
    }
    [up.cross(&out), -up]
}
