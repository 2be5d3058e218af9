//! Robots in each other's way, and one at full speed: by the margin alone they touch what they come to, and looking ahead they rest before.

use mobee::run::{example, in_order};

/// How often a robot that explores at full speed stops at something, and touches it.
fn explored(reserve: &[&str]) -> (u64, u64) {
    let set = [&["record.enabled=false", "for_s=120", "robot.icub.agent.speed=1"], reserve].concat();
    let done = example("configs/behaviors/explore.toml", &set).expect("a run");
    assert!(in_order(&done.end) && done.complaints.is_empty(), "{:?}", done.complaints);
    (done.end.counts.rolled_back, done.end.counts.hard_contacts)
}

#[test]
fn a_reserve_keeps_a_fast_robot_from_touching_anything() {
    let (by_margin, ahead) = (explored(&[]), explored(&["robot.icub.controller.reserve_mm=5"]));
    assert!(by_margin.0 > 10 && by_margin.1 > 10, "Algorithm 6 alone: {by_margin:?}");
    assert!(ahead.0 > 10 && ahead.1 == 0, "looking ahead: {ahead:?}");
}

/// Motions and hard contacts of two minutes of this behavior, and the greatest depth, mm.
fn conflict(file: &str, set: &[&str]) -> (u64, u64, f64) {
    let set = [&["record.enabled=false", "for_s=120"], set].concat();
    let done = example(file, &set).expect("a run");
    assert!(in_order(&done.end) && done.complaints.is_empty(), "{:?}", done.complaints);
    let c = &done.end.counts;
    (c.commits, c.hard_contacts, c.hard_contact_depth_mm)
}

#[test]
fn robots_that_share_a_space_look_ahead_unless_their_file_states_algorithm_6() {
    const TWO: &str = "configs/behaviors/conflict.toml";
    let by_margin = conflict(TWO, &["robot.icub.controller.reserve_mm=0", "robot.katana.controller.reserve_mm=0"]);
    assert!(by_margin.1 > 2 && by_margin.1 < by_margin.0 && by_margin.2 > 5.0, "Algorithm 6: {by_margin:?}");
    for file in [TWO, "configs/behaviors/conflict-three.toml", "configs/behaviors/collide.toml"] {
        let (commits, hard, depth) = conflict(file, &[]);
        assert!(commits > 20, "{file}: {commits}");
        assert_eq!((hard, depth), (0, 0.0), "{file}");
    }
}
