//! STL, binary and text.

use super::{Parsed, add_polygon, add_triangle, decoded, lines, point};
use mobee_model::Mesh;
use nalgebra::Vector3;

/// Size of the header and count of a binary file, bytes.
const HEADER_BYTES: usize = 84;
/// Size of a triangle in a binary file, bytes: normal, three corners, two additional bytes.
const TRIANGLE_BYTES: usize = 50;
/// Size of the prefix that is tested for text, bytes: a binary file has a zero in its first triangles.
const PREFIX_BYTES: usize = 512;

/// Reads an STL file.
///
/// # Errors
/// The reason, as the end of a sentence.
pub(super) fn parse(bytes: &[u8]) -> Result<Parsed, String> {
    if bytes.is_empty() {
        return Err("is empty".to_owned());
    }
    let count = bytes.get(HEADER_BYTES - 4..HEADER_BYTES).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
    let claimed = count.map(|n| n as usize * TRIANGLE_BYTES + HEADER_BYTES);
    // Text files start with `solid`, but so do many binary ones: the length decides, not the first word.
    if claimed != Some(bytes.len()) && is_text(bytes) {
        return text(&decoded(bytes));
    }
    match (count, claimed) {
        (Some(count), Some(end)) if end <= bytes.len() => {
            let after = &bytes[end..];
            // Less than a triangle, or only zeros, does not contain a part of the surface.
            if after.len() >= TRIANGLE_BYTES && after.iter().any(|b| *b != 0) {
                let room = after.len() / TRIANGLE_BYTES;
                return Err(format!(
                    "claims {count} triangles, and at byte {end} there are as many bytes more as {room} have"
                ));
            }
            let note =
                (!after.is_empty()).then(|| format!("has {} bytes after its end, which are not used", after.len()));
            Ok(Parsed { mesh: binary(&bytes[HEADER_BYTES..end])?, y_up: false, notes: Vec::from_iter(note) })
        }
        (Some(count), _) => {
            let room = (bytes.len() - HEADER_BYTES) / TRIANGLE_BYTES;
            Err(format!("is cut off: it claims {count} triangles and has room for {room}"))
        }
        (None, _) => Err("is cut off: it is shorter than the header of an STL file".to_owned()),
    }
}

/// True if a file is text: its prefix contains words of the format and, unless it is UTF-16, no zero bytes.
fn is_text(bytes: &[u8]) -> bool {
    let start = &bytes[..bytes.len().min(PREFIX_BYTES)];
    let wide = start.starts_with(&[0xff, 0xfe]) || start.starts_with(&[0xfe, 0xff]);
    let words = decoded(start).to_ascii_lowercase();
    (wide || !start.contains(&0)) && ["solid", "facet", "vertex"].iter().any(|word| words.contains(word))
}

fn binary(triangles: &[u8]) -> Result<Mesh, String> {
    let number = |b: &[u8]| b.try_into().map_or(f64::NAN, |b| f64::from(f32::from_le_bytes(b)));
    let corner = |c: &[u8]| Vector3::new(number(&c[0..4]), number(&c[4..8]), number(&c[8..12]));
    let mut mesh = Mesh::default();
    for triangle in triangles.chunks_exact(TRIANGLE_BYTES) {
        let first = mesh.vertices.len() as u32;
        add_triangle(&mut mesh, [first, first + 1, first + 2])?;
        mesh.vertices.extend(triangle[12..48].chunks_exact(12).map(corner));
    }
    Ok(mesh)
}

/// Reads the facets of a text file, in any distribution over lines. A facet ends with `endloop`, `endfacet`, or the
/// start of the next. The names of solids and unknown words are skipped.
fn text(text: &str) -> Result<Parsed, String> {
    let mut facets = Facets::default();
    let mut naming = false;
    let mut ended = false;
    let words =
        lines(text).flat_map(|(line, text)| text.split_whitespace().enumerate().map(move |(i, w)| (line, i, w)));
    let mut words = words.peekable();
    while let Some((line, i, word)) = words.next() {
        let is = |other: &str| word.eq_ignore_ascii_case(other);
        // A name extends to the end of its line, or to the first facet if everything is in one line.
        naming &= i > 0 && !(is("facet") && words.peek().is_some_and(|(.., next)| next.eq_ignore_ascii_case("normal")));
        if naming {
            continue;
        }
        if is("vertex") {
            let place = point(std::iter::from_fn(|| words.next().map(|(.., word)| word)));
            facets.add(place.ok_or_else(|| format!("has no three numbers after `vertex` in line {line}"))?, line)?;
        } else if is("facet") {
            facets.begin(line)?;
            ended = false;
        } else if is("outer") {
            // The facet is still empty.
            facets.open &= !facets.corners.is_empty();
            facets.begin(line)?;
        } else if is("endloop") || is("endfacet") {
            facets.end(line)?;
        } else if is("solid") || is("endsolid") {
            facets.end(line)?;
            naming = true;
            ended = is("endsolid");
        }
    }
    if facets.open && facets.corners.len() < 3 {
        return Err("is cut off: it ends within a triangle".to_owned());
    }
    facets.end(0)?;
    let note = (!ended).then(|| "ends without `endsolid`: it may be cut off".to_owned());
    Ok(Parsed { mesh: facets.mesh, y_up: false, notes: Vec::from_iter(note) })
}

/// The facets of a text file so far.
#[derive(Default)]
struct Facets {
    mesh: Mesh,
    /// Corners of the current facet.
    corners: Vec<u32>,
    /// True within a facet.
    open: bool,
}

impl Facets {
    fn begin(&mut self, line: usize) -> Result<(), String> {
        self.end(line)?;
        self.open = true;
        Ok(())
    }

    fn add(&mut self, place: Vector3<f64>, line: usize) -> Result<(), String> {
        if !self.open {
            return Err(format!("has a vertex outside of a facet in line {line}"));
        }
        self.corners.push(self.mesh.vertices.len() as u32);
        self.mesh.vertices.push(place);
        Ok(())
    }

    fn end(&mut self, line: usize) -> Result<(), String> {
        if !std::mem::take(&mut self.open) {
            return Ok(());
        }
        if self.corners.len() < 3 {
            return Err(format!("has a facet of {} corners that ends in line {line}", self.corners.len()));
        }
        add_polygon(&mut self.mesh, &self.corners)?;
        self.corners.clear();
        Ok(())
    }
}
