//! Options and progress bar for the import of a robot from a URDF on the command line (`mobee_import::ImportOptions`).

use indicatif::{ProgressBar, ProgressStyle};
use miette::{Report, miette};
use mobee_import::{FitOptions, ImportOptions, Imported, UpAxis, UrdfOptions, ros_package_folders};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Options of reading a URDF.
#[derive(clap::Args, Clone, Debug)]
pub struct UrdfArgs {
    /// Folder of a package that the URDF names as `package://NAME/...` (repeatable).
    #[arg(long, value_name = "NAME=DIR", value_parser = package)]
    package: Vec<(String, PathBuf)>,
    /// Also search this folder for packages and meshes (repeatable). Those of ROS_PACKAGE_PATH and AMENT_PREFIX_PATH and the
    /// five above the URDF are always searched.
    #[arg(long, value_name = "DIR")]
    meshes: Vec<PathBuf>,
    /// Drop meshes instead of fitting shapes around them.
    #[arg(long)]
    drop_meshes: bool,
    /// Up axis of COLLADA meshes: `respect` or `ignore` a declared y axis; default: the one that brings the links'
    /// centers of mass closer to their meshes.
    #[arg(long, value_name = "WORD", value_parser = up_axis)]
    up_axis: Option<UpAxis>,
    /// Fit shapes around the visuals of links that have no collision shapes (visuals may show more or less than the
    /// real link).
    #[arg(long)]
    visual: bool,
    /// Hold planar joints at zero instead of refusing them (a floating base is fixed in any case).
    #[arg(long)]
    fix_unsupported: bool,
}

/// Default of `--overshoot`, millimeters.
const OVERSHOOT_MM: f64 = 10.0;
/// Default of `--shapes`.
const SHAPES_PER_LINK: u16 = 12;
/// Default of `--poses`.
const SAMPLED_POSES: usize = 10_000;

/// Options of the import of a URDF.
#[derive(clap::Args, Clone, Debug)]
pub struct ImportArgs {
    /// The SRDF that belongs to it: disabled pairs of links, named poses (home among them), groups.
    #[arg(long, value_name = "FILE")]
    pub srdf: Option<PathBuf>,
    #[command(flatten)]
    read: UrdfArgs,
    /// Name of the one body part that contains all motors (default: a part for each group of the SRDF, or one of the robot's name).
    #[arg(long, value_name = "NAME")]
    part: Option<String>,
    /// Maximum distance by which the shapes around a mesh may protrude from it, millimeters.
    #[arg(long, value_name = "MM", default_value_t = OVERSHOOT_MM, value_parser = millimeters(0.1, 1000.0))]
    overshoot: f64,
    /// Maximum number of shapes per link.
    #[arg(long, value_name = "N", default_value_t = SHAPES_PER_LINK, value_parser = clap::value_parser!(u16).range(1..=64))]
    shapes: u16,
    /// Number of random poses in the search for pairs of links that need no test; 0: none.
    #[arg(long, value_name = "N", default_value_t = SAMPLED_POSES)]
    poses: usize,
}

impl UrdfArgs {
    /// True if any of them is given.
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
            mesh_folders: self.meshes.iter().cloned().chain(ros_package_folders()).collect(),
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
    /// True if any of them differs from its default.
    pub fn is_given(&self) -> bool {
        let defaults = self.overshoot == OVERSHOOT_MM && self.shapes == SHAPES_PER_LINK && self.poses == SAMPLED_POSES;
        self.srdf.is_some() || self.part.is_some() || self.read.is_given() || !defaults
    }

    /// Converts the URDF into a robot that can run, with a progress bar.
    ///
    /// # Errors
    /// If a file can't be read or converted, with place and remedy.
    pub fn import(&self, urdf: &Path) -> Result<Imported, Report> {
        let bar = Steps::new();
        Ok(self.options()?.import(urdf, &mut |step, share| bar.show_step(step, share))?)
    }

    /// True if a robot file was made from this URDF, its meshes, the SRDF and these options: then there is nothing to
    /// fit.
    ///
    /// # Errors
    /// If one of them can't be read.
    pub fn made(&self, xml: &Path, urdf: &Path) -> Result<bool, Report> {
        Ok(self.options()?.made(xml, urdf)?)
    }

    fn options(&self) -> Result<ImportOptions, Report> {
        let fit = FitOptions { overshoot: self.overshoot / 1e3, primitives: usize::from(self.shapes) };
        let read = UrdfOptions { part: self.part.clone(), fit, ..self.read.options()? };
        Ok(ImportOptions { read, srdf: self.srdf.clone(), poses: self.poses, identity: format!("{self:?}") })
    }
}

/// Parses the handling of a declared axis.
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
        return Err(format!("{} is not a folder", folder.display()));
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

/// A progress bar for consecutive steps. Silent if standard error is not a terminal.
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

    /// Shows the present step and the share of it that is done.
    pub fn show_step(&self, what: &'static str, share: f64) {
        self.0.set_message(what);
        self.show(share);
    }

    /// Shows the share of the step that is done.
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
