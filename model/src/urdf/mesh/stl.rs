//! STL, binary and text.

use super::{add_polygon, add_triangle, point};
use crate::Mesh;
use nalgebra::Vector3;

/// Header and count of a binary file, bytes.
const HEADER: usize = 84;
/// A triangle of a binary file: normal, three corners, two bytes more.
const TRIANGLE: usize = 50;

/// Reads an STL file.
///
/// # Errors
/// What is wrong with it, as the end of a sentence.
pub(super) fn parse(bytes: &[u8]) -> Result<Mesh, String> {
    if bytes.is_empty() {
        return Err("is empty".to_owned());
    }
    let count = bytes.get(HEADER - 4..HEADER).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
    let claimed = count.map(|n| n as usize * TRIANGLE + HEADER);
    // Text files begin with `solid`, but so do many binary ones: the length decides, not the first word.
    if claimed != Some(bytes.len()) && bytes.trim_ascii_start().starts_with(b"solid") {
        return text(&String::from_utf8_lossy(bytes));
    }
    match (count, claimed) {
        (Some(_), Some(end)) if end <= bytes.len() => binary(&bytes[HEADER..end]),
        (Some(count), _) => {
            let room = (bytes.len() - HEADER) / TRIANGLE;
            Err(format!("is cut off: it claims {count} triangles and has room for {room}"))
        }
        (None, _) => Err("is cut off: it is shorter than the header of an STL file".to_owned()),
    }
}

fn binary(triangles: &[u8]) -> Result<Mesh, String> {
    let number = |b: &[u8]| b.try_into().map_or(f64::NAN, |b| f64::from(f32::from_le_bytes(b)));
    let corner = |c: &[u8]| Vector3::new(number(&c[0..4]), number(&c[4..8]), number(&c[8..12]));
    let mut mesh = Mesh::default();
    for triangle in triangles.chunks_exact(TRIANGLE) {
        let first = mesh.vertices.len() as u32;
        add_triangle(&mut mesh, [first, first + 1, first + 2])?;
        mesh.vertices.extend(triangle[12..48].chunks_exact(12).map(corner));
    }
    Ok(mesh)
}

/// `vertex` lines between `outer loop` and `endloop`; all other words are for people.
fn text(text: &str) -> Result<Mesh, String> {
    let mut mesh = Mesh::default();
    let mut corners = Vec::new();
    let mut whole = true;
    for (i, line) in text.lines().enumerate() {
        let mut words = line.split_whitespace();
        match words.next().unwrap_or_default().to_ascii_lowercase().as_str() {
            "outer" => (corners, whole) = (Vec::new(), false),
            "vertex" => {
                let place =
                    point(words).ok_or_else(|| format!("has no three numbers after `vertex` in line {}", i + 1))?;
                corners.push(mesh.vertices.len() as u32);
                mesh.vertices.push(place);
            }
            "endloop" => {
                add_polygon(&mut mesh, &corners)?;
                (corners, whole) = (Vec::new(), true);
            }
            _ => {}
        }
    }
    if whole { Ok(mesh) } else { Err("is cut off: it ends within a triangle".to_owned()) }
}
