//! The triangles of a link: checked, and reduced to a bounded number.

use mobee_model::Mesh;
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// A triangle by its corners, meters.
pub(super) type Triangle = [Vector3<f64>; 3];

/// If there are more triangles than this, corners are rounded to a grid until there are fewer.
const MAX_TRIANGLES: usize = 40_000;
/// Width of the first grid, relative to the size of the mesh.
const GRID_FRACTION: f64 = 1.0 / 4096.0;
/// Edges longer than the mesh's diagonal divided by this are halved: small triangles can be moved to whichever shape
/// contains them.
const EDGES_PER_DIAGONAL: f64 = 10.0;
/// Maximum number of halvings: if coordinates are large compared with an edge, its midpoint rounds to one of its ends.
const MAX_HALVINGS: u32 = 12;
/// Maximum absolute coordinate, meters.
const MAX_COORDINATE_M: f64 = 1e4;

/// Unordered triangles of a link.
pub(super) struct Soup {
    /// The triangles of the meshes.
    pub triangles: Vec<Triangle>,
    /// Triangles that close open rims, to distinguish inside from outside: without them a tube would not have an
    /// inside.
    pub lids: Vec<Triangle>,
    /// Index of the connected part of each triangle.
    body: Vec<u32>,
    /// Maximum distance between the meshes and these triangles due to rounding, meters.
    pub slack: f64,
}

impl Soup {
    /// The triangles, one list per connected part.
    pub fn connected(&self) -> Vec<Vec<Triangle>> {
        let mut parts: BTreeMap<u32, Vec<Triangle>> = BTreeMap::new();
        self.triangles.iter().zip(&self.body).for_each(|(t, body)| parts.entry(*body).or_default().push(*t));
        parts.into_values().collect()
    }

    /// Checks and reduces the triangles of meshes.
    ///
    /// # Errors
    /// The end of a sentence that describes the fault of the meshes.
    pub fn new(meshes: &[Mesh]) -> Result<Self, String> {
        let mut corners = Vec::new();
        for mesh in meshes {
            for triangle in &mesh.triangles {
                for &i in triangle {
                    let vertex =
                        mesh.vertices.get(i as usize).ok_or("has a triangle with a corner that is not there")?;
                    if !vertex.iter().all(|c| c.abs() <= MAX_COORDINATE_M) {
                        return Err("has coordinates that are not finite or beyond 10 km".to_owned());
                    }
                    corners.push(*vertex);
                }
            }
        }
        if corners.is_empty() {
            return Err("has no triangles".to_owned());
        }
        let (low, high) = bounds(&corners);
        let mut grain = 0.0;
        loop {
            let (points, triangles) = weld(&corners, &low, grain);
            if triangles.len() <= MAX_TRIANGLES {
                let at = |t: &[u32; 3]| t.map(|i| points[i as usize]);
                let lids = lids(&points, &triangles);
                let slack = grain * 3.0_f64.sqrt() / 2.0;
                let mut bodies = DisjointSets::new(points.len());
                triangles.iter().for_each(|[a, b, c]| [b, c].iter().for_each(|i| bodies.join(*a, **i)));
                let longest = (high - low).norm() / EDGES_PER_DIAGONAL;
                let mut out = Self { triangles: Vec::new(), body: Vec::new(), lids, slack };
                for triangle in &triangles {
                    halved(at(triangle), longest, MAX_HALVINGS, &mut out.triangles);
                    out.body.resize(out.triangles.len(), bodies.group(triangle[0]));
                }
                return Ok(out);
            }
            // The loop terminates: a grid as wide as the mesh leaves eight points, hence at most 120 triangles,
            // segments and points.
            let coarser = (triangles.len() as f64 / MAX_TRIANGLES as f64).sqrt().clamp(1.3, 8.0);
            grain = if grain > 0.0 { grain * coarser } else { (high - low).max() * GRID_FRACTION };
        }
    }
}

/// Adds a triangle, halved until its edges are at most `longest`.
fn halved(triangle: Triangle, longest: f64, depth: u32, out: &mut Vec<Triangle>) {
    let length = |i: usize| (triangle[(i + 1) % 3] - triangle[i]).norm();
    let i = (0..3).fold(0, |best, i| if length(i) > length(best) { i } else { best });
    if length(i) <= longest || depth == 0 || out.len() > 2 * MAX_TRIANGLES {
        return out.push(triangle);
    }
    let a = triangle[i];
    let b = triangle[(i + 1) % 3];
    let c = triangle[(i + 2) % 3];
    let middle = (a + b) / 2.0;
    halved([a, middle, c], longest, depth - 1, out);
    halved([middle, b, c], longest, depth - 1, out);
}

/// Disjoint sets of points (union-find).
struct DisjointSets(Vec<u32>);

impl DisjointSets {
    /// Creates `count` sets of one point each.
    fn new(count: usize) -> Self {
        Self((0..u32::try_from(count).unwrap_or(u32::MAX)).collect())
    }

    /// The smallest point of a point's set.
    fn group(&mut self, mut i: u32) -> u32 {
        while self.0[i as usize] != i {
            self.0[i as usize] = self.0[self.0[i as usize] as usize];
            i = self.0[i as usize];
        }
        i
    }

    /// Unites the sets of two points.
    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.group(a), self.group(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}

/// The minimum and maximum corner of the box around points.
pub(super) fn bounds(points: &[Vector3<f64>]) -> (Vector3<f64>, Vector3<f64>) {
    let low = points.iter().fold(Vector3::repeat(f64::INFINITY), |a, p| a.inf(p));
    let high = points.iter().fold(Vector3::repeat(f64::NEG_INFINITY), |a, p| a.sup(p));
    (low, high)
}

/// Unites equal corners (or corners that round to the same grid point, unless the grid width is zero). Returns the
/// points and the triangles between them, each once.
fn weld(corners: &[Vector3<f64>], low: &Vector3<f64>, grain: f64) -> (Vec<Vector3<f64>>, Vec<[u32; 3]>) {
    let place = |p: &Vector3<f64>| if grain > 0.0 { low + ((p - low) / grain).map(f64::round) * grain } else { *p };
    // After the shift all are non-negative, so bits are ordered as numbers are, and equal points have equal bits.
    let key = |p: &Vector3<f64>| [p.x - low.x, p.y - low.y, p.z - low.z].map(f64::to_bits);
    let mut order: Vec<([u64; 3], u32)> =
        corners.iter().enumerate().map(|(i, p)| (key(&place(p)), u32::try_from(i).unwrap_or(u32::MAX))).collect();
    order.sort_unstable();
    let mut points = Vec::new();
    let mut index = vec![0; corners.len()];
    let mut last = None;
    for (key, i) in order {
        if last != Some(key) {
            last = Some(key);
            points.push(place(&corners[i as usize]));
        }
        index[i as usize] = points.len() as u32 - 1;
    }
    let sorted = |t: &[u32]| {
        let mut t = [t[0], t[1], t[2]];
        t.sort_unstable();
        t
    };
    let mut triangles: Vec<[u32; 3]> = index.chunks_exact(3).map(sorted).collect();
    triangles.sort_unstable();
    triangles.dedup();
    // A triangle that collapsed to a point is usually the corner of a neighbor, and is then dropped.
    let mut held = vec![false; points.len()];
    triangles.iter().filter(|t| t[0] != t[2]).flatten().for_each(|i| held[*i as usize] = true);
    triangles.retain(|t| t[0] != t[2] || !std::mem::replace(&mut held[t[0] as usize], true));
    (points, triangles)
}

/// A fan over each rim; rim edges belong to one triangle only.
fn lids(points: &[Vector3<f64>], triangles: &[[u32; 3]]) -> Vec<Triangle> {
    let whole = triangles.iter().filter(|t| t[0] != t[1] && t[1] != t[2]);
    let mut edges: Vec<[u32; 2]> = whole.flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[0], t[2]]]).collect();
    edges.sort_unstable();
    let rims: Vec<[u32; 2]> = edges.chunk_by(|a, b| a == b).filter(|e| e.len() == 1).map(|e| e[0]).collect();
    let mut rim = DisjointSets::new(points.len());
    rims.iter().for_each(|[a, b]| rim.join(*a, *b));
    let mut center = vec![(Vector3::zeros(), 0.0); points.len()];
    for i in rims.iter().flatten() {
        let (sum, count) = &mut center[rim.group(*i) as usize];
        *sum += points[*i as usize];
        *count += 1.0;
    }
    let mut lid = |[a, b]: &[u32; 2]| {
        let (sum, count) = center[rim.group(*a) as usize];
        [points[*a as usize], points[*b as usize], sum / count]
    };
    rims.iter().map(&mut lid).collect()
}

/// Appends the parts of a triangle below and above the plane of the points `x` with `n.x = d` to the lists; their union
/// is the triangle.
pub(super) fn split(
    triangle: &Triangle,
    n: &Vector3<f64>,
    d: f64,
    below: &mut Vec<Triangle>,
    above: &mut Vec<Triangle>,
) {
    let side = triangle.map(|p| n.dot(&p) - d);
    if side.iter().all(|s| *s <= 0.0) {
        return below.push(*triangle);
    }
    if side.iter().all(|s| *s >= 0.0) {
        return above.push(*triangle);
    }
    let mut low = Vec::with_capacity(4);
    let mut high = Vec::with_capacity(4);
    for i in 0..3 {
        let j = (i + 1) % 3;
        if side[i] <= 0.0 {
            low.push(triangle[i]);
        }
        if side[i] >= 0.0 {
            high.push(triangle[i]);
        }
        if side[i] * side[j] < 0.0 {
            let cut = triangle[i].lerp(&triangle[j], side[i] / (side[i] - side[j]));
            low.push(cut);
            high.push(cut);
        }
    }
    for (polygon, list) in [(low, below), (high, above)] {
        list.extend((1..polygon.len().saturating_sub(1)).map(|i| [polygon[0], polygon[i], polygon[i + 1]]));
    }
}
