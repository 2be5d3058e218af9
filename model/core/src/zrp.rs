//! The ZRP XML format (Zero Reference Position notation): robots and worlds. `docs/zrp.md` is its reference.
//!
//! ```text
//! text ──xml──> located tokens ──robot──> Robot (with pairs that may touch)
//!                               ──world──> Objects
//! Robot ──write──> text
//! ```

mod constraint;
mod element;
mod geometry;
mod motion;
mod pair_list;
pub(crate) mod pairs;
mod robot;
mod world;
mod write;
mod xml;

use crate::{Object, Robot};
use mobee_text::{FileError, Loaded, SourceText};
use std::path::Path;

pub(crate) use write::left_out_tag;
pub use write::{write_robot, write_world};

/// Maximum file size, bytes.
const MAX_BYTES: u64 = 16 << 20;

/// Reads a robot from a ZRP XML file.
///
/// # Returns
/// The robot, and located warnings: unknown parts of the file are ignored with a warning.
///
/// # Errors
/// The first mistake in the file, with location and remedy. Nothing is loaded partially.
pub fn load_robot(path: impl AsRef<Path>) -> Result<Loaded<Robot>, FileError> {
    robot::read(&SourceText::read(path.as_ref(), MAX_BYTES)?)
}

/// Reads a robot from ZRP XML text; `name` is the file name for messages.
///
/// # Errors
/// As [`load_robot`].
pub fn parse_robot(name: &str, text: &str) -> Result<Loaded<Robot>, FileError> {
    robot::read(&SourceText::new(name, text))
}

/// Reads the objects of a world file, in the order of the file. Poses are `world_from_object`.
///
/// # Errors
/// As [`load_robot`].
pub fn load_world(path: impl AsRef<Path>) -> Result<Loaded<Vec<Object>>, FileError> {
    world::read(&SourceText::read(path.as_ref(), MAX_BYTES)?)
}

/// Reads the objects of a world from text; `name` is the file name for messages.
///
/// # Errors
/// As [`load_robot`].
pub fn parse_world(name: &str, text: &str) -> Result<Loaded<Vec<Object>>, FileError> {
    world::read(&SourceText::new(name, text))
}
