//! URDF to a robot, in zero reference position notation.
//!
//! ZRP has no fixed rotations and needs none: with every joint at zero, each axis, frame and shape of the URDF is expressed in
//! the root frame, and what remains are translations and rotations about those axes.
//!
//! ```text
//! text ──scan──> places, hostile XML refused ──urdf-rs──> links, joints ──tree──> bodies at zero ──build──> Robot
//!                                              mesh files ──mesh──> points ──fit──> box, capsule or sphere
//! ```
//!
//! * One part; one motor per moving joint. Its encoder counts degrees of a joint that turns and millimeters of one that slides. A
//!   `mimic` joint moves with the motor of its source, in whose units that motor counts. A continuous joint has no end.
//! * Links joined by fixed joints become one body. Every link's frame becomes a marker with its normal along z, and every link with
//!   shapes a node of its name.
//! * Links that a joint joins are not tested against each other, all others are (see `neighbors`).

mod build;
mod fit;
mod mesh;
mod neighbors;
mod scan;
mod tree;

use crate::error::{FileError, Loaded, Source};
use crate::{Robot, Scene, ShapeId};
use nalgebra::Isometry3;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Files above this size are refused, bytes.
const MAX_BYTES: u64 = 16 << 20;
/// More warnings are dropped: nobody reads them.
const MAX_WARNINGS: usize = 100;

/// What to do with the parts of a URDF that ZRP has no word for.
#[derive(Clone, Debug, Default)]
pub struct UrdfOptions {
    /// Name of the body part that all motors go to; the robot's name if absent.
    pub part: Option<String>,
    /// Folders in which meshes are looked for (`package://NAME/FILE` as `FOLDER/NAME/FILE` and `FOLDER/FILE`).
    pub mesh_folders: Vec<PathBuf>,
    /// Leave out meshes, with a warning, rather than refuse those that cannot be read.
    pub drop_meshes: bool,
    /// Hold planar joints at zero, with a warning, rather than refuse them. Floating ones stand still anyhow.
    pub fix_unsupported: bool,
}

/// Reads a robot from a URDF file.
///
/// Meshes are also looked for in the five folders above the file: a package's URDF usually lies some folders below its name.
///
/// # Errors
/// The first mistake in the file, or the first thing that cannot be converted, with its place and a remedy.
pub fn load_urdf(path: impl AsRef<Path>, options: &UrdfOptions) -> Result<Loaded<Robot>, FileError> {
    let path = path.as_ref();
    let mut options = options.clone();
    options.mesh_folders.extend(path.ancestors().skip(1).take(5).map(Path::to_path_buf));
    read(&Source::read(path, MAX_BYTES)?, &options)
}

/// Reads a robot from URDF text; `name` stands for the file in messages.
///
/// # Errors
/// As [`load_urdf`].
pub fn parse_urdf(name: &str, text: &str, options: &UrdfOptions) -> Result<Loaded<Robot>, FileError> {
    read(&Source::new(name, text), options)
}

/// From text to robot; each step refuses what the next could not bear.
fn read(source: &Source, options: &UrdfOptions) -> Result<Loaded<Robot>, FileError> {
    // Before `urdf-rs`, which knows no places and no bounds.
    let places = scan::scan(source)?;
    let urdf = urdf_rs::read_from_string(source.text()).map_err(|e| {
        let help = "compare the element with the description of URDF: a joint needs name, type, parent and child";
        source.error(places.robot.clone(), format!("this is not a valid URDF: {e}"), help)
    })?;
    let mut warnings = Vec::new();
    let tree = tree::Tree::new(source, &places, &urdf, options, &mut warnings)?;
    let (robot, link_of_node) = build::build(source, &places, &urdf, &tree, options, &mut warnings)?;
    warn_of_contacts(source, &places, &robot, &link_of_node, &mut warnings);
    warnings.truncate(MAX_WARNINGS);
    Ok(Loaded { value: robot, warnings })
}

/// Neighbors beyond the next often overlap in a URDF: such pairs would keep the reflex busy for ever. Nobody but its owner
/// knows whether the shapes are too large or the pair does not matter, so it is told and not mended.
fn warn_of_contacts(
    source: &Source,
    places: &scan::Places,
    robot: &Robot,
    link_of_node: &[String],
    out: &mut Vec<FileError>,
) {
    let Ok(scene) = Scene::new(vec![(Arc::new(robot.clone()), Isometry3::identity())], Vec::new()) else { return };
    let link = |id: ShapeId| match id {
        ShapeId::Robot { node, .. } => link_of_node.get(usize::from(node)).map_or("?", String::as_str),
        ShapeId::Object { .. } => "?",
    };
    let found = scene.contacts(&scene.home(), 0.0);
    let pairs: BTreeSet<_> = found.iter().map(|c| (link(c.pair.0), link(c.pair.1))).collect();
    for (a, b) in pairs {
        let message = format!("links `{a}` and `{b}` touch each other at home");
        let help = format!(
            "shrink one of the shapes, or add <leaveOut a=\"{a}\" b=\"{b}\" reason=\"...\"/> to <pairs> in the converted file"
        );
        out.push(source.warning(places.of("link", a), message, help));
    }
}
