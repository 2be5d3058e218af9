//! `mobee model convert`: a URDF becomes a robot file.

use crate::roadmap::save_text;
use crate::robot_import::ImportArgs;
use miette::{Report, miette};
use mobee_model::{Imported, Robot};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// What to convert, and how.
#[derive(clap::Args, Clone, Debug)]
pub struct ConvertArgs {
    /// The URDF file (expand macros with xacro first).
    urdf: PathBuf,
    /// The robot file to write. One that exists is kept: if it was made from the same files and options, nothing is to be done.
    xml: PathBuf,
    #[command(flatten)]
    import: ImportArgs,
    /// Convert anew and replace the robot file if it exists.
    #[arg(long)]
    force: bool,
}

/// Converts the URDF, writes the robot file and says what came of it.
///
/// # Errors
/// If the URDF can't be read or converted (with place and remedy), or the robot file can't be written. Nothing is left
/// half-written.
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

/// What came of it, for people.
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
    for line in decided {
        let _ = writeln!(out, "  {line}");
    }
    out
}

/// Why pairs are left out, and how many for each reason. What follows a comma is about one pair alone.
fn reasons(robot: &Robot) -> BTreeMap<&str, usize> {
    let mut reasons = BTreeMap::new();
    for left_out in robot.left_out.iter().flatten() {
        let reason = left_out.reason.split_once(", joined").map_or(left_out.reason.as_str(), |(word, _)| word);
        *reasons.entry(reason).or_default() += 1;
    }
    reasons
}
