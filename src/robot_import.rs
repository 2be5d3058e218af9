//! A robot from a URDF, ready to run: shapes around its meshes, pairs that need no test, a home that is free.
//!
//! ```text
//! URDF ──> shapes ──> those that touch falsely at random poses fitted closer ──> pairs left out ──┬──> home ──> robot file
//! SRDF ──────────────────────────────────────────────────────── pairs, named poses ──────────────┘
//! ```

use crate::import_inputs;
use indicatif::{ProgressBar, ProgressStyle};
use miette::{Report, miette};
use mobee_model::{
    Closer, Comparison, FileError, Fit, FitOptions, LeftOut, LinkSurface, Nearer, Robot, RobotParts, Srdf, Surfaces,
    UpAxis, UrdfOptions, UrdfRobot, compare, find_home, fit_closer, load_link_tree, load_srdf, load_surfaces,
    load_urdf_with_surfaces, spared_pairs,
};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// How free the home pose should be, meters: twice the margin of the reflex. Where parts are built closer, what lets the robot start.
const HOME_CLEARANCES: [f64; 2] = [0.020, 0.013];
/// By how much home is freer than the margin, at least, millimeters: plans keep 2 mm more than the margin.
const BEYOND_MARGIN: f64 = 2.5;
/// Shapes are fitted closer until so few poses are left at which some touch falsely, with no more shapes a link than this; where that
/// leaves more of them than `hulls`, shapes get hulls.
const CLOSER: Closer = Closer { falsely: 0.003, shapes: 80, hulls: 0.02 };
/// No more motors are named that home moves.
const MOST_TOLD: usize = 8;
/// How many poses show which shapes touch falsely.
const GLANCE: usize = 6000;
/// Random configurations at which the finished shapes are compared with the meshes.
const VERDICT: usize = 2000;
/// The verdict is drawn from other configurations than those that the shapes were fitted at.
const VERDICT_SEED: u64 = SEED + 1;

/// How a URDF is read.
#[derive(clap::Args, Clone, Debug)]
pub struct UrdfArgs {
    /// Where a package is that the URDF names as `package://NAME/...` (repeatable).
    #[arg(long, value_name = "NAME=DIR", value_parser = package)]
    package: Vec<(String, PathBuf)>,
    /// Also search this folder for packages and meshes (repeatable). Those of ROS_PACKAGE_PATH and AMENT_PREFIX_PATH and the
    /// five above the URDF are always searched.
    #[arg(long, value_name = "DIR")]
    meshes: Vec<PathBuf>,
    /// Leave out meshes instead of fitting shapes around them.
    #[arg(long)]
    drop_meshes: bool,
    /// Whether COLLADA meshes that declare y as up are turned: `respect` or `ignore` that; by default, whichever brings the links'
    /// centers of mass nearer to their meshes.
    #[arg(long, value_name = "WORD", value_parser = up_axis)]
    up_axis: Option<UpAxis>,
    /// Fit shapes around the visuals of links that have no collision shapes (what they show may be more or less than what is there).
    #[arg(long)]
    visual: bool,
    /// Hold planar joints at zero instead of refusing them (a floating base stands still anyhow).
    #[arg(long)]
    fix_unsupported: bool,
}

/// How a URDF is read, and what is made of it.
#[derive(clap::Args, Clone, Debug)]
pub struct ImportArgs {
    /// The SRDF that belongs to it: pairs of links that need no test, named poses (home among them), groups.
    #[arg(long, value_name = "FILE")]
    pub srdf: Option<PathBuf>,
    #[command(flatten)]
    read: UrdfArgs,
    /// Name of the one body part that contains all motors (default: a part for each group of the SRDF, or one of the robot's name).
    #[arg(long, value_name = "NAME")]
    part: Option<String>,
    /// How far the shapes around a mesh may stick out of it, millimeters.
    #[arg(long, value_name = "MM", default_value_t = 10.0, value_parser = millimeters(0.1, 1000.0))]
    overshoot: f64,
    /// How many shapes a link may have.
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = clap::value_parser!(u16).range(1..=64))]
    shapes: u16,
    /// How many random poses are tried to find the pairs of links that need no test; 0: none.
    #[arg(long, value_name = "N", default_value_t = 10_000)]
    poses: usize,
}

/// What became of a URDF.
pub struct Imported {
    /// The robot.
    pub robot: Robot,
    /// What the SRDF says, and the motors of each of its groups.
    pub groups: BTreeMap<String, Vec<usize>>,
    /// The named poses of the SRDF: of each motor that it is about, name and position, degrees or millimeters.
    pub poses: BTreeMap<String, Vec<(String, f64)>>,
    /// What was odd in the files.
    pub warnings: Vec<FileError>,
    /// The margin of the reflex that lets the robot start, whole millimeters, if home is not free by what the default needs.
    pub margin_mm: Option<f64>,
    /// What was decided, a line each.
    pub decided: Vec<String>,
    /// The number of all that it was made from.
    pub inputs: String,
}

impl UrdfArgs {
    /// Whether any of them is given.
    pub fn is_given(&self) -> bool {
        !self.package.is_empty()
            || !self.meshes.is_empty()
            || self.drop_meshes
            || self.up_axis.is_some()
            || self.fix_unsupported
            || self.visual
    }

    /// The options of the reader.
    ///
    /// # Errors
    /// If a folder does not exist.
    pub fn options(&self) -> Result<UrdfOptions, Report> {
        if let Some(folder) = self.meshes.iter().find(|f| !f.is_dir()) {
            return Err(miette!(
                help = "give the folder that holds the meshes",
                "--meshes {}: no such folder",
                folder.display()
            ));
        }
        Ok(UrdfOptions {
            part: None,
            packages: self.package.iter().cloned().collect(),
            mesh_folders: self.meshes.iter().cloned().chain(ros_folders()).collect(),
            drop_meshes: self.drop_meshes,
            up_axis: self.up_axis.unwrap_or_default(),
            fix_unsupported: self.fix_unsupported,
            visual: self.visual,
            held: BTreeMap::new(),
            fit: FitOptions::default(),
        })
    }
}

impl ImportArgs {
    /// Reads the URDF and makes a robot of it that can run.
    ///
    /// # Errors
    /// If a file can't be read or converted, with place and remedy.
    pub fn import(&self, urdf: &Path) -> Result<Imported, Report> {
        let fit = FitOptions { overshoot: self.overshoot / 1e3, primitives: usize::from(self.shapes) };
        let mut srdf_warnings = Vec::new();
        let srdf = match &self.srdf {
            None => None,
            Some(path) => {
                let tree = load_link_tree(urdf)?;
                let srdf = load_srdf(path, &tree)?;
                srdf_warnings = srdf.warnings;
                Some((srdf.value, tree))
            }
        };
        let held = srdf.as_ref().map(|(srdf, tree)| srdf.held(tree)).unwrap_or_default();
        let options = UrdfOptions { part: self.part.clone(), fit, held, ..self.read.options()? };
        let bar = Steps::new();
        bar.step("fits shapes to meshes");
        let loaded = load_urdf_with_surfaces(urdf, &options)?;
        let (UrdfRobot { mut robot, surfaces: links, mut fits, notes: mut decided }, mut warnings) =
            (loaded.value, loaded.warnings);
        warnings.extend(srdf_warnings);
        decided.extend(srdf.iter().flat_map(|(srdf, _)| srdf.notes.iter().cloned()));
        decided.extend(passive(&options.held));
        if let Some((srdf, _)) = &srdf {
            robot.leave_out(disabled(srdf, &robot));
        }
        let surfaces = Surfaces::new(&robot, &links).map_err(|why| miette!("{}: {why}", urdf.display()))?;
        if self.poses > 0 {
            bar.step("fits shapes closer that touch falsely");
            let all = (links.as_slice(), &mut fits);
            let nearer = fit_closer(&mut robot, all, &surfaces, &CLOSER, (GLANCE, SEED), &mut |share| bar.show(share));
            decided.extend(nearer.map_err(|e| miette!("{e}"))?.iter().map(said));
            decided.extend(coarse(&fits, fit.overshoot));
            bar.step("tries pairs of links at random poses");
            let spared = spared_pairs(&robot, &surfaces, (self.poses, SEED), &mut |share| bar.show(share))
                .map_err(|e| miette!("{e}"))?;
            robot.leave_out(spared);
        }
        bar.step("looks for a home that is free");
        let (home, margin_mm) = self.settle_home(&mut robot, srdf.as_ref().map(|(srdf, _)| srdf))?;
        decided.push(home);
        if self.poses > 0 {
            bar.step("compares shapes with meshes");
            let seen = compare(&robot, &surfaces, (VERDICT, VERDICT_SEED), &mut |share| bar.show(share))
                .map_err(|e| miette!("{e}"))?;
            decided.push(verdict(&seen));
        }
        // Last, as poses have another order then.
        if let Some((srdf, tree)) = srdf.as_ref().filter(|_| self.part.is_none()) {
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

    /// Whether a robot file was made from this URDF, its meshes, the SRDF and these options: then there is nothing to fit.
    ///
    /// # Errors
    /// If one of them can't be read.
    pub fn made(&self, xml: &Path, urdf: &Path) -> Result<bool, Report> {
        let Some(named) = import_inputs::named(xml) else { return Ok(false) };
        let links = load_surfaces(urdf, &self.read.options()?)?.value;
        Ok(named == self.digest(urdf, &links)?)
    }

    /// The number of all that a robot is made from.
    fn digest(&self, urdf: &Path, links: &[LinkSurface]) -> Result<String, Report> {
        import_inputs::digest(&format!("{self:?}"), urdf, self.srdf.as_deref(), links)
    }

    /// Puts the robot's home where it is free; says where that is, and the margin that it needs if not the default.
    fn settle_home(&self, robot: &mut Robot, srdf: Option<&Srdf>) -> Result<(String, Option<f64>), Report> {
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
            let home = find_home(robot, &wanted, clearance, SEED).map_err(|e| miette!("{e}"))?;
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
}

/// One seed for all: what was found can be found again.
pub const SEED: u64 = 2012;

/// The pairs that the SRDF knows to need no test, as far as both links have shapes.
fn disabled(srdf: &Srdf, robot: &Robot) -> Vec<LeftOut> {
    let of = |((a, b), reason): (&(String, String), &String)| {
        let nodes = (robot.node_named(a)?, robot.node_named(b)?);
        Some(LeftOut { nodes, reason: format!("SRDF: {reason}").trim_end_matches([':', ' ']).to_owned() })
    };
    srdf.disabled.iter().filter_map(of).collect()
}

/// Which joints stand still as the SRDF calls them passive, if any do.
fn passive(held: &BTreeMap<String, f64>) -> Option<String> {
    let names: Vec<String> = held.iter().map(|(name, q)| format!("{name} (at {q} rad or m)")).collect();
    (!names.is_empty())
        .then(|| format!("without a motor and still, as the SRDF calls them passive: {}", names.join(", ")))
}

/// Which motors a pose has at their limits, as it would put them beyond.
fn at_limits(robot: &Robot, beyond: &[(usize, f64)]) -> String {
    let one = |(m, wanted): &(usize, f64)| {
        let motor = robot.motors.get(*m)?;
        let limit = if *wanted < motor.min { motor.min } else { motor.max };
        let [limit, wanted] = [limit, *wanted].map(f64::to_degrees);
        Some(format!("{} at its limit of {limit:.1} {}, not at {wanted:.1}", motor.name, motor.motion.unit()))
    };
    let all: Vec<String> = beyond.iter().filter_map(one).collect();
    if all.is_empty() { String::new() } else { format!(", but {}", all.join(", ")) }
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
pub(crate) fn plain_name(name: &str) -> String {
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

/// Which motors are elsewhere, and by how much in their units.
fn told(robot: &Robot, moved: &[(usize, f64)]) -> String {
    let one = |(m, by): &(usize, f64)| {
        let motor = robot.motors.get(*m)?;
        let by = by.to_degrees();
        let digits = if by.abs() < 9.5 { 1 } else { 0 };
        Some(format!("{} by {by:.digits$} {}", motor.name, motor.motion.unit()))
    };
    let mut all: Vec<String> = moved.iter().take(MOST_TOLD).filter_map(one).collect();
    if moved.len() > all.len() {
        all.push(format!("and {} more", moved.len() - all.len()));
    }
    all.join(", ")
}

/// Links whose shapes stick out farther than was asked for, if there are any.
fn coarse(fits: &BTreeMap<String, Fit>, most: f64) -> Option<String> {
    let over = fits.iter().map(|(link, fit)| (fit.overshoot(), link)).filter(|(by, _)| by * 1e3 >= most * 1e3 + 0.5);
    let mut over: Vec<(f64, &String)> = over.collect();
    over.sort_by(|a, b| b.0.total_cmp(&a.0));
    let (by, link) = over.first()?;
    let (links, by, most) = (over.len(), by * 1e3, most * 1e3);
    Some(format!(
        "shapes stick out by more than {most:.0} mm at {links} link(s), by {by:.0} mm at most ({link}); more shapes stick out \
         less: --shapes N"
    ))
}

/// How well the finished shapes stand for the meshes.
fn verdict(seen: &Comparison) -> String {
    let missed = if seen.missed == 0 { "none".to_owned() } else { format!("{} contacts", seen.missed) };
    format!(
        "shapes against meshes at {} random configurations: of the free ones {:.1} % are blocked, {missed} missed",
        seen.poses,
        100.0 * seen.blocked_share()
    )
}

/// What became of a link that was fitted closer.
fn said(Nearer { link, shapes: (before, after), hulls, overshoot }: &Nearer) -> String {
    let why = "as its shapes touched falsely";
    let shapes = if after == before { format!("{after} shapes") } else { format!("{after} shapes, not {before}") };
    let now = match hulls {
        0 => format!("within {:.0} mm", overshoot * 1e3),
        some if some == after => "all with hulls".to_owned(),
        some => format!("{some} of them with hulls"),
    };
    format!("link {link}: fitted closer, {why}: {shapes}, {now}")
}

/// What to make of a declared axis.
fn up_axis(text: &str) -> Result<UpAxis, String> {
    match text {
        "respect" => Ok(UpAxis::Respect),
        "ignore" => Ok(UpAxis::Ignore),
        _ => Err("say `respect` or `ignore`".to_owned()),
    }
}

/// `NAME=DIR`, where the folder exists.
fn package(text: &str) -> Result<(String, PathBuf), String> {
    let (name, folder) = text.split_once('=').ok_or("write NAME=DIR, such as ur_description=../ur_description")?;
    let folder = PathBuf::from(folder);
    if !folder.is_dir() {
        return Err(format!("{} is no folder", folder.display()));
    }
    Ok((name.to_owned(), folder))
}

/// Reads a length within these bounds.
pub fn millimeters(min: f64, max: f64) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync + 'static {
    move |text| {
        let number: f64 = text.parse().map_err(|_| "give a number of millimeters".to_owned())?;
        if (min..=max).contains(&number) { Ok(number) } else { Err(format!("give {min} to {max} mm")) }
    }
}

/// Where ROS 1 and ROS 2 keep packages, as their set-up scripts say.
fn ros_folders() -> Vec<PathBuf> {
    let folders =
        |name: &str| std::env::var_os(name).map(|v| std::env::split_paths(&v).collect::<Vec<_>>()).unwrap_or_default();
    let shares = folders("AMENT_PREFIX_PATH").into_iter().map(|prefix| prefix.join("share"));
    folders("ROS_PACKAGE_PATH").into_iter().chain(shares).collect()
}

/// A progress bar for one step after the other. Silent when standard error is no terminal.
pub struct Steps(ProgressBar);

impl Steps {
    /// A bar that is empty.
    pub fn new() -> Steps {
        let bar = ProgressBar::new(1000);
        let style = ProgressStyle::with_template("{bar:30}  {msg}");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        Steps(bar)
    }

    /// Begins a step.
    pub fn step(&self, what: &'static str) {
        self.0.set_message(what);
        self.0.set_position(0);
    }

    /// The share of the step that is done.
    pub fn show(&self, share: f64) {
        self.0.set_position((share * 1000.0) as u64);
    }
}

impl Default for Steps {
    fn default() -> Self {
        Self::new()
    }
}

impl Drop for Steps {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}
