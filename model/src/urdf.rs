//! URDF to a robot, in zero reference position notation.
//!
//! ZRP has no fixed rotations and needs none: with every joint at zero, each axis, frame and shape of the URDF is expressed in
//! the root frame, and what remains are translations and rotations about those axes.
//!
//! ```text
//! text ──document──> links, joints, each with its place ──tree──> bodies at zero ──build──> Robot
//!                                mesh files ──mesh──> triangles ──fit──> primitives around them
//! ```
//!
//! * One part; one motor per moving joint. Its encoder counts degrees of a joint that turns and millimeters of one that slides. A
//!   `mimic` joint moves with the motor of its source, in whose units that motor counts. A continuous joint has no end.
//! * Links joined by fixed joints become one body. Every link's frame becomes a marker with its normal along z, and every link with
//!   shapes a node of its name.
//! * Soft limits narrow a motor's range, and velocity limits bound its speed; so do those of the joints that follow it.
//! * What is not used of the file is named (`words`), and what is no robot's size, limit or place is doubted (`sizes`, `limits`).
//! * Links that a joint joins are not tested against each other, all others are (see `neighbors`).

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

use crate::error::{FileError, Loaded, Source};
use crate::{Fit, FitOptions, JointMotion, LinkSurface, Robot};
use build::Built;
use document::{Document, Link};
pub use mesh::load_mesh;
use nalgebra::UnitQuaternion;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Files above this size are refused, bytes.
pub(crate) const MAX_BYTES: u64 = 16 << 20;
/// More warnings are dropped: nobody reads them.
const MAX_WARNINGS: usize = 100;

/// What to do with the parts of a URDF that ZRP has no word for.
#[derive(Clone, Debug, Default)]
pub struct UrdfOptions {
    /// Name of the body part that all motors go to; the robot's name if absent.
    pub part: Option<String>,
    /// The folders of packages by name: `package://NAME/FILE` is FILE in that of NAME.
    pub packages: BTreeMap<String, PathBuf>,
    /// Folders in which meshes are looked for (`package://NAME/FILE` as `FOLDER/NAME/FILE` and `FOLDER/FILE`).
    pub mesh_folders: Vec<PathBuf>,
    /// Leave out meshes, with a warning, rather than refuse those that cannot be read.
    pub drop_meshes: bool,
    /// Whether the `up_axis` of COLLADA meshes counts.
    pub up_axis: UpAxis,
    /// Hold planar joints at zero, with a warning, rather than refuse them. Floating ones stand still anyhow.
    pub fix_unsupported: bool,
    /// Fit shapes to what links show that have no shape that collides.
    pub visual: bool,
    /// Joints that stand still, as nothing drives them, and where, rad or meters; within their limits.
    pub held: BTreeMap<String, f64>,
    /// How near to the meshes the shapes must be that are fitted to them, and how many a link may have.
    pub fit: FitOptions,
}

/// Whether COLLADA meshes that declare y as up are turned so that it becomes z.
///
/// The tools that most URDF files were drawn with pass over what a mesh declares; a few files were drawn with tools that do not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum UpAxis {
    /// If the links' centers of mass lie much nearer to their meshes then.
    #[default]
    Guess,
    /// No.
    Ignore,
    /// Yes.
    Respect,
}

/// What a joint of a URDF does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum JointUse {
    /// Nothing.
    Still,
    /// Follows another one.
    Follows,
    /// Has a motor.
    Moves {
        /// Turns or slides.
        motion: JointMotion,
        /// Lower limit, rad or meters.
        min: f64,
        /// Upper limit, rad or meters.
        max: f64,
    },
}

/// A robot made from a URDF, and the surfaces that its shapes were fitted to.
#[derive(Clone, Debug)]
pub struct UrdfRobot {
    /// The robot.
    pub robot: Robot,
    /// Meshes and shapes as the file gives them, of each link that has any.
    pub surfaces: Vec<LinkSurface>,
    /// What was fitted to the meshes of each link that has any.
    pub fits: BTreeMap<String, Fit>,
    /// What is not used of the file, and what is used in place of something else, a line each.
    pub notes: Vec<String>,
}

/// Reads a robot from a URDF file.
///
/// Meshes are also looked for in the five folders above the file: a package's URDF usually lies some folders below its name.
///
/// # Errors
/// The first mistake in the file, or the first thing that cannot be converted, with its place and a remedy.
pub fn load_urdf(path: impl AsRef<Path>, options: &UrdfOptions) -> Result<Loaded<Robot>, FileError> {
    load_urdf_with_surfaces(path, options).map(without_surfaces)
}

/// As [`load_urdf`], with what the shapes were fitted to.
///
/// # Errors
/// As [`load_urdf`].
pub fn load_urdf_with_surfaces(path: impl AsRef<Path>, options: &UrdfOptions) -> Result<Loaded<UrdfRobot>, FileError> {
    read(&Source::read(path.as_ref(), MAX_BYTES)?, &with_folders_above(path.as_ref(), options), true)
}

/// Reads what the links of a URDF file collide with, and fits nothing to it.
///
/// # Errors
/// As [`load_urdf`].
pub fn load_surfaces(path: impl AsRef<Path>, options: &UrdfOptions) -> Result<Loaded<Vec<LinkSurface>>, FileError> {
    let loaded = read(&Source::read(path.as_ref(), MAX_BYTES)?, &with_folders_above(path.as_ref(), options), false)?;
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
    let source = Source::read(path, MAX_BYTES)?;
    let urdf = document::read(&source, options.visual)?;
    let tree = tree::Tree::new(&source, &urdf, options, &mut Vec::new())?;
    let mut rotations = BTreeMap::new();
    let mut todo = vec![(tree.root, UnitQuaternion::identity())];
    while let Some((link, turn)) = todo.pop() {
        rotations.insert(urdf.links[link].name.clone(), turn);
        for &joint in &tree.leaving[link] {
            let what = &urdf.joints[joint];
            let position = if let tree::Drive::Fixed(position) = tree.drives[joint] { position } else { 0.0 };
            let moved = build::axis(&what.axis).map(|axis| build::motion(what).by(&axis, position).rotation);
            todo.push((tree.child[joint], turn * what.origin.rotation * moved.unwrap_or_default()));
        }
    }
    Ok(rotations)
}

/// The options with the folders above the file, in which packages are looked for.
fn with_folders_above(path: &Path, options: &UrdfOptions) -> UrdfOptions {
    let mut options = options.clone();
    // A file that is named from within its package still has the package's folders above it.
    let above = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    options.mesh_folders.extend(above.ancestors().skip(1).take(5).map(Path::to_path_buf));
    options
}

/// Reads a robot from URDF text; `name` stands for the file in messages.
///
/// # Errors
/// As [`load_urdf`].
pub fn parse_urdf(name: &str, text: &str, options: &UrdfOptions) -> Result<Loaded<Robot>, FileError> {
    read(&Source::new(name, text), options, true).map(without_surfaces)
}

/// The robot alone.
fn without_surfaces(loaded: Loaded<UrdfRobot>) -> Loaded<Robot> {
    Loaded { value: loaded.value.robot, warnings: loaded.warnings }
}

/// From text to robot; each step refuses what the next could not bear.
fn read(source: &Source, options: &UrdfOptions, fits: bool) -> Result<Loaded<UrdfRobot>, FileError> {
    let mut urdf = document::read(source, options.visual)?;
    let mut warnings = std::mem::take(&mut urdf.warnings);
    let tree = tree::Tree::new(source, &urdf, options, &mut warnings)?;
    let Built { robot, surfaces, fits } = build::build(source, &urdf, &tree, options, fits, &mut warnings)?;
    let bare: Vec<&Link> = urdf.links.iter().filter(|l| l.bare).collect();
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

/// What the links and joints of a URDF are, for formats that name them.
pub(crate) struct Named {
    /// Per link: the joint that leads to it and the link that the joint leaves; none for a root.
    pub parents: BTreeMap<String, Option<(String, String)>>,
    /// The joints.
    pub joints: BTreeMap<String, JointUse>,
}

/// Reads what the links and joints of a URDF are.
pub(crate) fn read_names(source: &Source) -> Result<Named, FileError> {
    let options = UrdfOptions { fix_unsupported: true, ..UrdfOptions::default() };
    let urdf = document::read(source, false)?;
    let tree = tree::Tree::new(source, &urdf, &options, &mut Vec::new())?;
    let of = |(joint, (drive, limits)): (&document::Joint, (&tree::Drive, &Option<limits::Limits>))| {
        let used = match (drive, limits) {
            (tree::Drive::Fixed(_), _) => JointUse::Still,
            (_, Some(l)) => JointUse::Moves { motion: l.motion, min: l.min, max: l.max },
            (_, None) => JointUse::Follows,
        };
        (joint.name.clone(), used)
    };
    let joints = urdf.joints.iter().zip(tree.drives.iter().zip(&tree.limits)).map(of).collect();
    let mut parents: BTreeMap<_, _> = urdf.links.into_iter().map(|l| (l.name, None)).collect();
    parents.extend(urdf.joints.into_iter().map(|j| (j.child, Some((j.name, j.parent)))));
    Ok(Named { parents, joints })
}

/// A link that can be seen and not touched is most likely not what its owner means.
fn warning_of_bare_links(source: &Source, urdf: &Document, first: &Link, names: &str) -> FileError {
    let what = match urdf.links.iter().all(|l| l.collisions.is_empty()) {
        true => "no link has a <collision>: nothing of this robot will ever touch anything; they have a <visual>",
        false => "links with a <visual> and no <collision>, which nothing ever touches",
    };
    let help = "give each a <collision>, or have shapes fitted around their visual with --visual";
    source.warning(first.at.clone(), format!("{what}: {names}"), help)
}
