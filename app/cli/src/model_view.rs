//! `mobee model view`: a robot's shapes over the meshes of its URDF, one motor moving after the other, as a recording
//! for Rerun.

use crate::robot_import::{UrdfArgs, millimeters};
use crate::view::{self, recording_settings};
use miette::{IntoDiagnostic, Report, WrapErr, miette};
use mobee_import::{LinkSurface, load_surfaces};
use mobee_model::{Robot, load_robot};
use mobee_recorder::{ModelView, SeenModel, view_model};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Maximum number of printed pairs that come close; the recording has all.
const MAX_PRINTED: usize = 10;

/// Arguments of `mobee model view`.
#[derive(clap::Args, Clone, Debug)]
pub struct ViewArgs {
    /// Robot XML.
    robot: PathBuf,
    /// The URDF that it was converted from: its meshes are shown beneath the shapes.
    #[arg(long, value_name = "FILE")]
    urdf: Option<PathBuf>,
    /// Write the recording into this file, and open no viewer.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Replace the recording if it exists.
    #[arg(long, requires = "out")]
    force: bool,
    /// Show pairs in red that get closer to each other than this, millimeters; the reflex of a robot acts at
    /// `controller.margin_mm`.
    #[arg(long, value_name = "MM", default_value_t = 10.0, value_parser = millimeters(0.0, 500.0), allow_negative_numbers = true)]
    margin: f64,
    #[command(flatten)]
    read: UrdfArgs,
}

/// Writes the recording, opens it unless a file for it was named, and returns the pairs that came close.
///
/// # Errors
/// If a file can't be read or written, the two are not of one robot, or there is no viewer.
pub fn command(args: &ViewArgs) -> Result<String, Report> {
    let robot = Arc::new(load_robot(&args.robot)?.value);
    let meshes = meshes(args, &robot)?;
    let out = match &args.out {
        Some(out) if out.exists() && !args.force => {
            let help = "name another file, or replace it with --force";
            return Err(miette!(help = help, "{} exists already", out.display()));
        }
        Some(out) => out.clone(),
        None => passing_file(&args.robot)?,
    };
    let settings = recording_settings(&out, &robot.name, &args.robot);
    let view = ModelView { robot: &robot, meshes: &meshes, margin: args.margin * 1e-3 };
    let seen = view_model(&settings, &view).map_err(|why| miette!("{}: {why}", args.robot.display()))?;
    let text = summary(&out, &robot, &seen, args.margin);
    Ok(match args.out {
        Some(_) => format!("{text}now: mobee view {}\n", crate::terminal::shell_word(&out)),
        None => format!("{text}{}\n", view::open(&out)?),
    })
}

/// The collision meshes of the URDF's links, if one was given.
fn meshes(args: &ViewArgs, robot: &Robot) -> Result<Vec<LinkSurface>, Report> {
    let Some(urdf) = &args.urdf else {
        if args.read.is_given() {
            let help = "name the URDF with --urdf FILE, or leave out the options about how it is read";
            return Err(miette!(help = help, "there is no URDF to be read"));
        }
        return Ok(Vec::new());
    };
    let links = load_surfaces(urdf, &args.read.options()?)?.value;
    match links.iter().find(|l| robot.marker(&l.link).is_none()) {
        Some(l) => Err(miette!(
            help = "give the URDF that the robot file was converted from",
            "{}: link `{}` is not in {}",
            urdf.display(),
            l.link,
            args.robot.display()
        )),
        None => Ok(links),
    }
}

/// A temporary file for a recording.
fn passing_file(robot: &Path) -> Result<PathBuf, Report> {
    let dir = tempfile::Builder::new().prefix("mobee-").tempdir().into_diagnostic();
    let dir = dir.wrap_err("can't make a folder for the recording; name a file for it with --out FILE")?.keep();
    Ok(dir.join(robot.file_stem().unwrap_or_default()).with_extension("rrd"))
}

fn summary(out: &Path, robot: &Robot, seen: &SeenModel, margin: f64) -> String {
    let shapes: usize = robot.nodes.iter().map(|n| n.solids.len()).sum();
    let hulls: usize = robot.nodes.iter().map(|n| n.hulls.len()).sum();
    let hulled = if hulls > 0 { format!(" ({hulls} with hulls)") } else { String::new() };
    let motors = robot.motors.len();
    let count = seen.near.len();
    let mut text = format!(
        "{}: robot `{}`, {motors} motors, {shapes} shapes{hulled}, {:.0} s; nearer than {margin} mm: ",
        out.display(),
        robot.name,
        seen.secs
    );
    text += if count == 0 { "none\n" } else { "\n" };
    for near in seen.near.iter().take(MAX_PRINTED) {
        let _ = writeln!(text, "  {}", near.in_words(robot));
    }
    if count > MAX_PRINTED {
        let _ = writeln!(text, "  and {} more", count - MAX_PRINTED);
    }
    text
}
