//! Decides if the `up_axis` that COLLADA meshes declare is applied.
//!
//! A URDF does not name the tool that it was made for, but it gives the center of mass of each link, which is not far
//! from the center of its mesh in the intended orientation. For the ten known robots whose meshes declare y as up, the
//! mean distance is larger by at least half in the wrong orientation.

use super::UpAxis;
use super::document::{Document, UrdfCollision, UrdfGeometry};
use super::mesh::Meshes;
use mobee_text::{FileError, SourceText};
use nalgebra::Vector3;

/// The declaration is applied if it reduces the distance between centers of mass and meshes to this fraction.
const MAX_DISTANCE_RATIO: f64 = 0.75;
/// Minimum number of links for a decision.
const MIN_LINKS: usize = 3;

/// True if meshes that declare y as up are to be rotated by [`z_up`]; adds a warning if this is a guess.
pub(super) fn turns_y_up(
    source: &SourceText,
    urdf: &Document,
    wanted: UpAxis,
    meshes: &mut Meshes<'_>,
    warnings: &mut Vec<FileError>,
) -> bool {
    if wanted != UpAxis::Guess {
        return wanted == UpAxis::Respect;
    }
    let of_link = |link: &super::document::UrdfLink| {
        let center = link.center?;
        link.collisions.iter().find_map(|c| center_offsets(c, &center, meshes))
    };
    let all: Vec<[f64; 2]> = urdf.links.iter().filter_map(of_link).collect();
    let [drawn, turned] = all.iter().fold([0.0, 0.0], |sum, [a, b]| [sum[0] + a, sum[1] + b]);
    let counts = all.len() >= MIN_LINKS && turned < MAX_DISTANCE_RATIO * drawn;
    if counts {
        let message =
            "the COLLADA meshes are turned, as they declare y as up: the links' centers of mass are nearer to them so";
        let help =
            "look at the robot with `mobee model view`; if its parts lie wrong, convert it with --up-axis ignore";
        warnings.push(source.warning(urdf.at.clone(), message, help));
    }
    counts
}

/// Rotates a point from y-up to z-up coordinates.
pub(super) fn z_up(v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(v.x, -v.z, v.y)
}

/// Distances of a link's center of mass from the center of its mesh, without and with the rotation, relative to the
/// size of the mesh. `None` without a mesh that declares y as up. Read errors are ignored here; the conversion reports
/// them.
fn center_offsets(collision: &UrdfCollision, center: &Vector3<f64>, meshes: &mut Meshes<'_>) -> Option<[f64; 2]> {
    let UrdfGeometry::Mesh { filename, scale } = &collision.geometry else { return None };
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
