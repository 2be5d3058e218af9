//! The map of a table: every pose satisfies the rule of acceptance, positions are covered without
//! gaps, and an interrupted build ends like an uninterrupted one.

use mobee_model::*;
use mobee_planning::table_map::*;
use nalgebra::Isometry3;
use std::sync::Arc;

const MARKER: &str = "r_hand_dh_frame";

fn scene() -> Arc<Scene> {
    let robot = Arc::new(load_robot("../../configs/robots/icub.xml").unwrap().value);
    let objects = load_world("../../configs/worlds/table.xml").unwrap().value;
    Arc::new(Scene::new(vec![(robot, Isometry3::identity())], objects).unwrap())
}

fn settings(vertices: u32) -> TableMapSettings {
    let arm = ["pitch", "roll", "yaw"].map(|j| format!("r_shoulder_{j}"));
    let hand = ["r_elbow", "r_wrist_prosup", "r_wrist_pitch", "r_wrist_yaw"].map(String::from);
    TableMapSettings {
        seed: 1,
        robot: "icub.xml".into(),
        world: None,
        motors: std::iter::once("torso".to_owned()).chain(arm).chain(hand).collect(),
        hand: Some(MARKER.into()),
        palm: None,
        table: TableArea { height_m: -0.15, x_m: [-0.8, 0.5], y_m: [-0.7, 0.9] },
        offset_mm: 80.0,
        spacing_mm: 10.0,
        vertices,
        neighbors: 8,
        clearance_mm: 12.0,
    }
}

/// Builds until this number of trials, after replaying the existing ones.
fn build(plan: &Arc<TableMapPlan>, scene: &Scene, told: &[Trial], most: usize) -> (Growth, Vec<Trial>) {
    let mut search = PoseSearch::new(scene, Arc::clone(plan)).unwrap();
    let mut growth = Growth::new(plan, &scene.robots()[0].home());
    let mut trials = Vec::new();
    while let Some(wish) = growth.next().filter(|_| trials.len() < most) {
        let told = told.get(trials.len()).cloned();
        let trial = told.unwrap_or_else(|| search.search(&growth, &wish));
        assert_eq!((trial.cell, trial.attempt), (wish.cell, wish.attempt));
        let found = trial.q.as_ref().map(|q| search.accept(&growth, &wish, q).expect("an acceptable pose"));
        growth.tell(trial.evaluations, found);
        trials.push(trial);
    }
    (growth, trials)
}

#[test]
fn every_pose_keeps_height_palm_spacing_and_clearance() {
    let scene = scene();
    let robot = &scene.robots()[0];
    let plan = Arc::new(settings(150).plan(robot).unwrap());
    let (growth, trials) = build(&plan, &scene, &[], usize::MAX);
    assert_eq!(growth.found().len(), 150);
    assert!(trials.len() < 200, "{} searches", trials.len());
    let marker = robot.markers.iter().position(|m| m.name == MARKER).unwrap();
    for (i, found) in growth.found().iter().enumerate() {
        // By the other kinematics, and the scalar engine.
        let hand = &robot.markers_at(&found.whole)[marker];
        let at = hand.position();
        assert!((at.z - (-0.15 + 0.08)).abs() <= 0.005 + 1e-9, "{i}: {at}");
        assert!((-hand.normal.z).acos() <= 10f64.to_radians() + 1e-9, "{i}: {}", hand.normal);
        assert!((at.coords - nalgebra::Vector3::from(found.at)).norm() < 1e-9);
        assert!(scene.free(&[&found.whole], 0.012), "{i} is not free");
        let near = growth.found().iter().take(i).map(|f| (f.at[0] - at.x).hypot(f.at[1] - at.y));
        assert!(near.fold(1.0, f64::min) >= 0.8 * 0.01 - 1e-9, "{i} is too near");
        let moved =
            found.whole.iter().zip(robot.home()).enumerate().filter(|(_, (q, home))| (**q - home).abs() > 1e-12);
        assert!(moved.into_iter().all(|(m, _)| plan.motors.contains(&m)), "{i} moves other motors");
    }
    // 150 cells of a square centimeter around the first pose, without a gap: none is farther than a
    // disc of that area requires.
    let first = growth.found()[0].at;
    let far = growth.found().iter().map(|f| (f.at[0] - first[0]).hypot(f.at[1] - first[1])).fold(0.0, f64::max);
    assert!(far < 1.35 * 0.01 * (150.0 / std::f64::consts::PI).sqrt(), "{far}");
    let found = figures(&growth.found().iter().map(|f| f.at).collect::<Vec<_>>());
    assert!((0.0085..0.0105).contains(&found.median), "{found:?}");
}

#[test]
fn an_interrupted_build_ends_as_one_that_was_not() {
    let scene = scene();
    let plan = Arc::new(settings(40).plan(&scene.robots()[0]).unwrap());
    let (whole, trials) = build(&plan, &scene, &[], usize::MAX);
    for cut in [0, 1, 17, trials.len() - 1] {
        let (_, some) = build(&plan, &scene, &[], cut);
        // As written in the file.
        let text = serde_json::to_string(&some).unwrap();
        let read: Vec<Trial> = serde_json::from_str(&text).unwrap();
        assert_eq!(read, trials[..cut]);
        let (resumed, all) = build(&plan, &scene, &read, usize::MAX);
        assert_eq!((resumed.found(), &all), (whole.found(), &trials));
    }
    let other = Arc::new(TableMapPlan { seed: 2, ..(*plan).clone() });
    assert_ne!(build(&other, &scene, &[], usize::MAX).1, trials, "another seed is another map");
}

#[test]
fn places_that_cannot_be_reached_end_the_growth() {
    let scene = scene();
    let far = TableArea { height_m: -0.15, x_m: [-3.0, -2.9], y_m: [0.0, 0.1] };
    let plan = Arc::new(TableMapSettings { table: far, ..settings(10) }.plan(&scene.robots()[0]).unwrap());
    // A few searches instead of all twenty, to save time.
    let (growth, trials) = build(&plan, &scene, &[], 2);
    assert!(growth.found().is_empty() && trials.iter().all(|t| t.q.is_none() && t.cell.is_none()));
    let tales = vec![Trial { cell: None, attempt: 0, evaluations: 1, q: None }; 20];
    let tales: Vec<Trial> = (0..).zip(tales).map(|(attempt, t)| Trial { attempt, ..t }).collect();
    assert_eq!(build(&plan, &scene, &tales, usize::MAX).1.len(), 20, "then there is nothing more to wish for");
}

#[test]
fn settings_that_make_no_sense_are_refused_each_at_its_place() {
    let scene = scene();
    let robot = &scene.robots()[0];
    let good = || settings(10);
    let table = |x_m, y_m| TableArea { height_m: 0.0, x_m, y_m };
    let cases = [
        (TableMapSettings { motors: vec!["r_elbwo".into()], ..good() }, "motors[0]"),
        (TableMapSettings { hand: Some("r_hnad".into()), ..good() }, "hand"),
        (TableMapSettings { palm: Some([0.0; 3]), ..good() }, "palm"),
        (TableMapSettings { spacing_mm: 0.0, ..good() }, "spacing_mm"),
        (TableMapSettings { spacing_mm: f64::NAN, ..good() }, "spacing_mm"),
        (TableMapSettings { clearance_mm: -1.0, ..good() }, "clearance_mm"),
        (TableMapSettings { vertices: 0, ..good() }, "vertices"),
        (TableMapSettings { neighbors: 0, ..good() }, "neighbors"),
        (TableMapSettings { table: table([0.1, -0.1], [0.0, 1.0]), ..good() }, "table.x_m"),
        (TableMapSettings { table: table([0.0, 1.0], [f64::NAN, 1.0]), ..good() }, "table.y_m"),
        (TableMapSettings { table: table([-9.0, 9.0], [-9.0, 9.0]), ..good() }, "spacing_mm"),
    ];
    for (settings, path) in cases {
        let error = settings.plan(robot).expect_err(path);
        assert_eq!(error.path, path, "{error:?}");
        assert!(!error.help.is_empty());
    }
}
