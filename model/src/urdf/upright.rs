//! Whether the `up_axis` that COLLADA meshes declare counts.
//!
//! A URDF does not say which tools it was drawn for, but where the mass of each link is: not far from the middle of its mesh, however
//! the mesh is meant to lie. Of the ten robots that we know whose meshes declare y as up, the mean distance is larger by half at
//! least the wrong way.

use super::UpAxis;
use super::document::{Collision, Document, Geometry};
use super::mesh::Meshes;
use crate::error::{FileError, Source};
use nalgebra::Vector3;

/// The axis counts if the centers of mass are nearer to the meshes by this factor.
const NEARER: f64 = 0.75;
/// Fewer links tell nothing.
const FEWEST: usize = 3;

/// Whether meshes that declare y as up are to be turned by [`z_up`]; a warning says so if that was guessed.
pub(super) fn turns_y_up(
    source: &Source,
    urdf: &Document,
    wanted: UpAxis,
    meshes: &mut Meshes<'_>,
    warnings: &mut Vec<FileError>,
) -> bool {
    if wanted != UpAxis::Guess {
        return wanted == UpAxis::Respect;
    }
    let of_link = |link: &super::document::Link| {
        let center = link.center?;
        link.collisions.iter().find_map(|c| astray(c, &center, meshes))
    };
    let all: Vec<[f64; 2]> = urdf.links.iter().filter_map(of_link).collect();
    let [drawn, turned] = all.iter().fold([0.0, 0.0], |sum, [a, b]| [sum[0] + a, sum[1] + b]);
    let counts = all.len() >= FEWEST && turned < NEARER * drawn;
    if counts {
        let message =
            "the COLLADA meshes are turned, as they declare y as up: the links' centers of mass are nearer to them so";
        let help =
            "look at the robot with `mobee model view`; if its parts lie wrong, convert it with --up-axis ignore";
        warnings.push(source.warning(urdf.at.clone(), message, help));
    }
    counts
}

/// A place in a mesh whose y is up, as it is where z is up.
pub(super) fn z_up(v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(v.x, -v.z, v.y)
}

/// How far a link's center of mass is from the middle of its mesh as it is drawn and as it is turned, in sizes of the mesh. None
/// without a mesh that declares y as up; what can't be read is told by whoever needs it.
fn astray(collision: &Collision, center: &Vector3<f64>, meshes: &mut Meshes<'_>) -> Option<[f64; 2]> {
    let Geometry::Mesh { filename, scale } = &collision.geometry else { return None };
    let file = meshes.get(filename).ok().filter(|f| f.y_up)?;
    let start = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    let (low, high) = file.mesh.vertices.iter().fold(start, |(low, high), v| (low.inf(v), high.sup(v)));
    let size = (high - low).component_mul(scale).norm();
    let middle = (low + high) / 2.0;
    let from = |at: Vector3<f64>| {
        let placed = collision.origin.transform_point(&at.component_mul(scale).into()).coords;
        (placed - center).norm() / size
    };
    (size > 0.0).then(|| [from(middle), from(z_up(&middle))])
}
