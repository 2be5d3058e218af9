//! Triangle meshes for the viewer.

use crate::shapes::vec3;
use mobee_model::Mesh;
use nalgebra::{Isometry3, Vector3};
use rerun::Mesh3D;

/// Converts a mesh for Rerun, with the normals that lighting needs.
pub(crate) fn mesh3d(mesh: &Mesh, place: &Isometry3<f64>) -> Mesh3D {
    let corners: Vec<Vector3<f64>> = mesh.vertices.iter().map(|v| place.transform_point(&(*v).into()).coords).collect();
    let normals = normals(&corners, &mesh.triangles);
    Mesh3D::new(corners.iter().map(vec3))
        .with_triangle_indices(mesh.triangles.iter().copied())
        .with_vertex_normals(normals.iter().map(vec3))
}

/// Normal at each corner: the mean of its triangles' normals, weighted by their areas.
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
