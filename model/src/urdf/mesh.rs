//! The mesh files that a URDF names: found, read once, bounded in bytes and triangles.
//!
//! STL, OBJ, COLLADA and glTF are read here rather than by crates: of the kept ones, those that read COLLADA panic on what they don't
//! expect, ignore units, or place a geometry only once that a scene shows several times.
//!
//! What a file may be is bounded, where it lies is not: a URDF may name any path, as it does in ROS. Only regular files are opened,
//! and nothing of what is in them is ever shown.

mod dae;
mod glb;
mod obj;
mod stl;

use super::UrdfOptions;
use crate::Mesh;
use crate::error::{FileError, Source};
use crate::file::{self, MIB};
use nalgebra::Vector3;
use percent_encoding::percent_decode_str;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// A longer file is refused, bytes.
const MAX_BYTES: u64 = 64 * MIB;
/// How many bytes may be read of all meshes of a robot.
const MAX_TOGETHER: u64 = 256 * MIB;
/// A mesh of more triangles is refused: it is for looking at.
const MAX_TRIANGLES: usize = 1_000_000;
/// How many triangles all meshes of a robot may have.
const MAX_TRIANGLES_TOGETHER: usize = 4_000_000;
/// Farther coordinates are refused, in the unit of the file.
const MAX_COORDINATE: f64 = 1e7;

/// The meshes of one robot. Each file is read once, however many links it is part of.
pub(super) struct Meshes<'a> {
    /// Where to look for files.
    options: &'a UrdfOptions,
    /// What was read, by path.
    read: BTreeMap<PathBuf, Rc<MeshFile>>,
    /// How many bytes may still be read.
    bytes: u64,
    /// How many triangles may still be read.
    triangles: usize,
}

/// What a mesh file contains.
#[derive(Clone, Debug)]
pub(super) struct MeshFile {
    /// Its surface, meters.
    pub mesh: Mesh,
    /// Whether the file declares that y is up in it.
    pub y_up: bool,
}

impl<'a> Meshes<'a> {
    /// No mesh yet.
    pub fn new(options: &'a UrdfOptions) -> Self {
        Self { options, read: BTreeMap::new(), bytes: MAX_TOGETHER, triangles: MAX_TRIANGLES_TOGETHER }
    }

    /// The mesh of this name: meters, after the file's own unit and transforms, before the URDF's `scale`. It has a triangle at
    /// least, no vertex twice and none unused.
    ///
    /// # Errors
    /// What is wrong with it, as the end of a sentence.
    pub fn get(&mut self, name: &str) -> Result<Rc<MeshFile>, String> {
        let path = find(name, self.options).ok_or("is not found")?;
        if let Some(mesh) = self.read.get(&path) {
            return Ok(mesh.clone());
        }
        let (file, bytes) = read(&path)?;
        self.bytes = self
            .bytes
            .checked_sub(bytes)
            .ok_or_else(|| format!("is too much: all meshes together have more than {} MiB", MAX_TOGETHER / MIB))?;
        self.triangles = self.triangles.checked_sub(file.mesh.triangles.len()).ok_or_else(|| {
            format!("is too much: all meshes together have more than {MAX_TRIANGLES_TOGETHER} triangles")
        })?;
        let file = Rc::new(file);
        self.read.insert(path, file.clone());
        Ok(file)
    }
}

/// Reads a triangle mesh from an STL, OBJ, COLLADA or binary glTF file: meters, after the file's own unit and transforms. It has a triangle at
/// least, no vertex twice and none unused.
///
/// # Errors
/// If the file can't be read, is of another format, has no surface or more than a million triangles.
pub fn load_mesh(path: impl AsRef<Path>) -> Result<Mesh, FileError> {
    let path = path.as_ref();
    read(path).map(|(file, _)| file.mesh).map_err(|why| {
        let help = "check the file in a viewer, and export it anew, as binary STL for example";
        Source::new(&path.display().to_string(), "").error(0..0, format!("the mesh {why}"), help)
    })
}

/// A mesh file, and how many bytes it has.
fn read(path: &Path) -> Result<(MeshFile, u64), String> {
    let bytes = file::read(path, MAX_BYTES).map_err(|e| format!("cannot be read: {e}"))?;
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    Ok((parse(&extension, &bytes)?, bytes.len() as u64))
}

/// What to do about a mesh that could not be read.
pub(super) fn remedy(name: &str) -> String {
    let where_it_is = match package(name).map(|(package, _)| package) {
        Some(package) => format!("say where the package is with --package {package}=DIR"),
        None => "name the folder of the meshes with --meshes DIR".to_owned(),
    };
    format!("{where_it_is}, leave meshes out with --drop-meshes, or give the link a box, cylinder or sphere")
}

/// The package and the path within it, if the name is that of a file in a package.
fn package(name: &str) -> Option<(&str, &str)> {
    let path = ["package://", "model://"].iter().find_map(|p| name.strip_prefix(p))?;
    path.trim_start_matches('/').split_once('/')
}

/// The file that a name stands for, if there is one.
///
/// `package://NAME/FILE` is FILE in the folder that was given for NAME, or NAME/FILE or FILE in a folder that is searched, for the
/// package itself may be given. Other names are relative to a folder that is searched, or absolute.
fn find(name: &str, options: &UrdfOptions) -> Option<PathBuf> {
    let folders = options.mesh_folders.iter();
    let candidates: Vec<PathBuf> = match package(name) {
        Some((package, file)) => {
            let given = options.packages.get(package).map(|folder| folder.join(file));
            given.into_iter().chain(folders.flat_map(|f| [f.join(package).join(file), f.join(file)])).collect()
        }
        None => {
            let path = name.strip_prefix("file://");
            // an address may write %20 for a space, and a file may have that in its name
            let decoded = path.map(|path| percent_decode_str(path).decode_utf8_lossy());
            let names = [Some(path.unwrap_or(name)), decoded.as_deref()];
            names.into_iter().flatten().flat_map(|name| folders.clone().map(move |f| f.join(name))).collect()
        }
    };
    candidates.into_iter().find(|p| p.is_file())
}

/// Reads a mesh of a format that is known by its file's extension.
fn parse(extension: &str, bytes: &[u8]) -> Result<MeshFile, String> {
    let (mesh, y_up) = match extension {
        "stl" => (stl::parse(bytes)?, false),
        "obj" => (obj::parse(bytes)?, false),
        "dae" => dae::parse(bytes)?,
        // y is up in all of them
        "glb" => (glb::parse(bytes)?, true),
        other => {
            return Err(format!("is of type `{other}`; STL, OBJ, COLLADA (.dae) and binary glTF (.glb) can be read"));
        }
    };
    if mesh.vertices.iter().flatten().any(|c| c.is_nan() || c.abs() > MAX_COORDINATE) {
        return Err(format!("has a vertex that is not finite or beyond {MAX_COORDINATE}"));
    }
    let mesh = welded(&mesh);
    if mesh.triangles.is_empty() {
        return Err("has no surface: there is no triangle in it with three corners".to_owned());
    }
    Ok(MeshFile { mesh, y_up })
}

/// Three numbers in text, if there are so many.
fn point<'t>(mut words: impl Iterator<Item = &'t str>) -> Option<Vector3<f64>> {
    let mut number = || words.next()?.parse().ok();
    Some(Vector3::new(number()?, number()?, number()?))
}

/// Adds a polygon as a fan of triangles; one of less than three corners adds nothing.
///
/// # Errors
/// If the mesh has too many triangles.
fn add_polygon(mesh: &mut Mesh, corners: &[u32]) -> Result<(), String> {
    let Some((first, others)) = corners.split_first() else { return Ok(()) };
    for pair in others.windows(2) {
        add_triangle(mesh, [*first, pair[0], pair[1]])?;
    }
    Ok(())
}

/// Adds a triangle.
///
/// # Errors
/// If the mesh has too many.
fn add_triangle(mesh: &mut Mesh, corners: [u32; 3]) -> Result<(), String> {
    if mesh.triangles.len() >= MAX_TRIANGLES {
        return Err(format!("has more than {MAX_TRIANGLES} triangles: simplify it"));
    }
    mesh.triangles.push(corners);
    Ok(())
}

/// The same surface with each vertex once and none that no triangle uses. Triangles that have shrunk to a line are left out.
///
/// STL repeats every vertex in every triangle, and other formats repeat them where colors meet; whoever asks what hangs together
/// needs to know that they are one.
fn welded(mesh: &Mesh) -> Mesh {
    // -0 and 0 are one place
    let key = |i: u32| mesh.vertices[i as usize].map(|c| (c + 0.0).to_bits());
    let mut used = vec![false; mesh.vertices.len()];
    mesh.triangles.iter().flatten().for_each(|i| used[*i as usize] = true);
    let mut order: Vec<u32> = (0..mesh.vertices.len() as u32).filter(|i| used[*i as usize]).collect();
    order.sort_by_cached_key(|i| key(*i).data.0);
    let mut new = Mesh::default();
    let mut new_index = vec![0; mesh.vertices.len()];
    for (n, i) in order.iter().enumerate() {
        if n == 0 || key(order[n - 1]) != key(*i) {
            new.vertices.push(mesh.vertices[*i as usize]);
        }
        new_index[*i as usize] = new.vertices.len() as u32 - 1;
    }
    let renumbered = mesh.triangles.iter().map(|t| t.map(|i| new_index[i as usize]));
    new.triangles = renumbered.filter(|[a, b, c]| a != b && b != c && c != a).collect();
    new
}
