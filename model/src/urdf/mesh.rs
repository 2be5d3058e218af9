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
use std::borrow::Cow;
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
    /// What is to be noted about the files, by path.
    notes: BTreeMap<PathBuf, Vec<MeshIssue>>,
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

/// Something wrong with a mesh, or something to note about one that was read.
#[derive(Clone, Debug)]
pub(super) struct MeshIssue {
    /// What it is, as the end of a sentence that begins with the mesh.
    pub message: String,
    /// What to do about it.
    pub remedy: String,
}

impl MeshIssue {
    /// Something wrong, or odd, in the file itself.
    pub fn in_file(message: impl Into<String>) -> Self {
        Self { message: message.into(), remedy: EXPORT_AGAIN.to_owned() }
    }
}

/// What to do about a file whose content is wrong.
const EXPORT_AGAIN: &str = "check the file in a viewer, and export it again, as binary STL for example";

/// A mesh as a reader of a format returns it.
struct Parsed {
    /// The surface, meters.
    mesh: Mesh,
    /// Whether the file declares that y is up in it.
    y_up: bool,
    /// What is odd about the file, as ends of sentences.
    notes: Vec<String>,
}

impl<'a> Meshes<'a> {
    /// No mesh yet.
    pub fn new(options: &'a UrdfOptions) -> Self {
        Self {
            options,
            read: BTreeMap::new(),
            notes: BTreeMap::new(),
            bytes: MAX_TOGETHER,
            triangles: MAX_TRIANGLES_TOGETHER,
        }
    }

    /// The mesh of this name: meters, after the file's own unit and transforms, before the URDF's `scale`. It has a triangle at
    /// least, no vertex twice and none unused.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn get(&mut self, name: &str) -> Result<Rc<MeshFile>, MeshIssue> {
        self.get_or_read(name).map_err(|mut issue| {
            issue.remedy += ", leave meshes out with --drop-meshes, or give the link a box, cylinder or sphere";
            issue
        })
    }

    fn get_or_read(&mut self, name: &str) -> Result<Rc<MeshFile>, MeshIssue> {
        let (path, _) = locate(name, self.options)?;
        if let Some(mesh) = self.read.get(&path) {
            return Ok(mesh.clone());
        }
        let (file, notes, bytes) = read(&path)?;
        let too_much = |message| MeshIssue { message, remedy: "simplify the largest meshes".to_owned() };
        self.bytes = self.bytes.checked_sub(bytes).ok_or_else(|| {
            too_much(format!("is too much: all meshes together have more than {} MiB", MAX_TOGETHER / MIB))
        })?;
        self.triangles = self.triangles.checked_sub(file.mesh.triangles.len()).ok_or_else(|| {
            too_much(format!("is too much: all meshes together have more than {MAX_TRIANGLES_TOGETHER} triangles"))
        })?;
        let file = Rc::new(file);
        self.read.insert(path.clone(), file.clone());
        self.notes.insert(path, notes);
        Ok(file)
    }

    /// What is to be noted about a mesh that was read: about how it is named, and, once, about its file.
    pub fn take_notes(&mut self, name: &str) -> Vec<MeshIssue> {
        let Ok((path, note)) = locate(name, self.options) else { return Vec::new() };
        note.into_iter().chain(self.notes.remove(&path).unwrap_or_default()).collect()
    }
}

/// Reads a triangle mesh from an STL, OBJ, COLLADA or binary glTF file: meters, after the file's own unit and transforms. It has a triangle at
/// least, no vertex twice and none unused.
///
/// # Errors
/// If the file can't be read, is of another format, has no surface or more than a million triangles.
pub fn load_mesh(path: impl AsRef<Path>) -> Result<Mesh, FileError> {
    let path = path.as_ref();
    read(path).map(|(file, ..)| file.mesh).map_err(|issue| {
        Source::new(&path.display().to_string(), "").error(0..0, format!("the mesh {}", issue.message), issue.remedy)
    })
}

/// A mesh file, what is to be noted about it, and how many bytes it has.
fn read(path: &Path) -> Result<(MeshFile, Vec<MeshIssue>, u64), MeshIssue> {
    let bytes = file::read(path, MAX_BYTES).map_err(|e| MeshIssue {
        message: format!("cannot be read: {e}"),
        remedy: "check that it is a regular file that this user may read, and simplify one that is too large"
            .to_owned(),
    })?;
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let Parsed { mesh, y_up, notes } = parse(&extension, &bytes)?;
    let notes = notes.into_iter().map(MeshIssue::in_file).collect();
    Ok((MeshFile { mesh, y_up }, notes, bytes.len() as u64))
}

/// The package and the path within it, if the name is that of a file in a package.
fn package(name: &str) -> Option<(&str, &str)> {
    let path = ["package://", "model://"].iter().find_map(|p| name.strip_prefix(p))?;
    path.trim_start_matches('/').split_once('/')
}

/// The file that a name stands for, and a note if it had to be read in another way than written.
///
/// # Errors
/// If there is none.
fn locate(name: &str, options: &UrdfOptions) -> Result<(PathBuf, Option<MeshIssue>), MeshIssue> {
    if let Some(path) = find(name, options) {
        return Ok((path, None));
    }
    // written on Windows; elsewhere a backslash is part of a name
    let slashes = name.replace('\\', "/");
    match find(&slashes, options).filter(|_| slashes != name) {
        Some(path) => {
            let message = format!("is read from `{slashes}`: its name has backslashes");
            Ok((path, Some(MeshIssue { message, remedy: "write / between folders, not \\".to_owned() })))
        }
        None => Err(MeshIssue { message: "is not found".to_owned(), remedy: missing(name) }),
    }
}

/// What to do about a mesh that is not found.
fn missing(name: &str) -> String {
    let slashes = name.replace('\\', "/");
    let where_it_is = match package(&slashes) {
        Some((package, _)) => format!("say where the package is with --package {package}=DIR"),
        None => "name the folder of the meshes with --meshes DIR".to_owned(),
    };
    let written = match () {
        () if name.starts_with(['~', '$']) => {
            "write the path in full, for `~` and variables are not expanded in a URDF; "
        }
        () if name.contains('\\') => "write / between folders, not \\; ",
        () => "",
    };
    written.to_owned() + &where_it_is
}

/// The file that a name stands for, if there is one. An address may write `%20` for a space, and a file may have that in its name.
fn find(name: &str, options: &UrdfOptions) -> Option<PathBuf> {
    let decoded = percent_decode_str(name).decode_utf8_lossy();
    [name, &decoded].into_iter().flat_map(|name| candidates(name, options)).find(|p| p.is_file())
}

/// Where the file of a name may be.
///
/// `package://NAME/FILE` is FILE in the folder that was given for NAME, or NAME/FILE or FILE in a folder that is searched, for the
/// package itself may be given. Other names are relative to a folder that is searched, or absolute.
fn candidates(name: &str, options: &UrdfOptions) -> Vec<PathBuf> {
    let folders = options.mesh_folders.iter();
    match package(name) {
        Some((package, file)) => {
            let given = options.packages.get(package).map(|folder| folder.join(file));
            given.into_iter().chain(folders.flat_map(|f| [f.join(package).join(file), f.join(file)])).collect()
        }
        None => {
            let path = ["file://localhost/", "file:///", "file:/"].iter().find_map(|p| name.strip_prefix(p));
            let path = path.map(|path| format!("/{path}"));
            let path = path.as_deref().or_else(|| name.strip_prefix("file://")).unwrap_or(name);
            folders.map(|f| f.join(path)).collect()
        }
    }
}

/// Reads a mesh of a format that is known by its file's extension.
fn parse(extension: &str, bytes: &[u8]) -> Result<Parsed, MeshIssue> {
    let parsed = match extension {
        "stl" => stl::parse(bytes),
        "obj" => obj::parse(bytes),
        "dae" => dae::parse(bytes),
        "glb" => glb::parse(bytes),
        other => {
            return Err(MeshIssue {
                message: format!("is of type `{other}`; STL, OBJ, COLLADA (.dae) and binary glTF (.glb) can be read"),
                remedy: "export it as one of these".to_owned(),
            });
        }
    };
    parsed.and_then(checked).map_err(MeshIssue::in_file)
}

/// The mesh with each vertex once.
///
/// # Errors
/// If it has no surface, or is somewhere out of sight.
fn checked(parsed: Parsed) -> Result<Parsed, String> {
    if parsed.mesh.vertices.iter().flatten().any(|c| c.is_nan() || c.abs() > MAX_COORDINATE) {
        return Err(format!("has a vertex that is not finite or beyond {MAX_COORDINATE}"));
    }
    let mesh = welded(&parsed.mesh);
    if mesh.triangles.is_empty() {
        return Err("has no surface: there is no triangle in it with three corners".to_owned());
    }
    Ok(Parsed { mesh, ..parsed })
}

/// The text of a file in whichever encoding: what matters is ASCII in all of them. Bytes that are not UTF-8 are taken as Latin-1,
/// so that names that differ stay different.
fn decoded(bytes: &[u8]) -> Cow<'_, str> {
    let wide = |bytes: &[u8], unit: fn([u8; 2]) -> u16| {
        let units = bytes.chunks_exact(2).map(|pair| unit([pair[0], pair[1]]));
        char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect::<String>()
    };
    let bytes = match bytes {
        [0xff, 0xfe, wide_bytes @ ..] => return wide(wide_bytes, u16::from_le_bytes).into(),
        [0xfe, 0xff, wide_bytes @ ..] => return wide(wide_bytes, u16::from_be_bytes).into(),
        [0xef, 0xbb, 0xbf, bytes @ ..] => bytes,
        bytes => bytes,
    };
    if let Ok(text) = std::str::from_utf8(bytes) {
        return text.into();
    }
    let mut text = String::with_capacity(bytes.len() + 64);
    for chunk in bytes.utf8_chunks() {
        text.push_str(chunk.valid());
        text.extend(chunk.invalid().iter().map(|byte| char::from(*byte)));
    }
    text.into()
}

/// The lines of a text, numbered from 1, whichever way they end: LF, CRLF, CR or form feed.
fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut rest = Some(text);
    let next = move || {
        let text = rest?;
        let (line, after) = match text.split_once(['\n', '\r', '\u{c}']) {
            Some((line, after)) if text[line.len()..].starts_with("\r\n") => (line, Some(&after[1..])),
            Some((line, after)) => (line, Some(after)),
            None => (text, None),
        };
        rest = after;
        Some(line)
    };
    (1..).zip(std::iter::from_fn(next))
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
