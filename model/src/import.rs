//! A robot from a URDF, ready to run: shapes around its meshes, pairs that need no test, a home that is free.
//!
//! ```text
//! URDF ──> shapes ──> those that touch falsely at random poses fitted closer ──> pairs left out ──┬──> home ──> robot file
//! SRDF ──────────────────────────────────────────────────────── pairs, named poses ──────────────┘
//! ```

mod inputs;
mod words;

use crate::urdf::load_link_rotations;
use crate::{
    Closer, FileError, FitOptions, LeftOut, LinkSurface, LinkTree, Loaded, Robot, RobotParts, SceneError, Srdf,
    Surfaces, UrdfOptions, UrdfRobot, compare, find_home, fit_closer, load_link_tree, load_srdf, load_surfaces,
    load_urdf_with_surfaces, parse_robot, spared_pairs, write_robot,
};
use miette::Diagnostic;
use nalgebra::UnitQuaternion;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use words::{at_limits, coarse, passive, said, told, verdict};

/// Desired clearance of the home configuration, m: twice the margin of the reflex; for parts that are built closer, the least with which
/// the robot starts.
const HOME_CLEARANCES: [f64; 2] = [0.020, 0.013];
/// Least clearance of home beyond the margin, mm: plans maintain 2 mm more than the margin.
const BEYOND_MARGIN: f64 = 2.5;
/// Shapes are fitted closer until so few poses are left at which some touch falsely, with no more shapes a link than this; where that
/// leaves more of them than `hulls`, shapes get hulls.
const CLOSER: Closer = Closer { falsely: 0.003, shapes: 80, hulls: 0.02 };
/// Number of random configurations at which false contacts of shapes are looked for.
const GLANCE: usize = 6000;
/// Random configurations at which the finished shapes are compared with the meshes.
const VERDICT: usize = 2000;
/// The verdict is drawn from other configurations than those that the shapes were fitted at.
const VERDICT_SEED: u64 = IMPORT_SEED + 1;

/// Options of an import.
#[derive(Clone, Debug)]
pub struct ImportOptions {
    /// Options of the reader, and the accuracy of the shapes that are fitted to meshes. `held` is taken from the SRDF.
    pub read: UrdfOptions,
    /// The SRDF that belongs to it: pairs of links that need no test, named poses (home among them), groups.
    pub srdf: Option<PathBuf>,
    /// Number of random configurations at which pairs of links are found that need no test; 0: none.
    pub poses: usize,
    /// The options as the caller writes them: a robot file that was made with others is made anew.
    pub identity: String,
}

impl Default for ImportOptions {
    fn default() -> Self {
        Self { read: UrdfOptions::default(), srdf: None, poses: 10_000, identity: String::new() }
    }
}

/// Reason why an import failed.
#[derive(Debug, thiserror::Error, Diagnostic)]
#[non_exhaustive]
pub enum ImportError {
    /// A file can't be read or converted.
    #[error(transparent)]
    #[diagnostic(transparent)]
    File(#[from] FileError),
    /// A file can't be read to compare it with what a robot file was made from.
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
        /// A sentence.
        why: String,
    },
    /// The robot can't stand in a scene.
    #[error(transparent)]
    Scene(#[from] SceneError),
}

/// Result of an import.
pub struct Imported {
    /// The robot.
    pub robot: Robot,
    /// Contents of the SRDF, and the motors of each of its groups.
    pub groups: BTreeMap<String, Vec<usize>>,
    /// The named poses of the SRDF: of each motor that it is about, name and position, degrees or millimeters.
    pub poses: BTreeMap<String, Vec<(String, f64)>>,
    /// Warnings about the files.
    pub warnings: Vec<FileError>,
    /// The margin of the reflex that lets the robot start, whole millimeters, if home is not free by what the default needs.
    pub margin_mm: Option<f64>,
    /// Decisions of the import, one line each.
    pub decided: Vec<String>,
    /// The number of all that it was made from.
    pub inputs: String,
}

impl ImportOptions {
    /// Reads the URDF and makes a robot of it that can run.
    ///
    /// # Arguments
    /// * `progress`: called with the step, in words, and the share of it that is done.
    ///
    /// # Errors
    /// If a file can't be read or converted, with place and remedy.
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
            let nearer = fit_closer(&mut robot, all, &surfaces, &CLOSER, (GLANCE, IMPORT_SEED), &mut show)?;
            decided.extend(nearer.iter().map(said));
            decided.extend(coarse(&fits, overshoot));
            let mut show = |share| progress("tries pairs of links at random poses", share);
            let spared = spared_pairs(&robot, &surfaces, (self.poses, IMPORT_SEED), &mut show)?;
            robot.leave_out(spared);
        }
        progress("looks for a home that is free", 0.0);
        let (home, margin_mm) = settle_home(&mut robot, srdf.as_ref().map(|(srdf, _)| srdf))?;
        decided.push(home);
        if self.poses > 0 {
            let mut show = |share| progress("compares shapes with meshes", share);
            let seen = compare(&robot, &surfaces, (VERDICT, VERDICT_SEED), &mut show)?;
            decided.push(verdict(&seen));
        }
        // Last, as poses have another order then.
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

    /// Contents and warnings of the SRDF, if there is one.
    fn srdf(&self, urdf: &Path) -> Result<Loaded<Option<(Srdf, LinkTree)>>, FileError> {
        let Some(path) = &self.srdf else { return Ok(Loaded { value: None, warnings: Vec::new() }) };
        let tree = load_link_tree(urdf)?;
        let srdf = load_srdf(path, &tree)?;
        Ok(Loaded { value: Some((srdf.value, tree)), warnings: srdf.warnings })
    }

    /// The orientation of every link with all joints at zero, `root_from_link`. A robot file has none: its nodes are parallel to the root
    /// there, with their origins where the links' are.
    ///
    /// # Errors
    /// As [`ImportOptions::import`].
    pub fn link_rotations(&self, urdf: &Path) -> Result<BTreeMap<String, UnitQuaternion<f64>>, ImportError> {
        let held = self.srdf(urdf)?.value.map(|(srdf, tree)| srdf.held(&tree)).unwrap_or_default();
        Ok(load_link_rotations(urdf, &UrdfOptions { held, ..self.read.clone() })?)
    }

    /// True if a robot file was made from this URDF, its meshes, the SRDF and these options: nothing has to be fitted then.
    ///
    /// # Errors
    /// If one of them can't be read.
    pub fn made(&self, xml: &Path, urdf: &Path) -> Result<bool, ImportError> {
        let Some(named) = inputs::named(xml) else { return Ok(false) };
        Ok(named == self.inputs(urdf)?)
    }

    /// A number of 32 hexadecimal digits of all that a robot is made from: the URDF, its meshes, the SRDF, the options and the version of
    /// the import. Quick beside [`ImportOptions::import`].
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
    /// The robot file, with what was decided as a comment.
    ///
    /// # Arguments
    /// * `urdf`: the comment names it.
    /// * `xml`: what errors call the file.
    ///
    /// # Errors
    /// If it could not be read back.
    pub fn file_text(&self, urdf: &Path, xml: &Path) -> Result<String, FileError> {
        let text = write_robot(&self.robot);
        let from = urdf.file_name().unwrap_or_default().to_string_lossy();
        let mut note = format!("Converted from {from} by `mobee model convert`.\n");
        self.decided.iter().for_each(|line| note = format!("{note}  {line}\n"));
        note = format!("{note}  {}\n", inputs::line(&self.inputs));
        // two hyphens would end a comment
        let note = format!("<!--\n  {}-->\n", note.replace("--", "- -"));
        let text = match text.split_once("?>\n") {
            Some((declaration, rest)) => format!("{declaration}?>\n{note}{rest}"),
            None => note + &text,
        };
        parse_robot(&xml.display().to_string(), &text)?;
        Ok(text)
    }
}

/// Puts the robot's home where it is free; says where that is, and the margin that it needs if not the default.
fn settle_home(robot: &mut Robot, srdf: Option<&Srdf>) -> Result<(String, Option<f64>), SceneError> {
    let named = srdf.and_then(|s| Some((s.home()?, s.pose(s.home()?, robot)?)));
    let (name, wanted) = match named {
        Some((name, q)) => {
            let beyond = srdf.map(|s| s.beyond(name, robot)).unwrap_or_default();
            (format!("the SRDF's pose `{name}`{}", at_limits(robot, &beyond)), q)
        }
        None => ("the zero pose".to_owned(), robot.home()),
    };
    let (mut said, mut margin) = (String::new(), None);
    for clearance in HOME_CLEARANCES {
        let home = find_home(robot, &wanted, clearance, IMPORT_SEED)?;
        let free = home.clearance * 1e3;
        said = match (home.moved.as_slice(), home.clearance >= clearance) {
            ([], true) => format!("home: {name}, free by {free:.0} mm"),
            (moved, true) => {
                let moved = told(robot, moved);
                format!(
                    "home: {name} is not free by {free:.0} mm; the nearest found that is, with few motors moved: {moved}"
                )
            }
            _ => format!("home: no pose near {name} was found that is free by more than {free:.0} mm"),
        };
        margin = (home.clearance < clearance).then(|| (free - BEYOND_MARGIN).floor()).filter(|mm| *mm >= 1.0);
        robot.motors.iter_mut().zip(&home.q).for_each(|(motor, q)| motor.home = *q);
        if home.clearance >= clearance {
            break;
        }
    }
    if let Some(mm) = margin {
        said += &format!(", so the margin of the reflex must be {mm:.0} mm or less");
    }
    Ok((said, margin))
}

/// The seed of all that an import draws: what was found can be found again.
pub const IMPORT_SEED: u64 = 2012;

/// The pairs that the SRDF knows to need no test, as far as both links have shapes.
fn disabled(srdf: &Srdf, robot: &Robot) -> Vec<LeftOut> {
    let of = |((a, b), reason): (&(String, String), &String)| {
        let nodes = (robot.node_named(a)?, robot.node_named(b)?);
        Some(LeftOut { nodes, reason: format!("SRDF: {reason}").trim_end_matches([':', ' ']).to_owned() })
    };
    srdf.disabled.iter().filter_map(of).collect()
}

/// The SRDF's named poses, as people write them.
fn named_poses(srdf: &Srdf, robot: &Robot) -> BTreeMap<String, Vec<(String, f64)>> {
    let of = |name: &str| {
        let stated = srdf.stated(name, robot).into_iter();
        stated.filter_map(|(m, q)| Some((robot.motors.get(m)?.name.clone(), q.to_degrees()))).collect::<Vec<_>>()
    };
    let all = srdf.states.iter().map(|s| (s.name.clone(), of(&s.name)));
    all.filter(|(_, motors)| !motors.is_empty()).collect()
}

/// Divides the motors among parts; says how, unless there is one part as without an SRDF.
fn divide(robot: &mut Robot, parts: &RobotParts) -> Option<String> {
    robot.divide(&parts.parts);
    let [first, ..] = parts.parts.as_slice() else { return None };
    if parts.parts.len() == 1 && first.0 == robot.name {
        return None;
    }
    let named: Vec<String> = parts.parts.iter().map(|(name, motors)| format!("{name} ({})", motors.len())).collect();
    let mut said = format!("parts, by the SRDF's groups: {}", named.join(", "));
    if !parts.passed_over.is_empty() {
        said += &format!("; not {}, which overlap with these", parts.passed_over.join(", "));
    }
    Some(said)
}

/// A name that ports and behaviors can have: of letters, digits, `-` and `_`, which also stands for all others.
pub fn plain_name(name: &str) -> String {
    let sound = |c: char| if c.is_ascii_alphanumeric() || "-_".contains(c) { c } else { '_' };
    name.chars().map(sound).collect()
}

/// Gives parts names that ports can have, and that no motor has; says which have another one now.
fn name_parts(robot: &mut Robot) -> Vec<String> {
    let motors: BTreeSet<&str> = robot.motors.iter().map(|m| m.name.as_str()).collect();
    let mut taken: BTreeSet<String> = robot.parts.iter().map(|p| p.name.clone()).collect();
    let mut said = Vec::new();
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
        said.push(format!("part {:?} is called `{name}`, {why}", part.name));
        part.name = name;
    }
    said
}

/// Package folders of ROS 1 and ROS 2, from the variables of their set-up scripts (`ROS_PACKAGE_PATH`, `AMENT_PREFIX_PATH`).
pub fn ros_package_folders() -> Vec<PathBuf> {
    let folders =
        |name: &str| std::env::var_os(name).map(|v| std::env::split_paths(&v).collect::<Vec<_>>()).unwrap_or_default();
    let shares = folders("AMENT_PREFIX_PATH").into_iter().map(|prefix| prefix.join("share"));
    folders("ROS_PACKAGE_PATH").into_iter().chain(shares).collect()
}
