//! `mobee model convert`: converts a URDF into a robot file.

use crate::robot_import::ImportArgs;
use miette::{Report, miette};
use mobee_compose::maps::save_text;
use mobee_import::Imported;
use mobee_model::Robot;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Arguments of `mobee model convert`.
#[derive(clap::Args, Clone, Debug)]
pub struct ConvertArgs {
    /// The URDF file (expand macros with xacro first).
    urdf: PathBuf,
    /// The robot file to write. An existing one stays: if it was made from the same files and options, nothing is done.
    xml: PathBuf,
    #[command(flatten)]
    import: ImportArgs,
    /// Convert again and replace the robot file if it exists.
    #[arg(long)]
    force: bool,
}

/// Converts the URDF, writes the robot file and returns a summary.
///
/// # Errors
/// If the URDF can't be read or converted (with place and remedy), or the robot file can't be written. No partial file
/// remains.
pub fn command(args: &ConvertArgs) -> Result<String, Report> {
    if args.xml.exists() && !args.force {
        if args.import.made(&args.xml, &args.urdf)? {
            return Ok(format!("{}: made from the same files and options; nothing to fit\n", args.xml.display()));
        }
        return Err(miette!(
            help = "name another file, or replace it with --force",
            "{} exists already",
            args.xml.display()
        ));
    }
    let imported = args.import.import(&args.urdf)?;
    let text = imported.file_text(&args.urdf, &args.xml)?;
    save_text(&args.xml, &text)?;
    Ok(summary(&args.xml, &imported))
}

/// A summary of the conversion as text.
pub fn summary(path: &Path, imported: &Imported) -> String {
    let Imported { robot, warnings, decided, .. } = imported;
    let mut out = String::new();
    for warning in warnings {
        let _ = writeln!(out, "warning: {warning}");
    }
    let shapes: usize = robot.nodes.iter().map(|n| n.solids.len()).sum();
    let _ = writeln!(
        out,
        "{}: robot `{}`, {} motors, {} markers, {shapes} shapes, {} pairs of links tested",
        path.display(),
        robot.name,
        robot.motors.len(),
        robot.markers.len(),
        robot.pairs.reflex.len()
    );
    for (reason, count) in reasons(robot) {
        let _ = writeln!(out, "  {count} pairs left out: {reason}");
    }
    if !robot.near.is_empty() {
        let _ = writeln!(out, "  {} pairs tested with a clearance of their own", robot.near.len());
    }
    for line in decided {
        let _ = writeln!(out, "  {line}");
    }
    out
}

/// The reasons of disabled pairs, with their numbers. The part after a comma is specific to a pair.
fn reasons(robot: &Robot) -> BTreeMap<&str, usize> {
    let mut reasons = BTreeMap::new();
    for left_out in robot.left_out.iter().flatten() {
        let reason = left_out.reason.split_once(", joined").map_or(left_out.reason.as_str(), |(word, _)| word);
        *reasons.entry(reason).or_default() += 1;
    }
    reasons
}
