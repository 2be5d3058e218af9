//! How far a place is outside a mesh whose hollows are filled.
//!
//! A grid answers in nanoseconds, as often as a search may ask; [`Exact`] measures what was found.

use super::enclose::Cover;
use super::probe;
use super::soup::{Soup, Triangle, bounds};
use nalgebra::Vector3;
use parry3d_f64::math::Vector;
use parry3d_f64::query::{PointQuery, Ray, RayCast};
use parry3d_f64::shape::TriMesh;

/// About how many cells the grid has.
const CELLS: f64 = 150_000.0;
/// Empty cells around the mesh, so that rays and distances have a beginning.
const BORDER: f64 = 2.0;
/// A cell from which so many of the 26 directions end at the mesh is inside: one need not see it everywhere, since meshes have gaps.
const SEEN: u8 = 22;

/// How far is looked, meters: beyond all meshes.
const FAR: f64 = 1e5;
/// The height of what was a line, as a share of its length.
const HAIR: f64 = 1e-5;

/// A grid over the mesh with the distance of each cell from it.
#[derive(Clone, Debug)]
pub(super) struct Filled {
    /// The center of the first cell, meters.
    start: Vector3<f64>,
    /// Width of a cell, meters.
    width: f64,
    /// Cells along x, y and z.
    count: [usize; 3],
    /// Distance from the mesh, meters; zero inside. x runs fastest.
    distance: Vec<f32>,
    /// Places that shapes should leave free, though they may be near the mesh.
    pub claimed: Vec<Vector3<f64>>,
}

impl Filled {
    /// Rasterizes the mesh and measures around it.
    pub fn new(soup: &Soup) -> Self {
        let corners: Vec<Vector3<f64>> = soup.triangles.iter().flatten().copied().collect();
        let (low, high) = bounds(&corners);
        let size = (high - low).add_scalar(1e-3);
        // A rod may not get a million cells across because it has none along.
        let width = (size.product() / CELLS).cbrt().max(size.max() / 250.0);
        let start = low.add_scalar(-BORDER * width);
        let count = [0, 1, 2].map(|i| (size[i] / width + 2.0 * BORDER).ceil() as usize + 1);
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

    /// A place in cells from the first one's center, held within the grid.
    fn inside(&self, place: &Vector3<f64>) -> Vector3<f64> {
        let cells = (place - self.start) / self.width;
        Vector3::from_fn(|i, _| cells[i].clamp(0.0, (self.count[i] - 1) as f64))
    }

    /// Marks the cells that a triangle passes through, by points so dense that few are left out.
    fn mark(&self, [a, b, c]: &Triangle, solid: &mut [bool]) {
        let longest = (b - a).norm().max((c - a).norm()).max((c - b).norm());
        let steps = (longest / self.width * 1.5).ceil().max(1.0) as usize;
        for i in 0..=steps {
            for j in 0..=steps - i {
                let (u, v) = (i as f64 / steps as f64, j as f64 / steps as f64);
                let cell = self.inside(&(a + (b - a) * u + (c - a) * v));
                let cell = [0, 1, 2].map(|k| cell[k].round() as usize);
                solid[self.index(cell)] = true;
            }
        }
    }

    /// Fills the cells that are surrounded by marked ones.
    fn fill(&self, solid: &mut [bool]) {
        let mut seen = vec![0_u8; solid.len()];
        let steps = [-1_i32, 0, 1];
        let directions = steps.iter().flat_map(|x| steps.map(|y| (*x, y))).flat_map(|(x, y)| steps.map(|z| [x, y, z]));
        for direction in directions.filter(|d| *d != [0, 0, 0]) {
            self.look(direction, solid, &mut seen);
        }
        solid.iter_mut().zip(seen).for_each(|(s, seen)| *s |= seen >= SEEN);
    }

    /// Counts the cells from which the mesh is seen in a direction.
    fn look(&self, direction: [i32; 3], solid: &[bool], seen: &mut [u8]) {
        let mut blocked = vec![false; solid.len()];
        // Whoever looks along an axis wants the cell that lies there to have looked before.
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

    /// The distance of every cell from the nearest solid one, axis by axis.
    fn measure(&mut self, solid: &[bool]) {
        let mut square: Vec<f64> = solid.iter().map(|s| if *s { 0.0 } else { 1e12 }).collect();
        let stride = [1, self.count[0], self.count[0] * self.count[1]];
        for axis in 0..3 {
            let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
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

    /// About how far a place is outside the mesh, meters: to about the width of a cell.
    pub fn outside(&self, place: &Vector3<f64>) -> f64 {
        let at = self.inside(place);
        let beyond = ((place - self.start) / self.width - at).norm() * self.width;
        let low = [0, 1, 2].map(|i| (at[i] as usize).min(self.count[i] - 2));
        let part = [0, 1, 2].map(|i| at[i] - low[i] as f64);
        let first = self.index(low);
        let (y, z) = (self.count[0], self.count[0] * self.count[1]);
        let [a, b, c, d] = [first, first + y, first + z, first + y + z].map(|i| self.along_x(i, part[0]));
        let [low, high] = [(a, b), (c, d)].map(|(from, to)| from * (1.0 - part[1]) + to * part[1]);
        beyond + low * (1.0 - part[2]) + high * part[2]
    }

    /// The distance in a cell and in the one after it, the latter by its part.
    #[inline(always)]
    fn along_x(&self, i: usize, part: f64) -> f64 {
        match self.distance.get(i..i + 2) {
            Some([from, to]) => f64::from(*from) * (1.0 - part) + f64::from(*to) * part,
            _ => 0.0,
        }
    }

    /// The share of the claimed places that a shape holds.
    pub fn taken(&self, cover: &Cover) -> f64 {
        if self.claimed.is_empty() {
            return 0.0;
        }
        self.claimed.iter().filter(|p| cover.contains(p)).count() as f64 / self.claimed.len() as f64
    }
}

/// The triangle, a hair wider if it is a line: of those parry knows only the corners.
fn opened(triangle: &Triangle) -> Triangle {
    let length = |i: usize| (triangle[(i + 1) % 3] - triangle[i]).norm();
    let i = (0..3).fold(0, |best, i| if length(i) > length(best) { i } else { best });
    let (from, to, mut apex) = (triangle[i], triangle[(i + 1) % 3], triangle[(i + 2) % 3]);
    let along = to - from;
    if along.cross(&(apex - from)).norm() < HAIR * along.norm_squared() {
        let across = along.cross(&Vector3::ith(along.iamin(), 1.0));
        apex += across.try_normalize(0.0).unwrap_or_default() * (HAIR * along.norm());
    }
    [from, to, apex]
}

/// For each place `i` on a line the smallest `line[k] + (i - k)^2`: parabolas, of which only the lowest count.
///
/// After Felzenszwalb and Huttenlocher, *Distance Transforms of Sampled Functions* (2012).
fn lower_envelope(line: &[f64]) -> Vec<f64> {
    let mut lowest: Vec<(usize, f64)> = Vec::with_capacity(line.len());
    for (k, height) in line.iter().enumerate() {
        let mut from = f64::NEG_INFINITY;
        while let Some(&(other, since)) = lowest.last() {
            let (a, b) = (other as f64, k as f64);
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

/// Distances from the triangles themselves.
#[derive(Clone, Debug)]
pub(super) struct Exact {
    /// All triangles and lids.
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

    /// The largest distance of the primitive's surface from the mesh, meters, among many points of it.
    pub fn overshoot(&self, cover: &Cover, filled: &Filled) -> f64 {
        probe::points(cover, probe::FINE).iter().map(|p| self.outside(p, filled)).fold(0.0, f64::max)
    }

    /// How far a place is outside the mesh, meters.
    fn outside(&self, place: &Vector3<f64>, filled: &Filled) -> f64 {
        // From hollows only the grid knows, and it may be wrong by the diagonal of a cell.
        let coarse = filled.outside(place);
        if coarse <= 0.0 { 0.0 } else { self.distance(place).map_or(coarse, |fine| fine.min(coarse + filled.width)) }
    }

    /// How far a place is from the mesh, meters; zero within it. Near its surface, where the grid is too coarse to know, looking along
    /// the axes tells.
    pub fn gap(&self, place: &Vector3<f64>, filled: &Filled) -> f64 {
        let coarse = filled.outside(place);
        let fine = self.distance(place).unwrap_or(coarse);
        let within = coarse <= filled.width && (fine > 2.0 * filled.width || self.surrounds(place));
        if within { 0.0 } else { fine }
    }

    /// Whether the mesh is seen in all directions of the axes but one, at least.
    fn surrounds(&self, place: &Vector3<f64>) -> bool {
        let from = Vector::new(place.x, place.y, place.z);
        let axes = [Vector::X, Vector::Y, Vector::Z];
        let sees = |to: Vector| self.mesh.as_ref().is_some_and(|m| m.intersects_local_ray(&Ray::new(from, to), FAR));
        axes.iter().flat_map(|axis| [*axis, -*axis]).filter(|to| !sees(*to)).nth(1).is_none()
    }

    /// How far a place is from the nearest triangle, meters, on whichever side.
    pub fn distance(&self, place: &Vector3<f64>) -> Option<f64> {
        let place = Vector::new(place.x, place.y, place.z);
        self.mesh.as_ref().map(|m| m.distance_to_local_point(place, true))
    }
}
