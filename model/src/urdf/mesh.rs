//! Points of a mesh file: STL (binary and text) and OBJ. Its triangles do not matter: what is fitted around the points is convex,
//! and so is around all between them.

use crate::file::{self, MIB};
use nalgebra::Vector3;
use std::path::{Path, PathBuf};

/// A longer file is refused, bytes.
const MAX_BYTES: u64 = 64 * MIB;
/// How many bytes may be read of all meshes of a robot.
pub(super) const MAX_TOGETHER: u64 = 256 * MIB;

/// The vertices of a mesh, or what is wrong as the end of a sentence. What is read is taken from `left`, bytes.
pub(super) fn points(name: &str, folders: &[PathBuf], left: &mut u64) -> Result<Vec<Vector3<f64>>, String> {
    let path = find(name, folders).ok_or("is not found")?;
    let bytes = file::read(&path, MAX_BYTES).map_err(|e| format!("cannot be read: {e}"))?;
    *left = left
        .checked_sub(bytes.len() as u64)
        .ok_or_else(|| format!("is too much: all meshes together have more than {} MiB", MAX_TOGETHER / MIB))?;
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let points = match extension.as_str() {
        // Text files begin with `solid`, but so do many binary ones: the length decides, not the first word.
        "stl" => binary_stl(&bytes).or_else(|| text_vertices(&bytes, "vertex")),
        "obj" => text_vertices(&bytes, "v"),
        other => return Err(format!("is of type `{other}`; STL and OBJ can be read")),
    };
    points.filter(|p| !p.is_empty()).ok_or_else(|| "has no readable vertices".to_owned())
}

/// Looks for `package://PACKAGE/REST` as FOLDER/PACKAGE/REST and FOLDER/REST, else for FOLDER/NAME.
fn find(name: &str, folders: &[PathBuf]) -> Option<PathBuf> {
    if let Some(path) = name.strip_prefix("file://") {
        return Some(PathBuf::from(path)).filter(|p| p.is_file());
    }
    let rest = ["package://", "model://"].iter().find_map(|p| name.strip_prefix(p)).unwrap_or(name);
    let inside = rest.split_once('/').map_or(rest, |(_, inside)| inside);
    folders.iter().flat_map(|f| [f.join(rest), f.join(inside)]).find(|p: &PathBuf| Path::is_file(p))
}

/// 80 bytes of header, a count, then 50 bytes per triangle: normal, three corners, two bytes more.
fn binary_stl(bytes: &[u8]) -> Option<Vec<Vector3<f64>>> {
    let count = u32::from_le_bytes(bytes.get(80..84)?.try_into().ok()?) as usize;
    let triangles = bytes.get(84..)?;
    // Text read as binary shows some count, too, but not one that fits its length to the byte.
    if triangles.len() != count.checked_mul(50)? {
        return None;
    }
    let number = |b: &[u8]| b.try_into().map_or(f64::NAN, |b| f64::from(f32::from_le_bytes(b)));
    let corner = |c: &[u8]| Vector3::new(number(&c[0..4]), number(&c[4..8]), number(&c[8..12]));
    Some(triangles.chunks_exact(50).flat_map(|t| t[12..48].chunks_exact(12).map(corner)).collect())
}

/// Lines of a keyword and three numbers.
fn text_vertices(bytes: &[u8], keyword: &str) -> Option<Vec<Vector3<f64>>> {
    let text = std::str::from_utf8(bytes).ok()?;
    let words = text.lines().map(str::split_whitespace).filter_map(|mut w| (w.next()? == keyword).then_some(w));
    words
        .map(|mut w| {
            let mut number = || w.next()?.parse::<f64>().ok();
            Some(Vector3::new(number()?, number()?, number()?))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_binary_stl_may_not_claim_more_than_it_has() {
        let mut bytes = vec![0; 84 + 50];
        bytes[80] = 1;
        assert_eq!(binary_stl(&bytes).unwrap().len(), 3);
        bytes[80] = 2;
        assert!(binary_stl(&bytes).is_none());
        assert!(binary_stl(&bytes[..83]).is_none());
    }

    #[test]
    fn text_is_read_or_refused_as_a_whole() {
        assert_eq!(text_vertices(b"v 1 2 3\nvn 0 0 1\nv 4 5 6 1\n", "v").unwrap().len(), 2);
        assert!(text_vertices(b"v 1 2 x\n", "v").is_none());
    }
}
