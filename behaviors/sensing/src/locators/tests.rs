//! Heads and lenses, and the derivatives of their projections.

use super::head::{HeadKind, JointAngles};
use super::lens::Lens;
use super::model::HeadModel;
use super::parameters::{PlaceFrame, WARPED, Warp};
use nalgebra::{Matrix3, Rotation3, Vector2, Vector3, Vector4};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

#[test]
fn eyes_are_where_the_drawings_have_them() {
    for (kind, x, z) in [(HeadKind::V1, -0.06281, 0.3408), (HeadKind::V2, -0.061709, 0.346347)] {
        for (eye, y) in kind.eyes(&[0.0; 9]).into_iter().zip([-0.034, 0.034]) {
            assert!((eye.center - Vector3::new(x, y, z)).norm() < 1e-3, "{kind:?} {}", eye.center);
            // The optical axis points along -x of the root, right is +y, down is -z.
            let axes = Matrix3::new(0.0, 0.0, -1.0, 1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
            assert!((eye.root_from_camera - axes).norm() < 1e-12);
        }
    }
}

#[test]
fn tilt_looks_up_version_looks_right_and_vergence_turns_the_eyes_to_each_other() {
    let axis = |joint: usize, eye: usize| {
        let mut q = [0.0; 9];
        q[joint] = 0.1;
        HeadKind::V1.eyes(&q)[eye].root_from_camera.column(2).into_owned()
    };
    assert!(axis(6, 0).z > 0.09 && axis(6, 1).z > 0.09);
    assert!(axis(7, 0).y > 0.09 && axis(7, 1).y > 0.09);
    assert!((axis(8, 0).y - 0.05).abs() < 1e-3 && (axis(8, 1).y + 0.05).abs() < 1e-3);
}

#[test]
fn a_ray_goes_to_what_the_lens_projects() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let [mut lens, _] = Lens::icub();
    lens.distortion[2..].copy_from_slice(&[0.003, -0.002]);
    for _ in 0..200 {
        let pixel = Vector2::new(rng.random_range(0.0..640.0), rng.random_range(0.0..480.0));
        let (back, by) = lens.project(&(lens.ray(&pixel) * 0.7)).expect("before the camera");
        assert!((back - pixel).norm() < 1e-6, "{pixel} {back}");
        let point = lens.ray(&pixel) * 0.7;
        for i in 0..3 {
            let step = Vector3::from_fn(|k, _| if k == i { 1e-6 } else { 0.0 });
            let moved = lens.project(&(point + step)).expect("seen").0 - lens.project(&(point - step)).expect("seen").0;
            assert!((moved / 2e-6 - by.column(i)).norm() < 1e-3 * by.norm());
        }
    }
    assert!(lens.project(&Vector3::new(0.1, 0.1, -1.0)).is_none());
}

/// Creates a model in which every parameter is off.
fn strange(rng: &mut ChaCha8Rng) -> HeadModel {
    let frame = PlaceFrame {
        rotation: Rotation3::from_euler_angles(0.1, -0.05, 0.2).into_inner(),
        origin: Vector3::new(-0.9, -0.03, 0.1),
    };
    let mut model = HeadModel::nominal(HeadKind::V1, Lens::icub(), frame);
    model.warp = Some(Warp { center: Vector3::new(0.3, 0.0, -0.1), spread: Vector3::new(0.1, 0.2, 0.15) });
    model.theta = (0..WARPED).map(|_| rng.random_range(-0.02..0.02)).collect();
    model
}

#[test]
fn what_is_seen_moves_with_place_joints_and_parameters_as_is_told() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let model = strange(&mut rng);
    for _ in 0..20 {
        let q: JointAngles = std::array::from_fn(|_| rng.random_range(-0.15..0.15));
        let toward: JointAngles = std::array::from_fn(|_| rng.random_range(-0.05..0.05));
        let place = Vector3::new(rng.random_range(0.2..0.5), rng.random_range(-0.1..0.1), rng.random_range(-0.1..0.2));
        let looking = model.look(&q, &toward);
        let see = |m: &HeadModel, q: &JointAngles, p: &Vector3<f64>| m.look(q, &toward).see(p).expect("seen").pixels;
        let told = looking.see(&place).expect("seen").by_place;
        for i in 0..3 {
            let step = Vector3::from_fn(|k, _| if k == i { 1e-6 } else { 0.0 });
            let moved: Vector4<f64> = (see(&model, &q, &(place + step)) - see(&model, &q, &(place - step))) / 2e-6;
            assert!((moved - told.column(i)).norm() < 1e-4 * told.norm());
        }
        let told = looking.by_theta(&place).expect("seen");
        let most = told.iter().map(|t| t.norm()).fold(0.0, f64::max);
        for (i, told) in told.iter().enumerate() {
            let moved = |step: f64| {
                let mut other = model.clone();
                other.theta[i] += step;
                see(&other, &q, &place)
            };
            let moved = (moved(1e-6) - moved(-1e-6)) / 2e-6;
            assert!((moved - told).norm() < 1e-5 * most + 1e-3, "parameter {i}: {moved} {told}");
        }
    }
}

#[test]
fn rays_meet_where_the_object_is() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut model = strange(&mut rng);
    model.warp = None;
    model.theta.truncate(super::parameters::RIGID);
    for _ in 0..50 {
        let q: JointAngles = std::array::from_fn(|_| rng.random_range(-0.15..0.15));
        let place = Vector3::new(rng.random_range(0.2..0.5), rng.random_range(-0.1..0.1), rng.random_range(-0.1..0.2));
        let looking = model.look(&q, &[0.0; 9]);
        let pixels = looking.see(&place).expect("seen").pixels;
        let met = looking.midpoint(&pixels).expect("they meet");
        assert!((met - place).norm() < 1e-6, "{met} {place}");
    }
}
