//! Mesh files of a URDF: located, read once, and bounded in bytes and triangles.
//!
//! STL, OBJ, COLLADA and glTF are read here instead of by crates: the maintained crates for COLLADA panic on unexpected
//! input, ignore units, or place a geometry only once that a scene shows several times.
//!
//! The type and size of a file are bounded, its location is not: as in ROS, a URDF may name any path. Only regular
//! files are opened, and their contents are never displayed.

mod dae;
mod glb;
mod obj;
mod stl;

use super::UrdfOptions;
use mobee_model::Mesh;
use mobee_text::file::{self, MIB};
use mobee_text::{FileError, SourceText};
use nalgebra::Vector3;
use percent_encoding::percent_decode_str;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// Maximum size of a file, bytes.
const MAX_BYTES: u64 = 64 * MIB;
/// Maximum number of bytes of all meshes of a robot.
const MAX_TOGETHER: u64 = 256 * MIB;
/// Maximum number of triangles of a mesh; larger meshes are made for display.
const MAX_TRIANGLES: usize = 1_000_000;
/// Maximum number of triangles of all meshes of a robot.
const MAX_TRIANGLES_TOGETHER: usize = 4_000_000;
/// Maximum absolute coordinate, in the unit of the file.
const MAX_COORDINATE: f64 = 1e7;

/// The meshes of one robot. Each file is read once, regardless of the number of links that use it.
pub(super) struct Meshes<'a> {
    /// Folders to search.
    options: &'a UrdfOptions,
    /// The files read so far, by path.
    read: BTreeMap<PathBuf, Rc<MeshFile>>,
    /// Pending notes about the files, by path.
    notes: BTreeMap<PathBuf, Vec<MeshIssue>>,
    /// Remaining number of bytes that may be read.
    bytes: u64,
    /// Remaining number of triangles that may be read.
    triangles: usize,
}

/// Contents of a mesh file.
#[derive(Clone, Debug)]
pub(super) struct MeshFile {
    /// Its surface, meters.
    pub mesh: Mesh,
    /// True if the file declares y as the up axis.
    pub y_up: bool,
}

/// An error in a mesh, or a note about a mesh that was read.
#[derive(Clone, Debug)]
pub(super) struct MeshIssue {
    /// Description, as the end of a sentence that begins with the mesh.
    pub message: String,
    /// Suggested remedy.
    pub remedy: String,
}

impl MeshIssue {
    /// An issue in the file's contents.
    pub fn in_file(message: impl Into<String>) -> Self {
        Self { message: message.into(), remedy: EXPORT_AGAIN.to_owned() }
    }
}

/// Remedy for a file with invalid contents.
const EXPORT_AGAIN: &str = "check the file in a viewer, and export it again, as binary STL for example";

/// Result of the reader of a format.
struct Parsed {
    /// The surface, meters.
    mesh: Mesh,
    /// True if the file declares y as the up axis.
    y_up: bool,
    /// Oddities of the file, as ends of sentences.
    notes: Vec<String>,
}

impl<'a> Meshes<'a> {
    /// Creates an empty collection.
    pub fn new(options: &'a UrdfOptions) -> Self {
        Self {
            options,
            read: BTreeMap::new(),
            notes: BTreeMap::new(),
            bytes: MAX_TOGETHER,
            triangles: MAX_TRIANGLES_TOGETHER,
        }
    }

    /// Returns the mesh of this name: meters, after the file's own unit and transforms, before the URDF's `scale`. It
    /// has at least one triangle, no duplicate vertices and no unused ones.
    ///
    /// # Errors
    /// The reason why it can't be used.
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

    /// Returns the notes about a mesh that was read: about its name, and, once, about its file.
    pub fn take_notes(&mut self, name: &str) -> Vec<MeshIssue> {
        let Ok((path, note)) = locate(name, self.options) else { return Vec::new() };
        note.into_iter().chain(self.notes.remove(&path).unwrap_or_default()).collect()
    }
}

/// Reads a triangle mesh from an STL, OBJ, COLLADA or binary glTF file: meters, after the file's own unit and
/// transforms. It has at least one triangle, no duplicate vertices and no unused ones.
///
/// # Errors
/// If the file can't be read, is in another format, has no surface or more than a million triangles.
pub fn load_mesh(path: impl AsRef<Path>) -> Result<Mesh, FileError> {
    let path = path.as_ref();
    read(path).map(|(file, ..)| file.mesh).map_err(|issue| {
        SourceText::new(&path.display().to_string(), "").error(
            0..0,
            format!("the mesh {}", issue.message),
            issue.remedy,
        )
    })
}

/// Reads a mesh file; returns it with notes and its size in bytes.
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

/// The package and the path within it, if the name refers to a file in a package.
fn package(name: &str) -> Option<(&str, &str)> {
    let path = ["package://", "model://"].iter().find_map(|p| name.strip_prefix(p))?;
    path.trim_start_matches('/').split_once('/')
}

/// Finds the file of a name, with a note if the name had to be corrected.
///
/// # Errors
/// If no file is found.
fn locate(name: &str, options: &UrdfOptions) -> Result<(PathBuf, Option<MeshIssue>), MeshIssue> {
    if let Some(path) = find(name, options) {
        return Ok((path, None));
    }
    // The name was written on Windows; on other systems a backslash is part of a file name.
    let slashes = name.replace('\\', "/");
    match find(&slashes, options).filter(|_| slashes != name) {
        Some(path) => {
            let message = format!("is read from `{slashes}`: its name has backslashes");
            Ok((path, Some(MeshIssue { message, remedy: "write / between folders, not \\".to_owned() })))
        }
        None => Err(MeshIssue { message: "is not found".to_owned(), remedy: missing(name) }),
    }
}

/// Remedy for a mesh that is not found.
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

/// Finds the file of a name. A URI may encode a space as `%20`, but a file name may also contain these characters.
fn find(name: &str, options: &UrdfOptions) -> Option<PathBuf> {
    let decoded = percent_decode_str(name).decode_utf8_lossy();
    [name, &decoded].into_iter().flat_map(|name| candidates(name, options)).find(|p| p.is_file())
}

/// Possible paths of the file of a name.
///
/// `package://NAME/FILE` is FILE in the folder given for NAME, or NAME/FILE or FILE in a search folder, since the
/// package itself may be a search folder. Other names are absolute, or relative to a search folder.
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

/// Parses a mesh whose format is given by the file's extension.
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

/// Merges equal vertices.
///
/// # Errors
/// If it has no surface, or a coordinate is not finite or out of range.
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

/// Decodes the text of a file in any common encoding; all significant characters are ASCII. Bytes that are not UTF-8
/// are decoded as Latin-1, so that different names stay different.
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

/// The lines of a text, numbered from 1, ended by LF, CRLF, CR or form feed.
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

/// Parses three numbers; `None` if there are fewer.
fn point<'t>(mut words: impl Iterator<Item = &'t str>) -> Option<Vector3<f64>> {
    let mut number = || words.next()?.parse().ok();
    Some(Vector3::new(number()?, number()?, number()?))
}

/// Adds a polygon as a fan of triangles; one with fewer than three corners adds nothing.
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
/// If the mesh has too many triangles.
fn add_triangle(mesh: &mut Mesh, corners: [u32; 3]) -> Result<(), String> {
    if mesh.triangles.len() >= MAX_TRIANGLES {
        return Err(format!("has more than {MAX_TRIANGLES} triangles: simplify it"));
    }
    mesh.triangles.push(corners);
    Ok(())
}

/// The same surface with each vertex once and no unused ones. Triangles that are degenerate to a line are dropped.
///
/// STL repeats every vertex in every triangle, and other formats repeat vertices where colors meet. Connectivity can be
/// found only if equal vertices are merged.
fn welded(mesh: &Mesh) -> Mesh {
    // -0 equals 0.
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
