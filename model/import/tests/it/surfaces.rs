//! Contact by meshes: intersecting surfaces touch; separate or enclosed ones do not.

use mobee_import::{LinkSurface, Surfaces, UrdfOptions, load_urdf};

use mobee_model::{Mesh, Primitive, Robot, Shape, distance, random_poses};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use std::path::PathBuf;

fn arm() -> Robot {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/bent_arm.urdf");
    load_urdf(path, &UrdfOptions::default()).unwrap().value
}

/// The surface of a box.
fn crate_of(size: Vector3<f64>) -> Mesh {
    let corner = |i: usize| Vector3::from_fn(|k, _| size[k] * if i >> k & 1 == 1 { 0.5 } else { -0.5 });
    let faces = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    let triangles = faces.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    Mesh { vertices: (0..8).map(corner).collect(), triangles }
}

/// Distance that counts as near, meters.
const NEAR: f64 = 0.05;

/// Two links of the arm with a box each, as mesh or as solid.
fn boxes(meshes: [bool; 2], sizes: [Vector3<f64>; 2]) -> Surfaces {
    let link = |i: usize, link: &str| {
        let solid = Primitive { shape: Shape::Box { size: sizes[i] }, pose: Isometry3::identity() };
        let (mesh, solids) = if meshes[i] { (Some(crate_of(sizes[i])), Vec::new()) } else { (None, vec![solid]) };
        let turn = UnitQuaternion::from_euler_angles(0.3, i as f64, -0.2);
        LinkSurface { link: link.to_owned(), turn, meshes: mesh.into_iter().collect(), solids }
    };
    Surfaces::new(&arm(), &[link(0, "upper"), link(1, "hand")]).unwrap()
}

/// Boxes too large to be inside each other: their surfaces intersect if they do.
#[test]
fn meshes_and_solids_meet_and_are_near_where_the_boxes_are() {
    let sizes = [Vector3::new(0.15, 0.2, 0.4), Vector3::new(0.5, 0.1, 0.12)];
    let robot = arm();
    for meshes in [[true, true], [true, false], [false, true], [false, false]] {
        let surfaces = boxes(meshes, sizes);
        let (mut met, mut near, mut apart) = (0, 0, 0);
        for q in random_poses(&robot, 4).take(2000) {
            let frames = surfaces.frames(&robot, &q);
            let [a, b] = sizes.map(|size| Shape::Box { size });
            let expected = distance(&a, &frames[0], &b, &frames[1]).distance;
            // Within rounding of touching either result is accepted.
            if expected.abs() > 1e-6 {
                assert_eq!(surfaces.meet(&frames, 0, 1), expected < 0.0, "{meshes:?}: {expected} m");
                assert_eq!(surfaces.meet(&frames, 1, 0), expected < 0.0, "{meshes:?}: {expected} m");
            }
            // For intersecting boxes only meshes have a distance between their surfaces.
            if expected > 1e-6 && (expected - NEAR).abs() > 1e-6 {
                assert_eq!(surfaces.near(&frames, (0, 1), NEAR), expected < NEAR, "{meshes:?}: {expected} m");
            }
            met += usize::from(expected < 0.0);
            near += usize::from((0.0..NEAR).contains(&expected));
            apart += usize::from(expected > 0.0);
        }
        assert!(met > 100 && near > 50 && apart > 100, "{met} met, {near} near, {apart} apart");
    }
}

/// The inside of a surface is empty, a solid is filled.
#[test]
fn what_is_within_a_mesh_does_not_meet_it() {
    let sizes = [Vector3::repeat(2.0), Vector3::repeat(0.1)];
    let robot = arm();
    for (meshes, expected) in [([true, true], false), ([true, false], false), ([false, true], true)] {
        let surfaces = boxes(meshes, sizes);
        let frames = [Isometry3::identity(), Isometry3::translation(0.3, 0.2, 0.1)];
        assert_eq!(surfaces.meet(&frames, 0, 1), expected, "{meshes:?}");
        assert_eq!(surfaces.links().collect::<Vec<_>>(), ["upper", "hand"]);
        assert_eq!(surfaces.frames(&robot, &[0.0; 5]).len(), 2);
    }
}

/// Flat faces in one plane, and slightly apart.
#[test]
fn triangles_in_one_plane_meet_where_they_overlap() {
    let sheet = Mesh { vertices: vec![Vector3::zeros(), Vector3::x(), Vector3::y()], triangles: vec![[0, 1, 2]] };
    let link = |name: &str| LinkSurface { link: name.to_owned(), meshes: vec![sheet.clone()], ..Default::default() };
    let surfaces = Surfaces::new(&arm(), &[link("upper"), link("hand")]).unwrap();
    let meet = |x: f64, z: f64| surfaces.meet(&[Isometry3::identity(), Isometry3::translation(x, 0.0, z)], 0, 1);
    assert!(meet(0.5, 0.0) && meet(1.0, 0.0));
    assert!(!meet(1.001, 0.0) && !meet(0.5, 1e-9));
}

#[test]
fn poses_are_within_the_limits_and_equal_for_equal_seeds() {
    let robot = arm();
    let poses: Vec<Vec<f64>> = random_poses(&robot, 1).take(50).collect();
    assert_eq!(poses, random_poses(&robot, 1).take(50).collect::<Vec<_>>());
    assert_ne!(poses, random_poses(&robot, 2).take(50).collect::<Vec<_>>());
    let within = |q: &Vec<f64>| q.iter().zip(&robot.motors).all(|(q, m)| (m.min..=m.max).contains(q));
    assert!(poses.iter().all(within));
}

#[test]
fn links_and_meshes_that_are_none_are_refused() {
    let named = |link: &str| LinkSurface { link: link.to_owned(), ..Default::default() };
    let why = |link: LinkSurface| Surfaces::new(&arm(), &[link]).err().unwrap();
    assert!(why(named("nobody")).contains("`nobody` is not in the robot"));
    let broken = Mesh { vertices: vec![Vector3::zeros()], triangles: vec![[0, 0, 1]] };
    assert!(why(LinkSurface { meshes: vec![broken], ..named("hand") }).contains("link `hand`"));
}
