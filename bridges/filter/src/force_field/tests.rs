use super::*;
use mobee_model::{Clause, HalfSpace};
use proptest::prelude::*;

fn settings(n: usize) -> ForceFieldSettings {
    ForceFieldSettings {
        weight: vec![1.0; n],
        spring_const: vec![4.0; n],
        damping_const: vec![4.0; n],
        limit_const: vec![5.0; n],
        rpc_force_const: vec![1.0; n],
        max_spring_force: vec![50.0; n],
        max_limit_force: vec![100.0; n],
        max_constraint_force: vec![100.0; n],
        max_rpc_force: vec![50.0; n],
        constraint_len: 0.0,
    }
}

fn field(settings: ForceFieldSettings, clauses: Vec<Clause>, q: &[f64]) -> ForceField {
    let part = Part { name: "arm".into(), motors: 0..2, root_node: None, clauses };
    let axis = |name: &str| Axis {
        name: name.into(),
        min: (-90.0_f64).to_radians(),
        max: 90.0_f64.to_radians(),
        max_speed: 1.0,
        max_acceleration: 1.0,
        ..Default::default()
    };
    ForceField::new(settings, &part, &[axis("a"), axis("b")], q).unwrap()
}

fn robot() -> Robot {
    mobee_model::load_robot(concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/robots/icub.xml")).unwrap().value
}

fn two_steps(field: &mut ForceField, q: [f64; 2]) -> Option<Vec<f64>> {
    assert_eq!(field.step(&q, 0.02), None, "the first cycle knows no speed");
    field.step(&q, 0.02)
}

#[test]
fn at_its_attractor_there_is_nothing_to_do() {
    assert_eq!(two_steps(&mut field(settings(2), vec![], &[10.0, 20.0]), [10.0, 20.0]), None);
}

#[test]
fn an_attractor_pulls_and_its_pull_is_bounded() {
    let mut f = field(settings(2), vec![], &[0.0, 0.0]);
    f.wish(&Wish::Attractor(vec![0.75]), &robot(), 0, &[]).unwrap();
    let v = two_steps(&mut f, [0.0, 0.0]).unwrap();
    assert!((v[0] - 50.0 * 45.0 / (50.0 / 4.0 + 45.0) * 0.02).abs() < 1e-12);
    assert_eq!(v[1], 0.0);
    f.settle(&[0.0, 0.0]);
    assert_eq!(two_steps(&mut f, [0.0, 0.0]), None, "settled, it wants nothing");
}

#[test]
fn limits_push_back_and_damp() {
    let mut f = field(settings(2), vec![], &[88.0, 0.0]);
    assert_eq!(two_steps(&mut f, [88.0, 0.0]).unwrap()[0], -100.0 * 3.0 / 5.0 * 0.02);
    let v = f.step(&[88.5, 0.0], 0.02).unwrap()[0];
    let a = -100.0 * 3.5 / 5.0 - 50.0 * 0.5 / (50.0 / 4.0 + 0.5) - 4.0 * 25.0;
    assert!((v - (25.0 + a * 0.02)).abs() < 1e-9);
}

#[test]
fn a_constraint_pushes_unless_another_member_of_its_clause_is_well() {
    let half = |a: f64, b: f64| HalfSpace { terms: vec![(0, a), (1, a)], b };
    let mut f = field(settings(2), vec![Clause(vec![half(1.0, 0.0)])], &[5.0, 5.0]);
    let v = two_steps(&mut f, [5.0, 5.0]).unwrap();
    assert!((v[0] - 0.5 * 0.5_f64.sqrt() * 100.0 * 0.02).abs() < 1e-9, "{v:?}");
    let well = Clause(vec![half(1.0, 0.0), half(1.0, 100.0)]);
    assert_eq!(two_steps(&mut field(settings(2), vec![well], &[5.0, 5.0]), [5.0, 5.0]), None);
}

#[test]
fn joints_of_no_weight_rest() {
    let mut f = field(ForceFieldSettings { weight: vec![0.0, 1.0], ..settings(2) }, vec![], &[0.0, 0.0]);
    f.wish(&Wish::Force(vec![3.0, 4.0]), &robot(), 0, &[]).unwrap();
    let v = two_steps(&mut f, [0.0, 0.0]).unwrap();
    assert_eq!(v[0], 0.0);
    assert!((v[1] - 50.0 / (50.0 + 5.0) * 4.0 * 0.02).abs() < 1e-12);
    assert_eq!(f.joints().collect::<Vec<_>>(), [1]);
}

#[test]
fn a_force_at_a_marker_does_the_work_of_its_joints() {
    // virtual work: the force times the marker's motion equals the joint force times the joint's motion
    let robot = robot();
    let q = robot.home();
    for (i, marker) in robot.markers.iter().enumerate() {
        let force = Vector3::new(0.3, -0.2, 0.5);
        let forces = wish::joint_forces(&robot, marker.part, &q, &marker.name, &force, &Vector3::zeros()).unwrap();
        for (k, m) in robot.parts[marker.part].motors.clone().enumerate() {
            let step = if q[m] + 1e-6 <= robot.motors[m].max { 1e-6 } else { -1e-6 };
            let mut moved = q.clone();
            moved[m] += step;
            let way = robot.markers_at(&moved)[i].position() - robot.markers_at(&q)[i].position();
            assert!((way.dot(&force) / step - forces[k]).abs() < 1e-5, "{} {}", marker.name, robot.motors[m].name);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// For all inputs the controller's output is finite, and each cycle adds no more than its bounded forces.
    #[test]
    fn commands_stay_bounded(
        steps in prop::collection::vec((any::<f64>(), -1e3..1e3_f64, -95.0..95.0_f64, -95.0..95.0_f64), 1..30)
    ) {
        let mut f = field(settings(2), vec![], &[0.0, 0.0]);
        let robot = robot();
        for (fraction, force, a, b) in steps {
            if fraction.is_finite() {
                f.wish(&Wish::Attractor(vec![fraction]), &robot, 0, &[]).unwrap();
            }
            f.wish(&Wish::Force(vec![force]), &robot, 0, &[]).unwrap();
            f.step(&[a, b], 0.02);
            for v in f.step(&[a, b], 0.02).unwrap_or_default() {
                prop_assert!(v.is_finite() && v.abs() <= (50.0 + 200.0 + 50.0) * 0.02 + 1e-9);
            }
        }
    }
}
