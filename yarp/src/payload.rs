//! Payloads of messages other than bottles (spec sections 11, 13, 14, 16). The bytes of each are those of a
//! bottle, so that each also has that bottle's text form.

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
