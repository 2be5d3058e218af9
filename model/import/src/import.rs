//! Import of a robot from a URDF, ready to run: shapes around its meshes, disabled pairs, a collision-free home.
//!
//! ```text
//! URDF ──> shapes ──> shapes with false contacts at random poses fitted closer ──> disabled pairs ──┬──> home ──> robot file
//! SRDF ──────────────────────────────────────────────────────── pairs, named poses ────────────────┘
//! ```

mod inputs;
mod notes;

use crate::survey::OWN_CLEARANCES_M;
use crate::urdf::load_link_rotations;
use crate::{
    FitOptions, LinkSurface, LinkTree, RefitLimits, Srdf, Surfaces, UrdfOptions, UrdfRobot, compare,
    find_disabled_pairs, find_home, fit_closer, load_link_tree, load_srdf, load_surfaces, load_urdf_with_surfaces,
};
use mobee_model::{LeftOut, NearPair, Robot, RobotParts, Scene, SceneError, ShapeId, parse_robot, write_robot};
use mobee_text::{FileError, Loaded};
use nalgebra::{Isometry3, UnitQuaternion};
use notes::{at_limits, coarse, motor_offsets, near_note, passive, refit_note, verdict};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Desired clearances of the home configuration, m, tried in this order: twice the margin of the reflex; for robots
/// with parts built closer together, the minimum with which the robot starts.
const HOME_CLEARANCES_M: [f64; 2] = [0.020, 0.013];
/// Pairs nearer than this at a pose of rest get a clearance of their own, m: the reflex and planners would not accept
/// the pose.
const REST_CLEARANCE_M: f64 = 0.012;
/// Maximum number of motors between such a pair, as between two fingers. Of an arm a pose may be near something by
/// chance, and the reflex needs the whole margin to stop it.
const MAX_NEAR_MOTORS: usize = 2;
/// Distance by which such a pose must exceed the pair's own clearance, m.
const REST_ROOM_M: f64 = 0.001;
/// Minimum clearance of home beyond the margin, mm: plans maintain 2 mm more than the margin.
const BEYOND_MARGIN_MM: f64 = 2.5;
/// Limits of fitting shapes closer: it ends if the share of poses with false contacts is at most `falsely`, or a link
/// has `shapes` shapes. If the share then exceeds `hulls`, shapes get hulls.
const REFIT_LIMITS: RefitLimits = RefitLimits { falsely: 0.003, shapes: 80, hulls: 0.02 };
/// Number of random configurations at which false contacts of shapes are searched.
const REFIT_POSES: usize = 6000;
/// Number of random configurations at which the finished shapes are compared with the meshes.
const VERDICT_POSES: usize = 2000;
/// Seed of the verdict's configurations; differs from the seed with which the shapes were fitted.
const VERDICT_SEED: u64 = IMPORT_SEED + 1;

/// Options of an import.
#[derive(Clone, Debug)]
pub struct ImportOptions {
    /// Options of the reader, and the accuracy of the shapes that are fitted to meshes. `held` is taken from the SRDF.
    pub read: UrdfOptions,
    /// The SRDF of the robot: disabled pairs of links, named poses (home among them), groups.
    pub srdf: Option<PathBuf>,
    /// Number of random configurations used to find pairs of links that need no collision test; 0: no search.
    pub poses: usize,
    /// The options as the caller writes them: a robot file that was created with other options is created again.
    pub identity: String,
}

impl Default for ImportOptions {
    fn default() -> Self {
        Self { read: UrdfOptions::default(), srdf: None, poses: 10_000, identity: String::new() }
    }
}

/// Reason why an import failed.
#[derive(Debug, thiserror::Error)]
#[cfg_attr(feature = "miette", derive(miette::Diagnostic))]
#[non_exhaustive]
pub enum ImportError {
    /// A file can't be read or converted.
    #[error(transparent)]
    #[cfg_attr(feature = "miette", diagnostic(transparent))]
    File(#[from] FileError),
    /// A file can't be read to compare it with the inputs of a robot file.
    #[error("can't read {}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The links' surfaces don't fit the robot.
    #[error("{}: {why}", path.display())]
    Surfaces {
        /// The URDF.
        path: PathBuf,
        /// Reason, as a sentence.
        why: String,
    },
    /// The robot can't be placed in a scene.
    #[error(transparent)]
    Scene(#[from] SceneError),
}

/// Result of an import.
pub struct Imported {
    /// The robot.
    pub robot: Robot,
    /// The groups of the SRDF, each with its motors.
    pub groups: BTreeMap<String, Vec<usize>>,
    /// The named poses of the SRDF: name and position, degrees or millimeters, of each motor that the pose defines.
    pub poses: BTreeMap<String, Vec<(String, f64)>>,
    /// Warnings about the files.
    pub warnings: Vec<FileError>,
    /// The margin of the reflex with which the robot can start, whole millimeters, if the clearance of home is too
    /// small for the default margin.
    pub margin_mm: Option<f64>,
    /// Decisions of the import, one line each.
    pub decided: Vec<String>,
    /// Digest of all inputs.
    pub inputs: String,
}

impl ImportOptions {
    /// Reads the URDF and converts it to a robot that can run.
    ///
    /// # Arguments
    /// * `progress`: called with a description of the current step, and the completed fraction of it.
    ///
    /// # Errors
    /// If a file can't be read or converted, with location and remedy.
    pub fn import(&self, urdf: &Path, progress: &mut dyn FnMut(&'static str, f64)) -> Result<Imported, ImportError> {
        let FitOptions { overshoot, .. } = self.read.fit;
        let Loaded { value: srdf, warnings: srdf_warnings } = self.srdf(urdf)?;
        let held = srdf.as_ref().map(|(srdf, tree)| srdf.held(tree)).unwrap_or_default();
        let options = UrdfOptions { held, ..self.read.clone() };
        progress("fits shapes to meshes", 0.0);
        let loaded = load_urdf_with_surfaces(urdf, &options)?;
        let (UrdfRobot { mut robot, surfaces: links, mut fits, notes: mut decided }, mut warnings) =
            (loaded.value, loaded.warnings);
        warnings.extend(srdf_warnings);
        decided.extend(srdf.iter().flat_map(|(srdf, _)| srdf.notes.iter().cloned()));
        decided.extend(passive(&options.held));
        if let Some((srdf, _)) = &srdf {
            robot.leave_out(disabled(srdf, &robot));
        }
        let surfaces =
            Surfaces::new(&robot, &links).map_err(|why| ImportError::Surfaces { path: urdf.to_owned(), why })?;
        if self.poses > 0 {
            let all = (links.as_slice(), &mut fits);
            let mut show = |share| progress("fits shapes closer that touch falsely", share);
            let nearer = fit_closer(&mut robot, all, &surfaces, &REFIT_LIMITS, (REFIT_POSES, IMPORT_SEED), &mut show)?;
            decided.extend(nearer.iter().map(refit_note));
            decided.extend(coarse(&fits, overshoot));
            let mut show = |share| progress("tries pairs of links at random poses", share);
            let found = find_disabled_pairs(&robot, &surfaces, (self.poses, IMPORT_SEED), &mut show)?;
            robot.leave_out(found.left_out);
            robot.bring_near(found.near);
        }
        let named = srdf.iter().flat_map(|(srdf, _)| srdf.states.iter().map(move |state| (srdf, state.name.as_str())));
        for (srdf, name) in named {
            if let Some(q) = srdf.pose(name, &robot) {
                let by_design = near_at_rest(&robot, &format!("the SRDF's pose `{name}`"), &q)?;
                robot.bring_near(by_design);
            }
        }
        progress("looks for a home that is free", 0.0);
        let (home, margin_mm) = settle_home(&mut robot, srdf.as_ref().map(|(srdf, _)| srdf))?;
        decided.push(home);
        decided.extend(near_note(&robot));
        if self.poses > 0 {
            let mut show = |share| progress("compares shapes with meshes", share);
            let seen = compare(&robot, &surfaces, (VERDICT_POSES, VERDICT_SEED), &mut show)?;
            decided.push(verdict(&seen));
        }
        // Last, since it changes the order of the motors.
        if let Some((srdf, tree)) = srdf.as_ref().filter(|_| self.read.part.is_none()) {
            let parts = srdf.parts(tree, &robot);
            decided.extend(divide(&mut robot, &parts));
        }
        decided.extend(name_parts(&mut robot));
        let groups = srdf.iter().flat_map(|(srdf, tree)| srdf.groups.iter().map(move |g| (srdf, tree, g)));
        let groups: BTreeMap<String, Vec<usize>> =
            groups.map(|(srdf, tree, g)| (g.name.clone(), srdf.motors_of(&g.name, tree, &robot))).collect();
        let still: Vec<&str> = groups.iter().filter(|(_, m)| m.is_empty()).map(|(name, _)| name.as_str()).collect();
        if !still.is_empty() {
            decided.push(format!("groups of the SRDF without a motor: {}", still.join(", ")));
        }
        let poses = srdf.iter().flat_map(|(srdf, _)| named_poses(srdf, &robot)).collect();
        Ok(Imported { robot, groups, poses, warnings, margin_mm, decided, inputs: self.digest(urdf, &links)? })
    }

    /// Contents and warnings of the SRDF, if one is given.
    fn srdf(&self, urdf: &Path) -> Result<Loaded<Option<(Srdf, LinkTree)>>, FileError> {
        let Some(path) = &self.srdf else { return Ok(Loaded { value: None, warnings: Vec::new() }) };
        let tree = load_link_tree(urdf)?;
        let srdf = load_srdf(path, &tree)?;
        Ok(Loaded { value: Some((srdf.value, tree)), warnings: srdf.warnings })
    }

    /// The orientation of every link with all joints at zero, `root_from_link`. A robot file does not contain it: there
    /// all nodes are parallel to the root at zero, with their origins at those of the links.
    ///
    /// # Errors
    /// As [`ImportOptions::import`].
    pub fn link_rotations(&self, urdf: &Path) -> Result<BTreeMap<String, UnitQuaternion<f64>>, ImportError> {
        let held = self.srdf(urdf)?.value.map(|(srdf, tree)| srdf.held(&tree)).unwrap_or_default();
        Ok(load_link_rotations(urdf, &UrdfOptions { held, ..self.read.clone() })?)
    }

    /// True if a robot file was created from this URDF, its meshes, the SRDF and these options, so that nothing has to
    /// be fitted.
    ///
    /// # Errors
    /// If one of them can't be read.
    pub fn made(&self, xml: &Path, urdf: &Path) -> Result<bool, ImportError> {
        let Some(named) = inputs::named(xml) else { return Ok(false) };
        Ok(named == self.inputs(urdf)?)
    }

    /// Digest of all inputs of a robot: the URDF, its meshes, the SRDF, the options and the version of the import; 32
    /// hexadecimal digits. Fast compared with [`ImportOptions::import`].
    ///
    /// # Errors
    /// If one of them can't be read.
    pub fn inputs(&self, urdf: &Path) -> Result<String, ImportError> {
        self.digest(urdf, &load_surfaces(urdf, &self.read)?.value)
    }

    fn digest(&self, urdf: &Path, links: &[LinkSurface]) -> Result<String, ImportError> {
        inputs::digest(&self.identity, urdf, self.srdf.as_deref(), links)
    }
}

impl Imported {
    /// The text of the robot file, with the import's decisions as a comment.
    ///
    /// # Arguments
    /// * `urdf`: named in the comment.
    /// * `xml`: the file name for errors.
    ///
    /// # Errors
    /// If the text can't be parsed again.
    pub fn file_text(&self, urdf: &Path, xml: &Path) -> Result<String, FileError> {
        let text = write_robot(&self.robot);
        let from = urdf.file_name().unwrap_or_default().to_string_lossy();
        let mut note = format!("Converted from {from} by `mobee model convert`.\n");
        self.decided.iter().for_each(|line| note = format!("{note}  {line}\n"));
        note = format!("{note}  {}\n", inputs::line(&self.inputs));
        // Two hyphens would end the comment.
        let note = format!("<!--\n  {}-->\n", note.replace("--", "- -"));
        let text = match text.split_once("?>\n") {
            Some((declaration, rest)) => format!("{declaration}?>\n{note}{rest}"),
            None => note + &text,
        };
        parse_robot(&xml.display().to_string(), &text)?;
        Ok(text)
    }
}

/// Moves the robot's home to a collision-free configuration; returns a note about it, and the margin that it needs if
/// not the default.
fn settle_home(robot: &mut Robot, srdf: Option<&Srdf>) -> Result<(String, Option<f64>), SceneError> {
    let named = srdf.and_then(|s| Some((s.home()?, s.pose(s.home()?, robot)?)));
    let (name, wanted) = match named {
        Some((name, q)) => {
            let beyond = srdf.map(|s| s.beyond(name, robot)).unwrap_or_default();
            (format!("the SRDF's pose `{name}`{}", at_limits(robot, &beyond)), q)
        }
        None => ("the zero pose".to_owned(), robot.home()),
    };
    let mut note = String::new();
    let mut margin = None;
    for clearance in HOME_CLEARANCES_M {
        let home = find_home(robot, &wanted, clearance, IMPORT_SEED)?;
        let free = home.clearance * 1e3;
        note = match (home.moved.as_slice(), home.clearance >= clearance) {
            ([], true) => format!("home: {name}, free by {free:.0} mm"),
            (moved, true) => {
                let moved = motor_offsets(robot, moved);
                format!(
                    "home: {name} is not free by {free:.0} mm; the nearest found that is, with few motors moved: {moved}"
                )
            }
            _ => format!("home: no pose near {name} was found that is free by more than {free:.0} mm"),
        };
        margin = (home.clearance < clearance).then(|| (free - BEYOND_MARGIN_MM).floor()).filter(|mm| *mm >= 1.0);
        robot.motors.iter_mut().zip(&home.q).for_each(|(motor, q)| motor.home = *q);
        if home.clearance >= clearance {
            break;
        }
    }
    // If no pose is free by more, pairs that are near there by design do not lower the margin of all others.
    if margin.is_some() {
        let by_design = near_at_rest(robot, "home", &robot.home())?;
        robot.bring_near(by_design);
        let scene = Scene::new(vec![(Arc::new(robot.clone()), Isometry3::identity())], Vec::new())?;
        let [.., least] = HOME_CLEARANCES_M;
        margin = margin.filter(|_| scene.clearance(&[robot.home()], least).is_some());
    }
    if let Some(mm) = margin {
        note += &format!(", so the margin of the reflex must be {mm:.0} mm or less");
    }
    Ok((note, margin))
}

/// The pairs of few joints, such as fingers, that are nearer at a pose of rest than a robot's usual clearance: each with the greatest clearance of its
/// own with which the pose is free, or 0 if they touch there.
fn near_at_rest(robot: &Robot, pose: &str, q: &[f64]) -> Result<Vec<NearPair>, SceneError> {
    let scene = Scene::new(vec![(Arc::new(robot.clone()), Isometry3::identity())], Vec::new())?;
    let mut nearest = BTreeMap::<(usize, usize), f64>::new();
    for contact in scene.contacts(&[q], REST_CLEARANCE_M) {
        let node = |id: ShapeId| match id {
            ShapeId::Robot { node, .. } => Some(usize::from(node)),
            ShapeId::Object { .. } => None,
        };
        if let (Some(a), Some(b)) = (node(contact.pair.0), node(contact.pair.1))
            && robot.movers(Some(a), Some(b)).len() <= MAX_NEAR_MOTORS
        {
            let least = nearest.entry((a.min(b), a.max(b))).or_insert(f64::INFINITY);
            *least = least.min(contact.distance);
        }
    }
    let near = |(nodes, distance): ((usize, usize), f64)| {
        let own = OWN_CLEARANCES_M.into_iter().find(|own| own + REST_ROOM_M <= distance).unwrap_or(0.0);
        NearPair { nodes, clearance: own, reason: format!("{:.1} mm apart in {pose}", distance.max(0.0) * 1e3) }
    };
    Ok(nearest.into_iter().map(near).collect())
}

/// Seed of all random configurations of an import, so that results are reproducible.
pub const IMPORT_SEED: u64 = 2012;

/// The disabled pairs of the SRDF for which both links have shapes.
fn disabled(srdf: &Srdf, robot: &Robot) -> Vec<LeftOut> {
    let disabled_pair = |((a, b), reason): (&(String, String), &String)| {
        let nodes = (robot.node_named(a)?, robot.node_named(b)?);
        Some(LeftOut { nodes, reason: format!("SRDF: {reason}").trim_end_matches([':', ' ']).to_owned() })
    };
    srdf.disabled.iter().filter_map(disabled_pair).collect()
}

/// The SRDF's named poses, in degrees or millimeters.
fn named_poses(srdf: &Srdf, robot: &Robot) -> BTreeMap<String, Vec<(String, f64)>> {
    let of = |name: &str| {
        let stated = srdf.stated(name, robot).into_iter();
        stated.filter_map(|(m, q)| Some((robot.motors.get(m)?.name.clone(), q.to_degrees()))).collect::<Vec<_>>()
    };
    let all = srdf.states.iter().map(|s| (s.name.clone(), of(&s.name)));
    all.filter(|(_, motors)| !motors.is_empty()).collect()
}

/// Divides the motors among parts; returns a note, unless there is one part as without an SRDF.
fn divide(robot: &mut Robot, parts: &RobotParts) -> Option<String> {
    robot.divide(&parts.parts);
    let [first, ..] = parts.parts.as_slice() else { return None };
    if parts.parts.len() == 1 && first.0 == robot.name {
        return None;
    }
    let named: Vec<String> = parts.parts.iter().map(|(name, motors)| format!("{name} ({})", motors.len())).collect();
    let mut note = format!("parts, by the SRDF's groups: {}", named.join(", "));
    if !parts.passed_over.is_empty() {
        note += &format!("; not {}, which overlap with these", parts.passed_over.join(", "));
    }
    Some(note)
}

/// Converts a name to one that is valid for ports and behaviors: letters, digits, `-` and `_`; other characters become
/// `_`.
pub fn plain_name(name: &str) -> String {
    let sound = |c: char| if c.is_ascii_alphanumeric() || "-_".contains(c) { c } else { '_' };
    name.chars().map(sound).collect()
}

/// Renames parts so that ports can have their names and no motor has; returns a note for each renamed part.
fn name_parts(robot: &mut Robot) -> Vec<String> {
    let motors: BTreeSet<&str> = robot.motors.iter().map(|m| m.name.as_str()).collect();
    let mut taken: BTreeSet<String> = robot.parts.iter().map(|p| p.name.clone()).collect();
    let mut notes = Vec::new();
    for part in &mut robot.parts {
        let plain = plain_name(&part.name);
        let is_motor = motors.contains(plain.as_str());
        if plain == part.name && !is_motor {
            continue;
        }
        let base = if is_motor { format!("{plain}_part") } else { plain.clone() };
        let numbered = (2..).map(|i| format!("{base}_{i}"));
        let mut names = std::iter::once(base.clone()).chain(numbered);
        let name = names.find(|n| !motors.contains(n.as_str()) && taken.insert(n.clone())).unwrap_or_default();
        let why = if is_motor { "as a motor has that name" } else { "as its ports could not have that name" };
        notes.push(format!("part {:?} is called `{name}`, {why}", part.name));
        part.name = name;
    }
    notes
}

/// Package folders of ROS 1 and ROS 2, from the variables of their set-up scripts (`ROS_PACKAGE_PATH`, `AMENT_PREFIX_PATH`).
pub fn ros_package_folders() -> Vec<PathBuf> {
    let folders =
        |name: &str| std::env::var_os(name).map(|v| std::env::split_paths(&v).collect::<Vec<_>>()).unwrap_or_default();
    let shares = folders("AMENT_PREFIX_PATH").into_iter().map(|prefix| prefix.join("share"));
    folders("ROS_PACKAGE_PATH").into_iter().chain(shares).collect()
}
