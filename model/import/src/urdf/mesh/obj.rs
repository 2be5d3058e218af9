//! OBJ: vertices and faces. Lines, points, curves, groups and materials are skipped.

use super::{MAX_TRIANGLES, Parsed, add_polygon, decoded, lines, point};
use mobee_model::Mesh;
use std::borrow::Cow;

/// Statements that do not contribute to the surface.
const IGNORED_STATEMENTS: [&str; 39] = [
    "vt",
    "vn",
    "vp",
    "l",
    "p",
    "g",
    "s",
    "o",
    "mg",
    "usemtl",
    "mtllib",
    "usemap",
    "maplib",
    "shadow_obj",
    "trace_obj",
    "bevel",
    "c_interp",
    "d_interp",
    "lod",
    "cstype",
    "deg",
    "bmat",
    "step",
    "curv",
    "curv2",
    "parm",
    "trim",
    "hole",
    "scrv",
    "sp",
    "end",
    "con",
    "ctech",
    "stech",
    "res",
    "cdc",
    "cdp",
    "newmtl",
    "vc",
];

/// Reads an OBJ file.
///
/// # Errors
/// The reason, as the end of a sentence.
pub(super) fn parse(bytes: &[u8]) -> Result<Parsed, String> {
    let text = decoded(bytes);
    let mut mesh = Mesh::default();
    // `corners`: indices from 0, not yet checked; `faces`: for each face its line and its end in `corners`.
    let mut corners = Vec::new();
    let mut faces = Vec::new();
    let mut unknown = None;
    let mut wrapped = false;
    for (line, statement) in statements(&text) {
        let was_wrapped = std::mem::replace(&mut wrapped, statement.trim_end().ends_with('\\'));
        let mut words = statement.split_whitespace();
        let keyword = words.next().unwrap_or_default();
        match keyword.to_ascii_lowercase().as_str() {
            "v" => {
                let place =
                    point(&mut words).ok_or_else(|| format!("has no three numbers after `v` in line {line}"))?;
                // One additional number is a weight, three are a color.
                let weight = match (words.next().and_then(|w| w.parse::<f64>().ok()), words.next()) {
                    (Some(weight), None) => weight,
                    _ => 1.0,
                };
                mesh.vertices.push(place / weight);
            }
            "f" | "fo" => {
                for word in words {
                    corners.push(corner(word, mesh.vertices.len()).ok_or_else(|| {
                        format!("has a face of other things than the numbers of vertices in line {line}")
                    })?);
                }
                faces.push((line, corners.len()));
                if corners.len() > 3 * MAX_TRIANGLES {
                    return Err(format!("has more than {MAX_TRIANGLES} triangles: simplify it"));
                }
            }
            keyword @ ("surf" | "bsp" | "bzp" | "call") => {
                return Err(format!("has a surface that is not made of faces, by `{keyword}` in line {line}"));
            }
            "" => {}
            other if was_wrapped || IGNORED_STATEMENTS.contains(&other) => {}
            other => _ = unknown.get_or_insert((line, other.chars().take(20).collect::<String>())),
        }
    }
    let all = mesh.vertices.len();
    let mut start = 0;
    for (line, end) in faces {
        let face = corners.get(start..end).unwrap_or_default();
        let face: Option<Vec<u32>> =
            face.iter().map(|i| u32::try_from(*i).ok().filter(|i| (*i as usize) < all)).collect();
        let face =
            face.ok_or_else(|| format!("has a face in line {line} with a corner that is none of its {all} vertices"))?;
        add_polygon(&mut mesh, &face)?;
        start = end;
    }
    let note = |(line, word)| format!("has a word that is not used, `{word}` in line {line}");
    Ok(Parsed { mesh, y_up: false, notes: unknown.map(note).into_iter().collect() })
}

/// The index of a corner's vertex, from 0. A negative one in the file counts backward from the last vertex before the
/// face.
fn corner(word: &str, before: usize) -> Option<i64> {
    let index: i64 = word.split('/').next()?.parse().ok()?;
    if index < 0 { (before as i64).checked_add(index) } else { Some(index - 1) }
}

/// The statements of the text, each with its line number: lines without comments, joined if one ends with a backslash.
///
/// Only vertices and faces are joined: a comment or the name of a folder that ends with a backslash must not absorb the
/// next line.
fn statements(text: &str) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let mut lines = lines(text).map(|(number, line)| (number, line.split('#').next().unwrap_or_default()));
    std::iter::from_fn(move || {
        let (number, line) = lines.next()?;
        let keyword = line.split_whitespace().next().unwrap_or_default();
        if !["v", "f", "fo"].iter().any(|k| keyword.eq_ignore_ascii_case(k)) {
            return Some((number, Cow::Borrowed(line)));
        }
        let mut whole = Cow::Borrowed(line);
        while let Some(length) = whole.trim_end().strip_suffix('\\').map(str::len) {
            let joined = whole.to_mut();
            joined.truncate(length);
            joined.push(' ');
            joined.push_str(lines.next().map_or("", |(_, next)| next));
        }
        Some((number, whole))
    })
}
