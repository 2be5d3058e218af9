//! STL, binary and text.

use super::{Parsed, add_polygon, add_triangle, decoded, lines, point};
use crate::Mesh;
use nalgebra::Vector3;

/// Header and count of a binary file, bytes.
const HEADER: usize = 84;
/// A triangle of a binary file: normal, three corners, two bytes more.
const TRIANGLE: usize = 50;
/// How much of a file shows whether it is text, bytes: a binary one has a zero in its first triangles.
const BEGIN: usize = 512;

/// Reads an STL file.
///
/// # Errors
/// What is wrong with it, as the end of a sentence.
pub(super) fn parse(bytes: &[u8]) -> Result<Parsed, String> {
    if bytes.is_empty() {
        return Err("is empty".to_owned());
    }
    let count = bytes.get(HEADER - 4..HEADER).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
    let claimed = count.map(|n| n as usize * TRIANGLE + HEADER);
    // Text files begin with `solid`, but so do many binary ones: the length decides, not the first word.
    if claimed != Some(bytes.len()) && is_text(bytes) {
        return text(&decoded(bytes));
    }
    match (count, claimed) {
        (Some(count), Some(end)) if end <= bytes.len() => {
            let after = &bytes[end..];
            // less than a triangle, or zeros, hide no part of the surface
            if after.len() >= TRIANGLE && after.iter().any(|b| *b != 0) {
                let room = after.len() / TRIANGLE;
                return Err(format!(
                    "claims {count} triangles, and at byte {end} there are as many bytes more as {room} have"
                ));
            }
            let note =
                (!after.is_empty()).then(|| format!("has {} bytes after its end, which are not used", after.len()));
            Ok(Parsed { mesh: binary(&bytes[HEADER..end])?, y_up: false, notes: Vec::from_iter(note) })
        }
        (Some(count), _) => {
            let room = (bytes.len() - HEADER) / TRIANGLE;
            Err(format!("is cut off: it claims {count} triangles and has room for {room}"))
        }
        (None, _) => Err("is cut off: it is shorter than the header of an STL file".to_owned()),
    }
}

/// Whether a file reads as text: it has no zero bytes at its start unless it is UTF-16, and words of the format.
fn is_text(bytes: &[u8]) -> bool {
    let start = &bytes[..bytes.len().min(BEGIN)];
    let wide = start.starts_with(&[0xff, 0xfe]) || start.starts_with(&[0xfe, 0xff]);
    let words = decoded(start).to_ascii_lowercase();
    (wide || !start.contains(&0)) && ["solid", "facet", "vertex"].iter().any(|word| words.contains(word))
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

/// Facets, however they are spread over lines. One ends with `endloop`, `endfacet`, or where the next begins. The names of solids
/// and words of no meaning are passed over.
fn text(text: &str) -> Result<Parsed, String> {
    let mut facets = Facets::default();
    let (mut naming, mut ended) = (false, false);
    let words =
        lines(text).flat_map(|(line, text)| text.split_whitespace().enumerate().map(move |(i, w)| (line, i, w)));
    let mut words = words.peekable();
    while let Some((line, i, word)) = words.next() {
        let is = |other: &str| word.eq_ignore_ascii_case(other);
        // A name reaches to the end of its line, or to the first facet if all is in one line.
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
            // a facet is empty as yet
            facets.open &= !facets.corners.is_empty();
            facets.begin(line)?;
        } else if is("endloop") || is("endfacet") {
            facets.end(line)?;
        } else if is("solid") || is("endsolid") {
            facets.end(line)?;
            (naming, ended) = (true, is("endsolid"));
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
    /// Corners of the facet that is being read.
    corners: Vec<u32>,
    /// Whether one is being read.
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
