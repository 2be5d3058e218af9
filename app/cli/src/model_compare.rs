//! `mobee model compare`: compares contacts of a robot's shapes with contacts of the meshes of its URDF.

use crate::robot_import::{Steps, UrdfArgs};
use crate::terminal;
use miette::{Report, miette};
use mobee_import::{Comparison, IMPORT_SEED, Surfaces, compare, load_surfaces};
use mobee_model::load_robot;
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `mobee model compare`.
#[derive(clap::Args, Clone, Debug)]
pub struct CompareArgs {
    /// Robot XML.
    robot: PathBuf,
    /// The URDF that it was converted from.
    urdf: PathBuf,
    /// Number of random poses.
    #[arg(long, default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    poses: u32,
    /// The seed of the poses.
    #[arg(long, default_value_t = IMPORT_SEED)]
    seed: u64,
    #[command(flatten)]
    read: UrdfArgs,
}

/// Compares, and prints the result.
///
/// # Errors
/// If a file can't be read, or the two are not of one robot.
pub fn command(args: &CompareArgs) -> Result<ExitCode, Report> {
    let robot = load_robot(&args.robot)?.value;
    let links = load_surfaces(&args.urdf, &args.read.options()?)?.value;
    let surfaces = Surfaces::new(&robot, &links).map_err(|why| {
        miette!(help = "compare a robot file with the URDF it was converted from", "{}: {why}", args.urdf.display())
    })?;
    let bar = Steps::new();
    bar.step("compares shapes with meshes");
    let seen = compare(&robot, &surfaces, (args.poses as usize, args.seed), &mut |share| bar.show(share))
        .map_err(|e| miette!("{e}"))?;
    drop(bar);
    terminal::out(&text(&seen));
    // a missed contact is the error that this command looks for
    Ok(if seen.missed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// The comparison as a table.
fn text(seen: &Comparison) -> String {
    let percent = |n: usize| 100.0 * n as f64 / seen.poses.max(1) as f64;
    let mut out = format!(
        "{} poses: in contact by the meshes {:.1} %, by the shapes {:.1} %; falsely {:.1} % ({:.1} % of the free poses are \
         blocked, {:.1} % where the meshes are 2 mm apart), missed {}\n",
        seen.poses,
        percent(seen.by_meshes),
        percent(seen.by_shapes),
        percent(seen.falsely),
        100.0 * seen.blocked_share(),
        100.0 * seen.blocked_apart_share(),
        seen.missed
    );
    let mut pairs: Vec<_> = seen.pairs.iter().filter(|(_, c)| c.falsely + c.missed > 0).collect();
    pairs.sort_by_key(|(_, c)| std::cmp::Reverse((c.missed, c.falsely)));
    for ((a, b), c) in pairs {
        let _ = writeln!(out, "  {a} - {b}: falsely {}, missed {}, by the meshes {}", c.falsely, c.missed, c.met);
    }
    for ((a, b), poses) in &seen.left_out_met {
        let _ = writeln!(out, "  {a} - {b}: left out, by the meshes {poses}");
    }
    out
}
