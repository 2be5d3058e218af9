//! Shapes of a scene and where they are, for `mobee._show`.

use crate::arrays::{Rows, array, reserved};
use crate::scene::PyScene;
use mobee_model::Shape;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use numpy::PyArrayDyn;
use pyo3::prelude::*;
use std::f64::consts::FRAC_PI_2;

/// Numbers of a pose: position, and quaternion x, y, z, w.
const POSE: usize = 7;

/// Name, kind and sizes of a shape: half the edges of a box; radius and length of the others, zero for a sphere.
type DrawnShape = (String, &'static str, [f64; 3]);

/// The solid shapes of a scene: those of the robots, then those of the obstacles; cylinders and capsules are along z.
#[pyfunction]
pub(crate) fn shapes_of(scene: &Bound<'_, PyScene>) -> Vec<DrawnShape> {
    let scene = &scene.get().scene;
    let name = |i: usize| u32::try_from(i).ok().and_then(|i| scene.shape_id(i)).map(|id| scene.shape_name(id));
    let of = |(i, shape): (usize, &Shape)| {
        let (kind, sizes) = match *shape {
            Shape::Sphere { radius } => ("sphere", [radius, 0.0, 0.0]),
            Shape::Cylinder { radius, height } => ("cylinder", [radius, height, 0.0]),
            Shape::Capsule { radius, height } => ("capsule", [radius, height, 0.0]),
            Shape::Box { size } => ("box", (size / 2.0).into()),
        };
        (name(i).unwrap_or_default(), kind, sizes)
    };
    scene.colliders().map(|collider| &collider.shape).enumerate().map(of).collect()
}

/// Poses of these shapes, ``world_from_shape``: array (N, shapes, 7) of position (m) and quaternion x, y, z, w.
#[pyfunction]
pub(crate) fn shape_poses<'py>(
    py: Python<'py>,
    scene: &Bound<'py, PyScene>,
    q: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let shown = scene.get();
    let rows = Rows::configurations("q", q, &shown.joints)?;
    let shapes = shown.scene.colliders().len();
    let mut all: Vec<f64> = reserved(rows.rows, shapes * POSE)?;
    let mut of_rows: Vec<Vec<f64>> = Vec::new();
    let y_from_z = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -FRAC_PI_2);
    shown.each_row(py, &rows, &mut of_rows, |poses| {
        let mut frames: Vec<Isometry3<f64>> = Vec::new();
        for (skeleton, pose) in shown.scene.skeletons().iter().zip(poses) {
            skeleton.place(pose, &mut frames);
        }
        frames.push(Isometry3::identity());
        let mut numbers = Vec::with_capacity(shapes * POSE);
        for collider in shown.scene.colliders() {
            let turned = match collider.shape {
                Shape::Cylinder { .. } | Shape::Capsule { .. } => y_from_z,
                Shape::Sphere { .. } | Shape::Box { .. } => UnitQuaternion::identity(),
            };
            let pose = frames.get(collider.frame).copied().unwrap_or_default() * collider.pose * turned;
            numbers.extend(pose.translation.vector.iter().chain(pose.rotation.coords.iter()));
        }
        Ok(numbers)
    })?;
    let shape = [of_rows.len(), shapes, POSE];
    all.extend(of_rows.into_iter().flatten());
    array(py, all, &shape)
}
