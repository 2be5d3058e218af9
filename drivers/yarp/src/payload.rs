//! What messages carry besides bottles (spec sections 11, 13, 14, 16). The bytes of every one are those of some bottle,
//! so that each also has a text form: that of its bottle.

pub mod image;
pub mod joints;
pub mod pair;
mod stamp;
pub mod vector;

pub use image::{Image, PixelCode};
pub use joints::{JointData, JointField};
pub use stamp::Stamp;

use crate::DecodeError;

#[cfg(test)]
mod tests;

fn shape(what: &'static str, why: impl Into<String>) -> DecodeError {
    DecodeError::Shape { what, why: why.into() }
}
