//! `mobee roadmap validate`: every edge certified, with what blocks it.

use super::{PlaceArgs, info, load_for, may_write, robot, save};
use crate::robot_import::{Steps, millimeters};
use miette::{Report, miette};
use mobee_behaviors::map_file::certify;
use std::path::PathBuf;

/// What to validate, and in which world.
#[derive(clap::Args, Clone, Debug)]
pub struct ValidateArgs {
    /// The map.
    map: PathBuf,
    #[command(flatten)]
    place: PlaceArgs,
    /// What edges must keep between all shapes, millimeters: the reflex's margin and 2 mm.
    #[arg(long, value_name = "MM", default_value_t = 12.0, value_parser = millimeters(0.0, 500.0))]
    clearance: f64,
    /// Write the validated map into this file; default: into the map itself.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Replace that file if it exists.
    #[arg(long, requires = "out")]
    force: bool,
}

/// Certifies all edges and stores what was found.
///
/// # Errors
/// If a file can't be read or written, or the map is of another robot.
pub fn command(args: &ValidateArgs) -> Result<String, Report> {
    if let Some(out) = &args.out {
        may_write(out, args.force)?;
    }
    let scene = args.place.scene()?;
    let mut map = load_for(&args.map, robot(&scene)?)?;
    let bar = Steps::new();
    bar.step("certifies edges");
    certify(&mut map, &scene, args.clearance * 1e-3, &mut |share| bar.show(share)).map_err(|e| miette!("{e}"))?;
    drop(bar);
    let out = args.out.as_ref().unwrap_or(&args.map);
    save(out, &map)?;
    Ok(format!("{}: {} directed edges: {}\n", out.display(), map.edges.len(), info::verdicts(&map)))
}
