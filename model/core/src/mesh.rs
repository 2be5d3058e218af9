//! Triangle meshes, as a URDF's collision geometry names them.

use nalgebra::Vector3;

/// A triangle mesh: a surface, not necessarily closed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// The corners of the triangles, meters.
    pub vertices: Vec<Vector3<f64>>,
    /// Each triangle as three indices into `vertices`.
    pub triangles: Vec<[u32; 3]>,
}
