//! OBJ: its vertices and faces. Lines, curves, groups and materials are passed over.

use super::{add_polygon, point};
use crate::Mesh;

/// Reads an OBJ file.
///
/// # Errors
/// What is wrong with it, as the end of a sentence.
pub(super) fn parse(bytes: &[u8]) -> Result<Mesh, String> {
    // names of groups may be in any encoding
    let text = String::from_utf8_lossy(bytes);
    let lines =
        || text.lines().map(str::split_whitespace).zip(1..).map(|(mut words, line)| (words.next(), words, line));
    let mut mesh = Mesh::default();
    for (_, words, line) in lines().filter(|(keyword, ..)| *keyword == Some("v")) {
        mesh.vertices.push(point(words).ok_or_else(|| format!("has no three numbers after `v` in line {line}"))?);
    }
    // A negative index counts backwards from the vertex before the face.
    let all = mesh.vertices.len() as i64;
    let mut before = 0_i64;
    let mut corners = Vec::new();
    for (keyword, words, line) in lines() {
        match keyword {
            Some("v") => before += 1,
            Some("f") => {
                corners.clear();
                for word in words {
                    let index = word.split('/').next().and_then(|i| i.parse::<i64>().ok());
                    let index =
                        index.ok_or_else(|| format!("has a face of other things than numbers in line {line}"))?;
                    let index = if index < 0 { before.saturating_add(index) } else { index - 1 };
                    if !(0..all).contains(&index) {
                        return Err(format!(
                            "has a face in line {line} with a corner that is none of its {all} vertices"
                        ));
                    }
                    corners.push(index as u32);
                }
                add_polygon(&mut mesh, &corners)?;
            }
            _ => {}
        }
    }
    Ok(mesh)
}
