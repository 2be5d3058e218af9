//! URDF to a robot, in zero reference position notation.
//!
//! ZRP has no fixed rotations and needs none: with every joint at zero, each axis, frame and shape of the URDF is
//! expressed in the root frame. What remains are translations and rotations about those axes.
//!
//! ```text
//! text ──document──> links, joints, with locations ──tree──> bodies at zero ──build──> Robot
//!                                mesh files ──mesh──> triangles ──fit──> primitives around them
//! ```
//!
//! * One part; one motor per moving joint. Its encoder counts degrees of a revolute joint and millimeters of a
//!   prismatic one. A `mimic` joint moves with the motor of its source, which counts in the units of the source. A
//!   continuous joint is unlimited.
//! * Links connected by fixed joints become one body. Every link's frame becomes a marker with its normal along z, and
//!   every link with shapes a node of its name.
//! * Soft limits reduce a motor's range, and velocity limits bound its speed; so do those of the joints that follow it.
//! * Unused parts of the file are listed (`words`), and implausible sizes, limits and positions are reported (`sizes`,
//!   `limits`).
//! * Links connected by a joint are not tested against each other, all others are (see `neighbors`).

mod build;
mod contents;
mod document;
pub(crate) mod grouped;
mod limits;
mod mesh;
mod neighbors;
mod sizes;
mod tree;
mod upright;
pub(crate) mod words;

use crate::{Fit, FitOptions, LinkSurface};
use build::Built;
use document::{Document, UrdfLink};
pub use mesh::load_mesh;
use mobee_model::{JointMotion, Robot};
use mobee_text::{FileError, Loaded, SourceText};
use nalgebra::UnitQuaternion;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Maximum file size, bytes.
pub(crate) const MAX_BYTES: u64 = 16 << 20;
/// Maximum number of warnings; more would not be read.
const MAX_WARNINGS: usize = 100;

/// Options for the parts of a URDF that ZRP can't represent, and for the fit of shapes.
#[derive(Clone, Debug, Default)]
pub struct UrdfOptions {
    /// Name of the body part of all motors; the robot's name if absent.
    pub part: Option<String>,
    /// Folders of packages by name: `package://NAME/FILE` is FILE in the folder of NAME.
    pub packages: BTreeMap<String, PathBuf>,
    /// Folders in which meshes are searched (`package://NAME/FILE` as `FOLDER/NAME/FILE` and `FOLDER/FILE`).
    pub mesh_folders: Vec<PathBuf>,
    /// If true, unreadable meshes are skipped with a warning instead of rejected.
    pub drop_meshes: bool,
    /// Use of the `up_axis` of COLLADA meshes.
    pub up_axis: UpAxis,
    /// If true, planar joints are fixed at zero with a warning instead of rejected. Floating ones are always fixed.
    pub fix_unsupported: bool,
    /// If true, shapes are fitted to the visual meshes of links without collision shapes.
    pub visual: bool,
    /// Passive joints that are fixed, with their position, rad or meters; within their limits.
    pub held: BTreeMap<String, f64>,
    /// Accuracy of the shapes fitted to the meshes, and their maximum number per link.
    pub fit: FitOptions,
}

/// Rotation of COLLADA meshes that declare y as up, so that it becomes z.
///
/// The tools for which most URDF files were written ignore this declaration; a few files were written for tools that do
/// not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum UpAxis {
    /// Rotate if the links' centers of mass are much closer to their meshes then.
    #[default]
    Guess,
    /// Never rotate.
    Ignore,
    /// Always rotate.
    Respect,
}

/// Use of a joint of a URDF.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum JointUse {
    /// Does not move.
    Still,
    /// Follows another joint.
    Follows,
    /// Has a motor.
    Moves {
        /// Revolute or prismatic.
        motion: JointMotion,
        /// Lower limit, rad or meters.
        min: f64,
        /// Upper limit, rad or meters.
        max: f64,
    },
}

/// A robot converted from a URDF, and the surfaces that its shapes were fitted to.
#[derive(Clone, Debug)]
pub struct UrdfRobot {
    /// The robot.
    pub robot: Robot,
    /// Meshes and shapes from the file, for each link that has any.
    pub surfaces: Vec<LinkSurface>,
    /// Fits to the meshes, for each link that has any.
    pub fits: BTreeMap<String, Fit>,
    /// Notes about unused and substituted parts of the file, one line each.
    pub notes: Vec<String>,
}

/// Reads a robot from a URDF file.
///
/// Meshes are also searched in the five folders above the file: a package's URDF is usually some folders below the
/// package's folder.
///
/// # Errors
/// The first mistake in the file, or the first part that can't be converted, with location and remedy.
pub fn load_urdf(path: impl AsRef<Path>, options: &UrdfOptions) -> Result<Loaded<Robot>, FileError> {
    load_urdf_with_surfaces(path, options).map(without_surfaces)
}

/// As [`load_urdf`], with the surfaces that the shapes were fitted to.
///
/// # Errors
/// As [`load_urdf`].
pub fn load_urdf_with_surfaces(path: impl AsRef<Path>, options: &UrdfOptions) -> Result<Loaded<UrdfRobot>, FileError> {
    read(&SourceText::read(path.as_ref(), MAX_BYTES)?, &with_folders_above(path.as_ref(), options), true)
}

/// Reads the collision geometry of the links of a URDF file, without a fit.
///
/// # Errors
/// As [`load_urdf`].
pub fn load_surfaces(path: impl AsRef<Path>, options: &UrdfOptions) -> Result<Loaded<Vec<LinkSurface>>, FileError> {
    let loaded =
        read(&SourceText::read(path.as_ref(), MAX_BYTES)?, &with_folders_above(path.as_ref(), options), false)?;
    Ok(Loaded { value: loaded.value.surfaces, warnings: loaded.warnings })
}

/// The orientation of every link of a URDF file with all joints at zero, `root_from_link`.
///
/// # Errors
/// As [`load_urdf`].
pub(crate) fn load_link_rotations(
    path: &Path,
    options: &UrdfOptions,
) -> Result<BTreeMap<String, UnitQuaternion<f64>>, FileError> {
    let source = SourceText::read(path, MAX_BYTES)?;
    let urdf = document::read(&source, options.visual)?;
    let tree = tree::Tree::new(&source, &urdf, options, &mut Vec::new())?;
    let mut rotations = BTreeMap::new();
    let mut todo = vec![(tree.root, UnitQuaternion::identity())];
    while let Some((link, turn)) = todo.pop() {
        rotations.insert(urdf.links[link].name.clone(), turn);
        for &joint in &tree.leaving[link] {
            let what = &urdf.joints[joint];
            let position = if let tree::JointDrive::Fixed(position) = tree.drives[joint] { position } else { 0.0 };
            let moved = build::axis(&what.axis).map(|axis| build::motion(what).by(&axis, position).rotation);
            todo.push((tree.child[joint], turn * what.origin.rotation * moved.unwrap_or_default()));
        }
    }
    Ok(rotations)
}

/// The options with the folders above the file added to the search path for packages.
fn with_folders_above(path: &Path, options: &UrdfOptions) -> UrdfOptions {
    let mut options = options.clone();
    // Absolute, so that a relative path within a package has the package's folders above it, too.
    let above = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    options.mesh_folders.extend(above.ancestors().skip(1).take(5).map(Path::to_path_buf));
    options
}

/// Reads a robot from URDF text; `name` is the file name for messages.
///
/// # Errors
/// As [`load_urdf`].
pub fn parse_urdf(name: &str, text: &str, options: &UrdfOptions) -> Result<Loaded<Robot>, FileError> {
    read(&SourceText::new(name, text), options, true).map(without_surfaces)
}

/// Drops the surfaces.
fn without_surfaces(loaded: Loaded<UrdfRobot>) -> Loaded<Robot> {
    Loaded { value: loaded.value.robot, warnings: loaded.warnings }
}

/// Converts text to a robot; each step rejects input that the next could not handle.
fn read(source: &SourceText, options: &UrdfOptions, fits: bool) -> Result<Loaded<UrdfRobot>, FileError> {
    let mut urdf = document::read(source, options.visual)?;
    let mut warnings = std::mem::take(&mut urdf.warnings);
    let tree = tree::Tree::new(source, &urdf, options, &mut warnings)?;
    let Built { robot, surfaces, fits } = build::build(source, &urdf, &tree, options, fits, &mut warnings)?;
    let bare: Vec<&UrdfLink> = urdf.links.iter().filter(|l| l.bare).collect();
    let names = bare.iter().map(|l| format!("`{}`", l.name)).collect::<Vec<_>>().join(", ");
    let mut notes: Vec<String> = urdf.unused.line("URDF").into_iter().collect();
    match bare.first() {
        Some(_) if options.visual => notes.push(format!("links that have shapes around their visual: {names}")),
        Some(first) => warnings.insert(0, warning_of_bare_links(source, &urdf, first, &names)),
        None => {}
    }
    urdf.unused.warn(source, "URDF", &mut warnings);
    warnings.truncate(MAX_WARNINGS);
    Ok(Loaded { value: UrdfRobot { robot, surfaces, fits, notes }, warnings })
}

/// Links and joints of a URDF by name, for formats that refer to them.
pub(crate) struct Named {
    /// Per link: its parent joint and its parent link; `None` for a root.
    pub parents: BTreeMap<String, Option<(String, String)>>,
    /// The joints.
    pub joints: BTreeMap<String, JointUse>,
}

/// Reads the names of the links and joints of a URDF.
pub(crate) fn read_names(source: &SourceText) -> Result<Named, FileError> {
    let options = UrdfOptions { fix_unsupported: true, ..UrdfOptions::default() };
    let urdf = document::read(source, false)?;
    let tree = tree::Tree::new(source, &urdf, &options, &mut Vec::new())?;
    let joint_use = |(joint, (drive, limits)): (&document::UrdfJoint, (&tree::JointDrive, &Option<limits::Limits>))| {
        let used = match (drive, limits) {
            (tree::JointDrive::Fixed(_), _) => JointUse::Still,
            (_, Some(l)) => JointUse::Moves { motion: l.motion, min: l.min, max: l.max },
            (_, None) => JointUse::Follows,
        };
        (joint.name.clone(), used)
    };
    let joints = urdf.joints.iter().zip(tree.drives.iter().zip(&tree.limits)).map(joint_use).collect();
    let mut parents: BTreeMap<_, _> = urdf.links.into_iter().map(|l| (l.name, None)).collect();
    parents.extend(urdf.joints.into_iter().map(|j| (j.child, Some((j.name, j.parent)))));
    Ok(Named { parents, joints })
}

/// Warning about links that are visible but can't collide, which is probably unintended.
fn warning_of_bare_links(source: &SourceText, urdf: &Document, first: &UrdfLink, names: &str) -> FileError {
    let what = match urdf.links.iter().all(|l| l.collisions.is_empty()) {
        true => "no link has a <collision>: nothing of this robot will ever touch anything; they have a <visual>",
        false => "links with a <visual> and no <collision>, which nothing ever touches",
    };
    let help = "give each a <collision>, or have shapes fitted around their visual with --visual";
    source.warning(first.at.clone(), format!("{what}: {names}"), help)
}
