//! Distance of a point outside a mesh whose hollows are filled.
//!
//! A grid gives it approximately, within nanoseconds, as a search needs it; [`Exact`] measures the result.

use super::enclose::Cover;
use super::probe;
use super::soup::{Soup, Triangle, bounds};
use nalgebra::Vector3;
use parry3d_f64::math::Vector;
use parry3d_f64::query::{PointQuery, Ray, RayCast};
use parry3d_f64::shape::TriMesh;

/// Approximate number of grid cells.
const TARGET_CELLS: f64 = 150_000.0;
/// Width of the border of empty cells around the mesh, in cells: outside distances need at least one empty cell.
const BORDER_CELLS: f64 = 2.0;
/// A cell is inside if at least this many of the 26 directions end at the mesh: not all of them, since meshes have
/// gaps.
const MIN_BLOCKED_DIRECTIONS: u8 = 22;

/// Ray length, meters: longer than any mesh.
const RAY_LENGTH_M: f64 = 1e5;
/// Height of a degenerate triangle after widening, relative to its length.
const MIN_RELATIVE_HEIGHT: f64 = 1e-5;

/// A grid over the mesh with the distance of each cell from the mesh.
#[derive(Clone, Debug)]
pub(super) struct Filled {
    /// Center of the first cell, meters.
    start: Vector3<f64>,
    /// Width of a cell, meters.
    width: f64,
    /// Number of cells along x, y and z.
    count: [usize; 3],
    /// Distance from the mesh, meters; zero inside. x varies fastest.
    distance: Vec<f32>,
    /// Points that shapes should leave free, although they may be near the mesh.
    pub claimed: Vec<Vector3<f64>>,
}

impl Filled {
    /// Rasterizes the mesh and computes the distances.
    pub fn new(soup: &Soup) -> Self {
        let corners: Vec<Vector3<f64>> = soup.triangles.iter().flatten().copied().collect();
        let (low, high) = bounds(&corners);
        let size = (high - low).add_scalar(1e-3);
        // Limits the cells along the longest side: a thin rod would get far too many.
        let width = (size.product() / TARGET_CELLS).cbrt().max(size.max() / 250.0);
        let start = low.add_scalar(-BORDER_CELLS * width);
        let count = [0, 1, 2].map(|i| (size[i] / width + 2.0 * BORDER_CELLS).ceil() as usize + 1);
        let mut grid = Self { start, width, count, distance: Vec::new(), claimed: Vec::new() };
        let mut solid = vec![false; count.iter().product()];
        for triangle in soup.triangles.iter().chain(&soup.lids) {
            grid.mark(triangle, &mut solid);
        }
        grid.fill(&mut solid);
        grid.measure(&solid);
        grid
    }

    /// Index of a cell.
    fn index(&self, cell: [usize; 3]) -> usize {
        cell[0] + self.count[0] * (cell[1] + self.count[1] * cell[2])
    }

    /// A point in cell coordinates relative to the first cell's center, clamped to the grid.
    fn inside(&self, place: &Vector3<f64>) -> Vector3<f64> {
        let cells = (place - self.start) / self.width;
        Vector3::from_fn(|i, _| cells[i].clamp(0.0, (self.count[i] - 1) as f64))
    }

    /// Marks the cells that a triangle crosses, by sampling it so densely that few are missed.
    fn mark(&self, [a, b, c]: &Triangle, solid: &mut [bool]) {
        let longest = (b - a).norm().max((c - a).norm()).max((c - b).norm());
        let steps = (longest / self.width * 1.5).ceil().max(1.0) as usize;
        for i in 0..=steps {
            for j in 0..=steps - i {
                let u = i as f64 / steps as f64;
                let v = j as f64 / steps as f64;
                let cell = self.inside(&(a + (b - a) * u + (c - a) * v));
                let cell = [0, 1, 2].map(|k| cell[k].round() as usize);
                solid[self.index(cell)] = true;
            }
        }
    }

    /// Fills the cells that are enclosed by marked ones.
    fn fill(&self, solid: &mut [bool]) {
        let mut seen = vec![0_u8; solid.len()];
        let offsets = [-1_i32, 0, 1];
        let directions =
            offsets.iter().flat_map(|x| offsets.map(|y| (*x, y))).flat_map(|(x, y)| offsets.map(|z| [x, y, z]));
        for direction in directions.filter(|d| *d != [0, 0, 0]) {
            self.look(direction, solid, &mut seen);
        }
        solid.iter_mut().zip(seen).for_each(|(s, seen)| *s |= seen >= MIN_BLOCKED_DIRECTIONS);
    }

    /// Increments the count of the cells from which the mesh is visible in a direction.
    fn look(&self, direction: [i32; 3], solid: &[bool], seen: &mut [u8]) {
        let mut blocked = vec![false; solid.len()];
        // The next cell in the direction must be processed first.
        let axis = |i: usize| {
            let n = self.count[i];
            (0..n).map(move |k| if direction[i] > 0 { n - 1 - k } else { k })
        };
        let ahead = |at: usize, i: usize| {
            let to = at as i64 + i64::from(direction[i]);
            usize::try_from(to).ok().filter(|to| *to < self.count[i])
        };
        for z in axis(2) {
            for y in axis(1) {
                let row = ahead(z, 2).zip(ahead(y, 1));
                for x in axis(0) {
                    let at = self.index([x, y, z]);
                    let next = row.zip(ahead(x, 0)).is_some_and(|((z, y), x)| blocked[self.index([x, y, z])]);
                    blocked[at] = next || solid[at];
                    seen[at] += u8::from(blocked[at]);
                }
            }
        }
    }

    /// Computes the distance of every cell from the nearest solid one, axis by axis.
    fn measure(&mut self, solid: &[bool]) {
        let mut square: Vec<f64> = solid.iter().map(|s| if *s { 0.0 } else { 1e12 }).collect();
        let stride = [1, self.count[0], self.count[0] * self.count[1]];
        for axis in 0..3 {
            let a = (axis + 1) % 3;
            let b = (axis + 2) % 3;
            let mut line = vec![0.0; self.count[axis]];
            for i in 0..self.count[a] {
                for j in 0..self.count[b] {
                    let first = i * stride[a] + j * stride[b];
                    (0..line.len()).for_each(|k| line[k] = square[first + k * stride[axis]]);
                    let nearest = lower_envelope(&line);
                    nearest.iter().enumerate().for_each(|(k, d)| square[first + k * stride[axis]] = *d);
                }
            }
        }
        self.distance = square.iter().map(|s| (s.sqrt() * self.width) as f32).collect();
    }

    /// Approximate distance of a point outside the mesh, meters; the error is about the width of a cell.
    pub fn outside(&self, place: &Vector3<f64>) -> f64 {
        let at = self.inside(place);
        let beyond = ((place - self.start) / self.width - at).norm() * self.width;
        let low = [0, 1, 2].map(|i| (at[i] as usize).min(self.count[i] - 2));
        let part = [0, 1, 2].map(|i| at[i] - low[i] as f64);
        let first = self.index(low);
        let y = self.count[0];
        let z = self.count[0] * self.count[1];
        let [a, b, c, d] = [first, first + y, first + z, first + y + z].map(|i| self.along_x(i, part[0]));
        let [low, high] = [(a, b), (c, d)].map(|(from, to)| from * (1.0 - part[1]) + to * part[1]);
        beyond + low * (1.0 - part[2]) + high * part[2]
    }

    /// Linear interpolation between the distances of cell `i` and the next one along x.
    #[inline(always)]
    fn along_x(&self, i: usize, part: f64) -> f64 {
        match self.distance.get(i..i + 2) {
            Some([from, to]) => f64::from(*from) * (1.0 - part) + f64::from(*to) * part,
            _ => 0.0,
        }
    }

    /// Share of the claimed points that a shape contains.
    pub fn taken(&self, cover: &Cover) -> f64 {
        if self.claimed.is_empty() {
            return 0.0;
        }
        self.claimed.iter().filter(|p| cover.contains(p)).count() as f64 / self.claimed.len() as f64
    }
}

/// The triangle, slightly widened if it is degenerate: parry handles only the corners of degenerate triangles.
fn opened(triangle: &Triangle) -> Triangle {
    let length = |i: usize| (triangle[(i + 1) % 3] - triangle[i]).norm();
    let i = (0..3).fold(0, |best, i| if length(i) > length(best) { i } else { best });
    let from = triangle[i];
    let to = triangle[(i + 1) % 3];
    let mut apex = triangle[(i + 2) % 3];
    let along = to - from;
    if along.cross(&(apex - from)).norm() < MIN_RELATIVE_HEIGHT * along.norm_squared() {
        let across = along.cross(&Vector3::ith(along.iamin(), 1.0));
        apex += across.try_normalize(0.0).unwrap_or_default() * (MIN_RELATIVE_HEIGHT * along.norm());
    }
    [from, to, apex]
}

/// The minimum over `k` of `line[k] + (i - k)^2` for each `i`: the lower envelope of parabolas.
///
/// After Felzenszwalb and Huttenlocher, *Distance Transforms of Sampled Functions* (2012).
fn lower_envelope(line: &[f64]) -> Vec<f64> {
    let mut lowest: Vec<(usize, f64)> = Vec::with_capacity(line.len());
    for (k, height) in line.iter().enumerate() {
        let mut from = f64::NEG_INFINITY;
        while let Some(&(other, since)) = lowest.last() {
            let a = other as f64;
            let b = k as f64;
            from = (height + b * b - line[other] - a * a) / (2.0 * (b - a));
            if from > since {
                break;
            }
            lowest.pop();
            from = f64::NEG_INFINITY;
        }
        lowest.push((k, from));
    }
    let mut at = 0;
    let value = |i: usize| {
        while lowest.get(at + 1).is_some_and(|(_, from)| *from < i as f64) {
            at += 1;
        }
        let (k, _) = lowest[at];
        line[k] + (i as f64 - k as f64).powi(2)
    };
    (0..line.len()).map(value).collect()
}

/// Exact distances from the triangles.
#[derive(Clone, Debug)]
pub(super) struct Exact {
    /// All triangles and lids; `None` if there are none.
    mesh: Option<TriMesh>,
}

impl Exact {
    /// Prepares all triangles and lids.
    pub fn new(soup: &Soup) -> Self {
        let triangles = soup.triangles.iter().chain(&soup.lids).flat_map(opened);
        let corners: Vec<Vector> = triangles.map(|p| Vector::new(p.x, p.y, p.z)).collect();
        let count = u32::try_from(corners.len() / 3).unwrap_or(0);
        let indices = (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        Self { mesh: TriMesh::new(corners, indices).ok() }
    }

    /// The largest distance of the primitive's surface from the mesh, meters, over many sample points.
    pub fn overshoot(&self, cover: &Cover, filled: &Filled) -> f64 {
        probe::points(cover, probe::FINE).iter().map(|p| self.outside(p, filled)).fold(0.0, f64::max)
    }

    /// Distance of a point outside the mesh, meters.
    fn outside(&self, place: &Vector3<f64>, filled: &Filled) -> f64 {
        // Only the grid represents filled hollows, and its error may be the diagonal of a cell.
        let coarse = filled.outside(place);
        if coarse <= 0.0 { 0.0 } else { self.distance(place).map_or(coarse, |fine| fine.min(coarse + filled.width)) }
    }

    /// Distance of a point from the mesh, meters; zero inside. Near the surface, where the grid is too coarse, rays
    /// along the axes decide.
    pub fn gap(&self, place: &Vector3<f64>, filled: &Filled) -> f64 {
        let coarse = filled.outside(place);
        let fine = self.distance(place).unwrap_or(coarse);
        let within = coarse <= filled.width && (fine > 2.0 * filled.width || self.surrounds(place));
        if within { 0.0 } else { fine }
    }

    /// True if at most one of the six axis directions misses the mesh.
    fn surrounds(&self, place: &Vector3<f64>) -> bool {
        let from = Vector::new(place.x, place.y, place.z);
        let axes = [Vector::X, Vector::Y, Vector::Z];
        let sees =
            |to: Vector| self.mesh.as_ref().is_some_and(|m| m.intersects_local_ray(&Ray::new(from, to), RAY_LENGTH_M));
        axes.iter().flat_map(|axis| [*axis, -*axis]).filter(|to| !sees(*to)).nth(1).is_none()
    }

    /// Unsigned distance of a point from the nearest triangle, meters.
    pub fn distance(&self, place: &Vector3<f64>) -> Option<f64> {
        let place = Vector::new(place.x, place.y, place.z);
        self.mesh.as_ref().map(|m| m.distance_to_local_point(place, true))
    }
}
