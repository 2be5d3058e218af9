//! The ZRP XML format (Zero Reference Position notation): robots and worlds. `docs/zrp.md` is its reference.
//!
//! ```text
//! text ──xml──> tokens with places ──robot──> Robot (pairs: who may touch whom)
//!                                  ──world──> Objects
//! Robot ──write──> text
//! ```

mod constraint;
mod element;
mod geometry;
mod left_out;
mod motion;
pub(crate) mod pairs;
mod robot;
mod world;
mod write;
mod xml;

use crate::error::{FileError, Loaded, Source};
use crate::{Object, Robot};
use std::path::Path;

pub(crate) use write::left_out_tag;
pub use write::{write_robot, write_world};

/// Files above this size are refused, bytes.
const MAX_BYTES: u64 = 16 << 20;

/// Reads a robot from a ZRP XML file.
///
/// # Returns
/// The robot, and warnings with their places: what the format does not know is ignored, but not silently.
///
/// # Errors
/// The first mistake in the file, with its place and a remedy. Nothing is half-loaded.
pub fn load_robot(path: impl AsRef<Path>) -> Result<Loaded<Robot>, FileError> {
    robot::read(&Source::read(path.as_ref(), MAX_BYTES)?)
}

/// Reads a robot from ZRP XML text; `name` stands for the file in messages.
///
/// # Errors
/// As [`load_robot`].
pub fn parse_robot(name: &str, text: &str) -> Result<Loaded<Robot>, FileError> {
    robot::read(&Source::new(name, text))
}

/// Reads the objects of a world file, in the order of the file. Poses are `world_from_object`.
///
/// # Errors
/// As [`load_robot`].
pub fn load_world(path: impl AsRef<Path>) -> Result<Loaded<Vec<Object>>, FileError> {
    world::read(&Source::read(path.as_ref(), MAX_BYTES)?)
}

/// Reads the objects of a world from text; `name` stands for the file in messages.
///
/// # Errors
/// As [`load_robot`].
pub fn parse_world(name: &str, text: &str) -> Result<Loaded<Vec<Object>>, FileError> {
    world::read(&Source::new(name, text))
}
