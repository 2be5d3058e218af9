//! Promise: fitted shapes contain the complete mesh, and are as near to it as reported.

use mobee_import::{FitOptions, Fitted, fit_link};

use mobee_model::{Mesh, Primitive, Shape};
use nalgebra::{Isometry3, Point3, Vector3};
use parry3d_f64::math::Vector;
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::ConvexPolyhedron;
use parry3d_f64::transformation::try_convex_hull;
use proptest::prelude::*;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::PI;

fn mesh(vertices: Vec<Vector3<f64>>, triangles: Vec<[u32; 3]>) -> Mesh {
    Mesh { vertices, triangles }
}

/// Distance of a point outside the shape: exact on its faces and axes, a lower bound elsewhere.
fn outside(primitive: &Primitive, point: &Vector3<f64>) -> f64 {
    let p = primitive.pose.inverse_transform_point(&(*point).into()).coords;
    match primitive.shape {
        Shape::Sphere { radius } => p.norm() - radius,
        Shape::Box { size } => (p.abs() - size / 2.0).max(),
        Shape::Cylinder { radius, height } => (p.xz().norm() - radius).max(p.y.abs() - height / 2.0),
        Shape::Capsule { radius, height } => {
            let nearest = Vector3::new(0.0, p.y.clamp(-height / 2.0, height / 2.0), 0.0);
            (p - nearest).norm() - radius
        }
    }
}

/// Random points on all triangles, edges and corners are inside at least one primitive.
fn holds(fitted: &Fitted, mesh: &Mesh) -> Result<(), String> {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|i| mesh.vertices[i as usize]);
        for k in 0..12 {
            let (u, v): (f64, f64) = (random.random(), random.random());
            let (u, v) = match k {
                0 => (0.0, 0.0),
                1 => (1.0, 0.0),
                2 => (0.0, 1.0),
                3 => (u, 0.0),
                _ if u + v > 1.0 => (1.0 - u, 1.0 - v),
                _ => (u, v),
            };
            let p = a + (b - a) * u + (c - a) * v;
            let out = fitted.primitives.iter().map(|f| outside(f, &p)).fold(f64::INFINITY, f64::min);
            if out.is_nan() || out > 0.0 {
                return Err(format!("{p} is {out} m outside of {fitted:?}"));
            }
        }
    }
    Ok(())
}

/// Points on the surface of a primitive.
fn surface(primitive: &Primitive, count: usize) -> Vec<Vector3<f64>> {
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let mut any = || Vector3::from_fn(|_, _| random.random_range(-1.0..1.0));
    let reach = primitive.shape.bounding_radius() * 2.0;
    let point = |direction: Vector3<f64>| {
        // From the center outward, to the surface of the convex shape.
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..50 {
            let middle = (low + high) / 2.0;
            let at = primitive.pose * Point3::from(direction * (reach * middle));
            if outside(primitive, &at.coords) <= 0.0 { low = middle } else { high = middle }
        }
        (primitive.pose * Point3::from(direction * (reach * low))).coords
    };
    (0..count).map(|_| point(any().try_normalize(1e-6).unwrap_or(Vector3::x()))).collect()
}

/// A convex mesh around points, unless they are flat.
fn hull(points: &[Vector3<f64>]) -> Option<(Mesh, ConvexPolyhedron)> {
    let points: Vec<Vector> = points.iter().map(|p| Vector::new(p.x, p.y, p.z)).collect();
    let (vertices, triangles) = try_convex_hull(&points).ok()?;
    let solid = ConvexPolyhedron::from_convex_mesh(vertices.clone(), &triangles)?;
    Some((mesh(vertices.iter().map(|v| Vector3::new(v.x, v.y, v.z)).collect(), triangles), solid))
}

/// A tube along z; with lids both ends are closed by triangles to the center of the rim.
fn tube(radius: f64, length: f64, lids: bool, around: u32) -> Mesh {
    let mut vertices: Vec<Vector3<f64>> = Vec::new();
    for z in [0.0, length] {
        vertices.extend((0..around).map(|i| {
            let (sin, cos) = (f64::from(i) / f64::from(around) * 2.0 * PI).sin_cos();
            Vector3::new(radius * cos, radius * sin, z)
        }));
    }
    vertices.extend([Vector3::zeros(), Vector3::new(0.0, 0.0, length)]);
    let mut triangles = Vec::new();
    for i in 0..around {
        let (a, b) = (i, (i + 1) % around);
        triangles.extend([[a, b, a + around], [b, b + around, a + around]]);
        if lids {
            triangles.extend([[a, b, 2 * around], [a + around, b + around, 2 * around + 1]]);
        }
    }
    mesh(vertices, triangles)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    /// Unordered triangles, some of them flat, collapsed or duplicate.
    #[test]
    fn every_point_of_every_triangle_is_inside(
        points in prop::collection::vec(prop::array::uniform3(-0.2..0.2), 1..20),
        corners in prop::collection::vec(prop::array::uniform3(0_u32..20), 1..30),
        flat in prop::array::uniform3(prop::bool::weighted(0.2)),
        far in prop_oneof![Just(0.0), Just(9e3)],
    ) {
        let count = points.len() as u32;
        let place = |p: [f64; 3]| Vector3::from_fn(|i, _| if flat[i] { far } else { p[i] + far });
        let mesh = mesh(points.into_iter().map(place).collect(), corners.iter().map(|t| t.map(|i| i % count)).collect());
        let fitted = fit_link(std::slice::from_ref(&mesh), &FitOptions { overshoot: 0.03, primitives: 4 }).unwrap();
        prop_assert!(fitted.primitives.len() <= 4);
        holds(&fitted, &mesh).map_err(TestCaseError::fail)?;
    }

    /// For a convex mesh the distance from it can be computed independently.
    #[test]
    fn the_stated_overshoot_is_true(points in prop::collection::vec(prop::array::uniform3(-0.15..0.15), 6..30)) {
        let points: Vec<Vector3<f64>> = points.into_iter().map(Vector3::from).collect();
        let Some((mesh, solid)) = hull(&points) else { return Ok(()) };
        let fitted = fit_link(std::slice::from_ref(&mesh), &FitOptions { overshoot: 0.02, primitives: 3 }).unwrap();
        holds(&fitted, &mesh).map_err(TestCaseError::fail)?;
        let far = |p: &Vector3<f64>| solid.distance_to_local_point(Vector::new(p.x, p.y, p.z), true);
        let points: Vec<f64> = fitted.primitives.iter().flat_map(|p| surface(p, 400)).map(|p| far(&p)).collect();
        let found = points.into_iter().fold(0.0, f64::max);
        // Both are measured at samples, but at different ones.
        prop_assert!(found <= fitted.overshoot + 0.004, "{found} m, stated {} m", fitted.overshoot);
    }
}

#[test]
fn one_shape_is_enough_for_a_tube_with_or_without_ends() {
    for lids in [true, false] {
        let mesh = tube(0.05, 0.4, lids, 24);
        let fitted = fit_link(std::slice::from_ref(&mesh), &FitOptions::default()).unwrap();
        assert_eq!(fitted.primitives.len(), 1, "{lids}: {fitted:?}");
        assert!(fitted.overshoot < 0.01, "{fitted:?}");
        holds(&fitted, &mesh).unwrap();
    }
}

/// An L of two tubes in two meshes: a single shape around it would extend far beyond the corner.
#[test]
fn a_bent_link_gets_shapes_near_it() {
    let upright = tube(0.04, 0.3, true, 16);
    let turn = Isometry3::rotation(Vector3::x() * (PI / 2.0));
    let mut lying = upright.clone();
    lying.vertices.iter_mut().for_each(|v| *v = turn * *v);
    let meshes = [upright, lying];
    let fitted = fit_link(&meshes, &FitOptions::default()).unwrap();
    assert!(fitted.overshoot <= 0.01, "{fitted:?}");
    assert!(fitted.primitives.len() <= 4, "{fitted:?}");
    meshes.iter().for_each(|m| holds(&fitted, m).unwrap());
    assert_eq!(fitted, fit_link(&meshes, &FitOptions::default()).unwrap(), "equal meshes, equal shapes");
}

#[test]
fn what_cannot_be_met_is_told() {
    let points: Vec<Vector3<f64>> = (0..3).map(|i| Vector3::ith(i, 0.5)).collect();
    let spikes = [Vector3::zeros(), points[0], points[1], points[2]].to_vec();
    let spikes = mesh(spikes, vec![[0, 0, 1], [0, 0, 2], [0, 0, 3]]);
    let one = FitOptions { overshoot: 0.01, primitives: 1 };
    let fitted = fit_link(std::slice::from_ref(&spikes), &one).unwrap();
    assert_eq!(fitted.primitives.len(), 1);
    assert!(fitted.overshoot > 0.1, "{fitted:?}");
    holds(&fitted, &spikes).unwrap();
    let fitted = fit_link(&[spikes], &FitOptions::default()).unwrap();
    assert!(fitted.overshoot < 0.03, "{fitted:?}");
}

#[test]
fn meshes_that_are_none_are_refused() {
    let corners = || vec![Vector3::zeros(), Vector3::x(), Vector3::y()];
    let why = |mesh: Mesh| fit_link(&[mesh], &FitOptions::default()).unwrap_err();
    assert_eq!(fit_link(&[], &FitOptions::default()).unwrap_err(), "has no triangles");
    assert_eq!(why(mesh(corners(), Vec::new())), "has no triangles");
    assert!(why(mesh(corners(), vec![[0, 1, 3]])).contains("not there"));
    for bad in [f64::NAN, f64::INFINITY, 1e5] {
        let mut corners = corners();
        corners[1].y = bad;
        assert!(why(mesh(corners, vec![[0, 1, 2]])).contains("not finite or beyond"));
    }
}

/// Flat, straight and point-like meshes get a thickness that the engine can handle.
#[test]
fn thin_meshes_get_a_thickness() {
    let line = vec![Vector3::zeros(), Vector3::x() * 0.1, Vector3::x() * 0.2];
    let sheet = vec![Vector3::zeros(), Vector3::x() * 0.1, Vector3::y() * 0.2];
    for vertices in [vec![Vector3::repeat(7.0); 3], line, sheet] {
        let mesh = mesh(vertices, vec![[0, 1, 2]; 3]);
        let fitted = fit_link(std::slice::from_ref(&mesh), &FitOptions::default()).unwrap();
        holds(&fitted, &mesh).unwrap();
        for p in &fitted.primitives {
            assert!(p.shape.bounding_radius() >= 0.4e-3, "{p:?}");
        }
    }
}

/// More triangles than the limit are rounded, and still all contained.
#[test]
fn a_very_fine_mesh_is_held_too() {
    let fine = tube(0.05, 0.3, true, 40_000);
    let fitted = fit_link(std::slice::from_ref(&fine), &FitOptions::default()).unwrap();
    assert!(fitted.overshoot < 0.015, "{fitted:?}");
    holds(&fitted, &fine).unwrap();
}
