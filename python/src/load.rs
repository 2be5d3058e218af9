//! `mobee.load`: a robot from a URDF, imported once and cached, or from a robot file.

use crate::failure::Failure;
use crate::robot::PyRobot;
use crate::wait::{Reports, background};
use mobee_import::{FitOptions, ImportOptions, UrdfOptions, plain_name, ros_package_folders};
use mobee_model::file::{MIB, read_text};
use mobee_model::{Loaded, load_robot, parse_robot, write_robot};
use pyo3::prelude::*;
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Longer files are refused by their readers.
const MAX_BYTES: u64 = 64 * MIB;
/// Folders that are searched at most.
const MAX_FOLDERS: usize = 1000;
/// The outermost element of a robot file.
const ROBOT_FILE: &str = "<ZeroPositionKinematicTree";
/// Prefix of the lines of a robot file's comment that are warnings.
const WARNING: &str = "warning: ";

/// Prefixes of the first and the last line of that comment.
const FRAME: [&str; 2] = ["Converted from ", "Made from inputs "];

/// Loads a robot from a URDF or from a robot file (ZRP XML).
///
/// A URDF is imported as by ``mobee model convert``: shapes are fitted around its meshes, pairs of links that need no test are found,
/// and a home that is free. That takes seconds to minutes, and is cached in ``$XDG_CACHE_HOME/mobee/robots`` (``~/.cache``) by the contents
/// of URDF, SRDF and meshes and the options below: the second time it takes milliseconds.
///
/// Parameters
/// ----------
/// path : str or os.PathLike
///     The file. Expand xacro first.
/// srdf : str or os.PathLike, optional
///     The SRDF that belongs to a URDF: pairs of links that need no test, groups (`Robot.parts`), the home pose.
/// packages : dict[str, path], optional
///     Folders of the packages that the URDF names as ``package://NAME/...``.
/// mesh_dirs : sequence of paths, optional
///     More folders to search for packages and meshes. Those of ROS_PACKAGE_PATH and AMENT_PREFIX_PATH and the five above the URDF are
///     always searched.
/// drop_meshes : bool
///     Leave out meshes instead of fitting shapes around them.
/// visual : bool
///     Fit shapes around the visuals of links that have no collision shapes.
/// fix_unsupported : bool
///     Hold planar joints at zero instead of refusing them.
/// part : str, optional
///     Name of the one part with all joints; default: a part for each group of the SRDF.
/// overshoot : float
///     Largest distance by which shapes stick out of a mesh, meters.
/// shapes : int
///     Most shapes of a link, 1 to 64.
/// poses : int
///     Random configurations at which pairs are found that need no test; 0: none.
/// cache : bool
///     Use the cache.
/// progress : callable, optional
///     Called with the step and the share of it that is done, about 30 times a second.
///
/// Returns
/// -------
/// Robot
///
/// Raises
/// ------
/// MobeeError
///     code ``file``: what is wrong in a file, with line and column; ``bounds``, ``options``, ``too_many``, ``duplicate``.
#[pyfunction]
#[pyo3(signature = (path, *, srdf=None, packages=None, mesh_dirs=None, drop_meshes=false, visual=false, fix_unsupported=false,
                    part=None, overshoot=0.01, shapes=12, poses=10_000, cache=true, progress=None))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
pub(crate) fn load(
    py: Python<'_>,
    path: PathBuf,
    srdf: Option<PathBuf>,
    packages: Option<BTreeMap<String, PathBuf>>,
    mesh_dirs: Option<&Bound<'_, PyAny>>,
    drop_meshes: bool,
    visual: bool,
    fix_unsupported: bool,
    part: Option<String>,
    overshoot: f64,
    shapes: usize,
    poses: usize,
    cache: bool,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<PyRobot> {
    if !(1e-4..=1.0).contains(&overshoot) || !(1..=64).contains(&shapes) || poses > 10_000_000 {
        let remedy = "give overshoot from 0.0001 to 1 m, shapes from 1 to 64, and poses up to 10,000,000";
        return Err(Failure::new("bounds", "overshoot, shapes or poses is out of bounds", remedy).into());
    }
    let packages = packages.unwrap_or_default();
    let mesh_dirs = mesh_dirs.map(folders).transpose()?.unwrap_or_default();
    if let Some(folder) = packages.values().chain(&mesh_dirs).find(|folder| !folder.is_dir()) {
        let message = format!("{}: no such folder", folder.display());
        return Err(Failure::new("file", message, "give the folder that holds the meshes").at("mesh_dirs").into());
    }
    let identity = format!("{:?}", (&part, drop_meshes, visual, fix_unsupported, overshoot, shapes, poses));
    let has_files = srdf.is_some() || !packages.is_empty() || !mesh_dirs.is_empty() || part.is_some();
    let is_changed = drop_meshes || visual || fix_unsupported || (overshoot, shapes, poses) != (0.01, 12, 10_000);
    let is_plain = !has_files && !is_changed;
    let read = UrdfOptions {
        part,
        packages,
        mesh_folders: mesh_dirs.into_iter().chain(ros_package_folders()).collect(),
        drop_meshes,
        fix_unsupported,
        visual,
        fit: FitOptions { overshoot, primitives: shapes },
        ..UrdfOptions::default()
    };
    let options = ImportOptions { read, srdf, poses, identity };
    background(py, progress, move |_, reports| {
        if read_text(&path, MAX_BYTES).is_ok_and(|text| text.contains(ROBOT_FILE)) {
            if is_plain {
                return robot_file(&path);
            }
            let remedy = "leave out all options but cache and progress, or give the URDF";
            let message = format!("{} is a robot file, and the options are for a URDF", path.display());
            return Err(Failure::new("options", message, remedy).at("path"));
        }
        urdf(&path, &options, cache.then(cache_folder).flatten().as_deref(), reports)
    })
}

/// Folders of an argument: taken one by one, as it may have any number.
fn folders(paths: &Bound<'_, PyAny>) -> PyResult<Vec<PathBuf>> {
    let mut all = Vec::new();
    for path in paths.try_iter()? {
        all.push(path?.extract()?);
        if all.len() > MAX_FOLDERS {
            let failure = Failure::new("too_many", format!("more than {MAX_FOLDERS} folders"), "give fewer");
            return Err(failure.at("mesh_dirs").into());
        }
    }
    Ok(all)
}

fn robot_file(path: &Path) -> Result<PyRobot, Failure> {
    let Loaded { value, warnings } = load_robot(path)?;
    let warnings = warnings.iter().map(ToString::to_string).collect();
    let text = write_robot(&value);
    Ok(PyRobot::new(value, &BTreeMap::new(), text, (Vec::new(), warnings)))
}

/// Imports a URDF, unless the cache has it.
fn urdf(path: &Path, options: &ImportOptions, cache: Option<&Path>, reports: &Reports) -> Result<PyRobot, Failure> {
    let rotations = options.link_rotations(path)?;
    let name = path.file_stem().map(|stem| plain_name(&stem.to_string_lossy())).unwrap_or_default();
    let inputs = options.inputs(path)?;
    let cached = cache.map(|folder| folder.join(format!("{name}-{inputs}.xml")));
    let known = cached.as_ref().and_then(|file| {
        let text = read_text(file, MAX_BYTES).ok()?;
        // a damaged file is replaced
        Some((parse_robot(&file.display().to_string(), &text).ok()?.value, text))
    });
    let (model, text) = match known {
        Some(known) => known,
        None => {
            let mut imported = options.import(path, &mut |step, share| {
                // dropped if the caller has gone or is slower
                let _ = reports.try_send((step, share));
            })?;
            let warnings = imported.warnings.iter().map(|w| format!("{WARNING}{w}"));
            imported.decided.extend(warnings.collect::<Vec<_>>());
            let text = imported.file_text(path, path)?;
            if let Some(file) = &cached
                && let Err(failure) = write(file, &text)
            {
                imported.decided.push(format!("not cached: {}", failure.message));
            }
            // as from the cache, to the last digit
            (parse_robot(&path.display().to_string(), &text)?.value, text)
        }
    };
    let comments = comment(&text);
    Ok(PyRobot::new(model, &rotations, text, comments))
}

/// Notes and warnings in a robot file's first comment.
fn comment(text: &str) -> (Vec<String>, Vec<String>) {
    let inside = text.split_once("<!--").and_then(|(_, rest)| rest.split_once("-->")).map_or("", |(inside, _)| inside);
    // two hyphens would end a comment
    let lines = inside.lines().filter_map(|line| line.strip_prefix("  ")).map(|line| line.replace("- -", "--"));
    let lines = lines.filter(|line| !FRAME.iter().any(|begin| line.starts_with(begin)));
    let (warnings, notes): (Vec<String>, Vec<String>) = lines.partition(|line| line.starts_with(WARNING));
    (notes, warnings.iter().filter_map(|w| w.strip_prefix(WARNING)).map(str::to_owned).collect())
}

/// The folder of imported robots: `$XDG_CACHE_HOME/mobee/robots`, or `~/.cache/mobee/robots`.
fn cache_folder() -> Option<PathBuf> {
    let of = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    let cache = of("XDG_CACHE_HOME").or_else(|| of("HOME").map(|home| home.join(".cache")))?;
    Some(cache.join("mobee/robots"))
}

/// Of a temporary file that others may read once it has its name.
fn new_file() -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder
}

/// Writes a file whole or not at all.
///
/// # Errors
/// If it can't be written.
pub(crate) fn write(path: &Path, text: &str) -> Result<(), Failure> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let written = std::fs::create_dir_all(folder).and_then(|()| {
        let mut file = new_file().tempfile_in(folder)?;
        file.write_all(text.as_bytes())?;
        file.persist(path).map_err(|e| e.error)?;
        Ok(())
    });
    written.map_err(|e| {
        let message = format!("cannot write {}: {e}", path.display());
        Failure::new("file", message, "name a file in a folder that you may write to").at("path")
    })
}
