//! The roadmap agent of the ball experiment in a process of its own, against the port filter of a system in another: it
//! goes the short way, is rolled back at the ball, learns of it by a `[fail]` alone, and goes round.

use crate::common::{HOLD, Run, network};
use serde_json::Value;

#[test]
fn an_agent_in_another_process_is_rolled_back_at_the_ball_and_goes_round() {
    let network = network();
    let mut run = Run::start(&network, "configs/behaviors/filter.toml");
    run.wait_for_port("/MoBeE/icub/right_arm/rpc:i");
    run.wait_for_port("/MoBeE/world");
    let agent = network
        .command(env!("CARGO_BIN_EXE_mobee"))
        .args(["agent", "configs/behaviors/ball.toml", "--robot", "/MoBeE/icub", "--world", "/MoBeE/world"])
        .args(["--set", "robot.icub.agent.wait_s=0.1", "--for", "240", "--json"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("mobee starts");
    let said = String::from_utf8_lossy(&agent.stdout).into_owned() + &String::from_utf8_lossy(&agent.stderr);
    assert!(agent.status.success(), "{said}");
    let done: Value = serde_json::from_slice(&agent.stdout).expect("JSON");
    assert_eq!(done["done"], true, "{said}");
    assert_eq!(done["counters"]["failed"], 1, "{said}");
    let journal = run.end();
    assert!(journal.contains(HOLD), "{journal}");
    let counters = run.summary()["counters"].clone();
    assert_eq!(counters["rolled_back"], 1, "{counters}");
    assert_eq!(counters["hard_contacts"], 0, "{counters}");
    // one transaction for each motion, over however many parts
    assert_eq!(counters["commits"], done["counters"]["motions"], "{counters} {said}");
}

#[test]
fn a_system_that_is_not_there_is_said_with_its_remedy() {
    let network = network();
    let agent = network
        .command(env!("CARGO_BIN_EXE_mobee"))
        .args(["agent", "configs/behaviors/ball.toml", "--robot", "/MoBeE/icub"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("mobee starts");
    let said = String::from_utf8_lossy(&agent.stderr);
    assert_eq!(agent.status.code(), Some(2), "{said}");
    assert!(said.contains("mobee run"), "{said}");
}
