//! The meshes of a robot's links, each on the entity of its link, so that it moves with the shapes around it.

use crate::body::{Body, entity};
use crate::palette;
use crate::shapes::vec3;
use crate::stream::{Stream, Written};
use mobee_model::{LinkSurface, Mesh, Robot};
use nalgebra::{Isometry3, Translation3, Vector3};
use rerun::Mesh3D;
use rerun::components::AlbedoFactor;

/// The node that each link with meshes hangs on.
///
/// # Errors
/// The name of a link that is not in the robot.
pub(super) fn nodes<'a>(robot: &Robot, links: &'a [LinkSurface]) -> Result<Vec<(usize, &'a LinkSurface)>, String> {
    let node = |l: &'a LinkSurface| Ok((robot.marker(&l.link).ok_or_else(|| l.link.clone())?.node, l));
    links.iter().filter(|l| !l.meshes.is_empty()).map(node).collect()
}

/// Writes them, once for all times.
pub(super) fn write(stream: &Stream, body: &Body, links: &[(usize, &LinkSurface)]) -> Written {
    for (node, link) in links {
        let Some(seat) = body.seats.get(*node) else { continue };
        let place = Translation3::from(seat.offset) * link.turn;
        for (i, mesh) in link.meshes.iter().enumerate() {
            let path = format!("{}/mesh_{}_{i}", seat.entity, entity(&link.link));
            stream.log_static(&path, &triangles(mesh, &place))?;
        }
    }
    Ok(())
}

/// A mesh as Rerun takes it, with the normals that it needs to be lit.
fn triangles(mesh: &Mesh, place: &Isometry3<f64>) -> Mesh3D {
    let corners: Vec<Vector3<f64>> = mesh.vertices.iter().map(|v| place.transform_point(&(*v).into()).coords).collect();
    let normals = normals(&corners, &mesh.triangles);
    Mesh3D::new(corners.iter().map(vec3))
        .with_triangle_indices(mesh.triangles.iter().copied())
        .with_vertex_normals(normals.iter().map(vec3))
        .with_albedo_factor(AlbedoFactor(palette::MESH.into()))
}

/// At each corner the mean of the triangles there, by their areas.
fn normals(corners: &[Vector3<f64>], triangles: &[[u32; 3]]) -> Vec<Vector3<f64>> {
    let mut normals = vec![Vector3::zeros(); corners.len()];
    for triangle in triangles {
        let [Some(a), Some(b), Some(c)] = triangle.map(|i| corners.get(i as usize)) else { continue };
        let normal = (b - a).cross(&(c - a));
        for i in triangle {
            if let Some(n) = normals.get_mut(*i as usize) {
                *n += normal;
            }
        }
    }
    normals.into_iter().map(|n| n.try_normalize(0.0).unwrap_or_else(Vector3::z)).collect()
}
