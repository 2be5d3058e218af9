//! A robot at full speed: by the margin alone it touches what it comes to, and with a reserve it rests before.

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
