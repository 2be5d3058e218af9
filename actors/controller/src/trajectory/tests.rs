//! Under any forces the reference stays within its limits; without forces it reaches its target.

use super::*;
use crate::{ControllerSettings, Drive, FieldsSettings};
use mobee_contract::{Axis, Board};
use mobee_model::{Clause, HalfSpace, NodePairs, Part, Robot};
use proptest::prelude::*;
use std::sync::Arc;

const SECS: f64 = 0.02;

/// Three motors in two parts; the sum of the two motors of the first part must stay below 2 rad.
fn rules(settings: FieldsSettings) -> (Rules, Arc<FieldRules>) {
    let axis = |name: &str, max_speed: f64| {
        let max_acceleration = 2.0 * max_speed;
        Axis { name: name.into(), min: -1.5, max: 1.5, max_speed, max_acceleration, ..Default::default() }
    };
    let board = Board {
        axes: vec![axis("a", 1.7), axis("b", 1.0), axis("c", 3.0)],
        period: Duration::from_millis(10),
        latency: Duration::ZERO,
        position_direct: true,
    };
    let clause = Clause(vec![HalfSpace { terms: vec![(0, -1.0), (1, -1.0)], b: 2.0_f64.to_degrees() }]);
    let part = |name: &str, motors, clauses| Part { name: name.into(), motors, root_node: None, clauses };
    let parts = vec![part("p", 0..2, vec![clause]), part("q", 2..3, Vec::new())];
    let (markers, pairs) = (Vec::new(), NodePairs::default());
    let robot = Robot {
        name: "r".into(),
        parts,
        motors: Vec::new(),
        nodes: Vec::new(),
        markers,
        pairs,
        left_out: None,
        near: Vec::new(),
        bare: Vec::new(),
    };
    let drive = Drive::Fields(settings);
    let settings = ControllerSettings { drive, ..ControllerSettings::default() };
    let rules = Rules::new("r", vec![], &settings, &board).driving(&settings, &robot);
    let fields = rules.fields.clone().unwrap();
    (rules, fields)
}

fn all(rules: &Rules, speed: f64) -> Vec<(usize, f64)> {
    rules.axes.iter().map(|a| speed * a.max_speed).enumerate().collect()
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(300) })]

    #[test]
    fn limits_of_position_speed_and_acceleration_hold_whatever_pushes(
        start in prop::array::uniform3(-1.5..1.5_f64),
        target in prop::array::uniform3(-1.5..1.5_f64),
        speed in 0.01..1.0_f64,
        steps in prop::collection::vec((prop::array::uniform3(-0.05..0.05_f64), any::<f64>(), -0.3..0.3_f64), 1..100),
    ) {
        let (rules, fields) = rules(FieldsSettings::default());
        let mut course = ReferenceTrajectory::new(&start);
        course.aim(&fields, &target.as_slice().into(), &all(&rules, speed));
        for (mut torques, odd, behind) in steps {
            torques[0] = if odd.is_finite() { torques[0] } else { odd };
            let before = (course.q.clone(), course.v.clone());
            let here: Vec<f64> = course.q.iter().map(|q| (q + behind).clamp(-1.5, 1.5)).collect();
            course.step(&here, &torques, &rules, SECS);
            for (m, axis) in rules.axes.iter().enumerate() {
                let (q, step) = (course.q[m], (course.q[m] - before.0[m]).abs());
                prop_assert!((axis.min..=axis.max).contains(&q), "motor {m} at {q}");
                prop_assert!(step <= axis.max_speed * SECS * (1.0 + 1e-9), "motor {m} by {step}");
            }
        }
    }

    #[test]
    fn with_nothing_near_the_target_is_reached_on_time(
        start in prop::array::uniform3(-1.0..1.0_f64),
        target in prop::array::uniform3(-1.0..1.0_f64),
        speed in 0.05..1.0_f64,
        lag in 0.0..0.02_f64,
    ) {
        let (rules, fields) = rules(FieldsSettings::default());
        let mut course = ReferenceTrajectory::new(&start);
        course.aim(&fields, &target.as_slice().into(), &all(&rules, speed));
        let straight = start.iter().zip(&target).zip(rules.axes.iter()).map(|((s, t), a)| (s - t).abs() / (a.max_speed * speed));
        let straight = straight.fold(0.0, f64::max);
        let mut secs = 0.0;
        while !course.is_there() {
            let here: Vec<f64> = course.q.iter().map(|q| q - lag).collect();
            course.step(&here, &[], &rules, SECS);
            secs += SECS;
            prop_assert!(secs < 2.0 * straight + 8.0, "{secs} s for {straight}: {:?} to {target:?}", course.q);
        }
    }

    /// The law itself avoids a violation, on the way between valid configurations.
    #[test]
    fn constraints_hold_on_the_way(a in -0.5..0.8_f64, b in -0.5..0.8_f64, c in -0.5..0.8_f64, d in -0.5..0.8_f64) {
        let (rules, fields) = rules(FieldsSettings::default());
        let mut course = ReferenceTrajectory::new(&[a, b, 0.0]);
        course.aim(&fields, &[c, d, 0.3].as_slice().into(), &all(&rules, 0.5));
        for _ in 0..1000 {
            let here = course.q.clone();
            course.step(&here, &[], &rules, SECS);
            prop_assert!(course.q[0] + course.q[1] < 2.0, "{:?}", course.q);
        }
        prop_assert!(course.is_there());
    }
}

#[test]
fn motors_that_are_not_named_stay_even_under_forces() {
    let (rules, fields) = rules(FieldsSettings::default());
    let mut course = ReferenceTrajectory::new(&[0.0, 0.0, 0.0]);
    course.aim(&fields, &[0.5, 0.0, 0.0].as_slice().into(), &[(0, 0.5)]);
    for _ in 0..500 {
        let here = course.q.clone();
        course.step(&here, &[0.0, 0.01, 0.01], &rules, SECS);
    }
    assert_eq!(course.q(), [0.5, 0.0, 0.0]);
    assert_eq!(course.motors(), [0]);
}

#[test]
fn a_push_that_outdoes_the_attractor_turns_the_motion_back() {
    let (rules, fields) = rules(FieldsSettings::default());
    let mut course = ReferenceTrajectory::new(&[0.0, 0.0, 0.0]);
    course.aim(&fields, &[1.0, 0.0, 0.0].as_slice().into(), &[(0, 0.5)]);
    for _ in 0..1000 {
        let here = course.q.clone();
        // a wall at 0.5 rad, with a field of 0.05 m at a lever of 0.5 m
        let depth = (0.5 * here[0] - 0.2).max(0.0);
        course.step(&here, &[-0.5 * depth, 0.0, 0.0], &rules, SECS);
    }
    assert!(course.q[0] > 0.35 && course.q[0] < 0.45, "{:?}", course.q);
    assert!(course.v[0].abs() < 1e-6, "at rest where the forces balance: {:?}", course.v);
}
