//! `mobee model convert`: a URDF becomes a robot file.

use miette::{IntoDiagnostic, Report, WrapErr, miette};
use mobee_model::{Robot, Shape, UrdfOptions, load_urdf, parse_robot, write_robot};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// What to convert, and how.
#[derive(clap::Args, Clone, Debug)]
pub struct ConvertArgs {
    /// The URDF file (expand macros with xacro first).
    urdf: PathBuf,
    /// The robot file to write; it must not exist yet.
    xml: PathBuf,
    /// Where a package is that the URDF names as `package://NAME/...` (repeatable).
    #[arg(long, value_name = "NAME=DIR", value_parser = package)]
    package: Vec<(String, PathBuf)>,
    /// Also search this folder for packages and meshes (repeatable). Those of ROS_PACKAGE_PATH and AMENT_PREFIX_PATH and the
    /// five above the URDF are always searched.
    #[arg(long, value_name = "DIR")]
    meshes: Vec<PathBuf>,
    /// Leave out meshes instead of fitting a box, capsule or sphere around each.
    #[arg(long)]
    drop_meshes: bool,
    /// Hold planar joints at zero instead of refusing them (a floating base stands still anyhow).
    #[arg(long)]
    fix_unsupported: bool,
    /// Name of the body part that contains all motors (default: the robot's name).
    #[arg(long, value_name = "NAME")]
    part: Option<String>,
    /// Replace the robot file if it exists.
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
        return Err(miette!(
            help = "name another file, or replace it with --force",
            "{} exists already",
            args.xml.display()
        ));
    }
    if let Some(folder) = args.meshes.iter().find(|f| !f.is_dir()) {
        return Err(miette!(
            help = "give the folder that holds the meshes",
            "--meshes {}: no such folder",
            folder.display()
        ));
    }
    let mesh_folders = args.meshes.iter().cloned().chain(ros_folders()).collect();
    let options = UrdfOptions {
        part: args.part.clone(),
        packages: args.package.iter().cloned().collect(),
        mesh_folders,
        drop_meshes: args.drop_meshes,
        fix_unsupported: args.fix_unsupported,
    };
    let loaded = load_urdf(&args.urdf, &options)?;
    let text = write_robot(&loaded.value);
    // What cannot be read back is not written.
    parse_robot(&args.xml.display().to_string(), &text)?;
    save(&args.xml, &text)?;
    let mut out = String::new();
    for warning in &loaded.warnings {
        let _ = writeln!(out, "warning: {warning}");
    }
    let _ = writeln!(out, "{}", summary(&args.xml, &loaded.value));
    Ok(out)
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

/// Where ROS 1 and ROS 2 keep packages, as their set-up scripts say.
fn ros_folders() -> Vec<PathBuf> {
    let folders =
        |name: &str| std::env::var_os(name).map(|v| std::env::split_paths(&v).collect::<Vec<_>>()).unwrap_or_default();
    let shares = folders("AMENT_PREFIX_PATH").into_iter().map(|prefix| prefix.join("share"));
    folders("ROS_PACKAGE_PATH").into_iter().chain(shares).collect()
}

/// Writes beside the target, then renames: the file is whole or absent.
fn save(path: &Path, text: &str) -> Result<(), Report> {
    let mut beside = path.as_os_str().to_owned();
    beside.push(".part");
    let beside = PathBuf::from(beside);
    std::fs::write(&beside, text)
        .and_then(|()| std::fs::rename(&beside, path))
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot write {}; check that its folder exists and is writable", path.display()))
        .inspect_err(|_| drop(std::fs::remove_file(&beside)))
}

fn summary(path: &Path, robot: &Robot) -> String {
    // The balls that mark joints are no shapes of the robot's (see `mobee_model`'s URDF import).
    let is_marker = |s: &Shape| matches!(s, Shape::Sphere { radius } if *radius < 1e-3);
    let shapes = robot.nodes.iter().flat_map(|n| &n.solids).filter(|p| !is_marker(&p.shape)).count();
    format!(
        "{}: robot `{}`, {} motors, {} markers, {shapes} shapes, {} pairs tested",
        path.display(),
        robot.name,
        robot.motors.len(),
        robot.markers.len(),
        robot.pairs.reflex.len()
    )
}
