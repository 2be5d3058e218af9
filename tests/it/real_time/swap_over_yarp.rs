//! The driver of a robot behind YARP is exchanged while its agent explores: the boards, in another process, never hear two drivers
//! at once, and the run goes on. A bridge is exchanged while a program moves the robot through it.

use crate::common::{HOLD, Network, Run, events, network, sim};
use std::io::Write;
use std::path::Path;
use std::process::Stdio;

/// What `mobee ctl` says to the run of this network, and whether it is content.
fn ctl(network: &Network, words: &[&str]) -> (bool, String) {
    let mut command = network.command(env!("CARGO_BIN_EXE_mobee"));
    let out = command.args(["ctl", "--run"]).arg(network.path().join("run")).args(words).output().expect("mobee");
    (out.status.success(), String::from_utf8_lossy(&out.stdout).into_owned() + &String::from_utf8_lossy(&out.stderr))
}

#[test]
fn the_driver_of_a_robot_behind_yarp_is_exchanged_while_it_explores() {
    let network = network();
    let _boards = sim(&network, "configs/behaviors/explore.toml", "/icubSim", &[]);
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/behaviors/explore-yarp.toml");
    let file = |name: &str, latency: u32| {
        let text = format!(
            "include = [{shipped:?}]\n[[robot]]\nname = \"icub\"\n[robot.driver]\nserver = \"127.0.0.1:{}\"\nlatency_ms = {latency}\n\
             [robot.agent]\nspeed = 0.4\n",
            network.port
        );
        let path = network.path().join(name);
        std::fs::write(&path, text).expect("a file");
        path.display().to_string()
    };
    let (running, other) = (file("running.toml", 60), file("other.toml", 80));
    let mut run = Run::start(&network, &running);
    let ctl = |words: &[&str]| ctl(&network, words);
    // each try ends at once while there is no port
    let moves = (0..20_000).any(|_| ctl(&["status"]).1.contains("ARMED: moves"));
    assert!(moves, "the run can't be controlled, or its agent does nothing: {}", ctl(&["status"]).1);
    for _ in 0..2 {
        let (done, said) = ctl(&["swap", "driver", &other, "--probation", "2"]);
        assert!(done && said.contains("settled"), "{said}");
    }
    let journal = run.end();
    assert!(journal.contains(HOLD), "{journal}");
    let counters = run.summary()["counters"].clone();
    assert!(counters["committed"].as_u64() > Some(0) && counters["restarts"] == 0, "{counters}");
}

#[test]
fn a_bridge_is_exchanged_while_a_program_moves_the_robot_through_it() {
    let network = network();
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/behaviors/filter.toml");
    let file = |name: &str, bridge: &str| {
        let path = network.path().join(name);
        std::fs::write(&path, format!("include = [{shipped:?}]\n{bridge}\n")).expect("a file");
        path.display().to_string()
    };
    let running = file("running.toml", "");
    let other = file("other.toml", "[yarp]\nprefix = \"/Other\"");
    let nowhere = file("nowhere.toml", "[yarp]\nname_server = \"127.0.0.1:9\"\nstart_name_server = false");
    let several = file("several.toml", "[[bridge]]\nkind = \"yarp\"\nprefix = \"/Third\"");
    let wrong = file("wrong.toml", "[[bridge]]\nkind = \"yarb\"");
    let none = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/behaviors/explore.toml").display().to_string();
    let mut run = Run::start(&network, &running);
    let ctl = |words: &[&str]| ctl(&network, words);
    let yarp = |words: &[&str], input: &str| {
        let mut command = network.command(env!("CARGO_BIN_EXE_mobee"));
        let mut child =
            command.arg("yarp").args(words).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("mobee");
        child.stdin.take().expect("a pipe").write_all(input.as_bytes()).expect("it reads");
        String::from_utf8_lossy(&child.wait_with_output().expect("an end").stdout).into_owned()
    };
    run.wait_for_port("/MoBeE/icub/right_arm/rpc:i");
    let moves = |prefix: &str| {
        yarp(&["rpc", &format!("{prefix}/icub/right_arm/rpc:i")], "set icmd cmod 3 pos\nset vel 3 5\nset pos 3 40\n");
        assert!((0..20_000).any(|_| ctl(&["status"]).1.contains("ARMED: moves")), "{}", ctl(&["status"]).1);
    };
    moves("/MoBeE");
    let (done, said) = ctl(&["swap", "bridge", &other, "--probation", "1"]);
    assert!(done && said.contains("took over") && said.contains("settled"), "{said}");
    run.wait_for_port("/Other/icub/right_arm/rpc:i");
    assert!(!yarp(&["list"], "").contains("/MoBeE/icub/right_arm"), "the old ports are still open");
    assert!(ctl(&["status"]).1.contains("yarp  swap of the bridge: settled"), "{}", ctl(&["status"]).1);
    moves("/Other");

    let (done, said) = ctl(&["swap", "bridge", &nowhere, "--bridge", "yarp"]);
    assert!(!done && said.contains("the old one is back") && said.contains("does not answer"), "{said}");
    run.wait_for_port("/Other/icub/right_arm/rpc:i");
    for (words, why) in [
        (&["swap", "bridge", &other, "--bridge", "yarb"][..], "there are: yarp"),
        (&["swap", "bridge", &other, "--robot", "icub"], "with --bridge"),
        (&["swap", "bridge", &other, "--shadow", "1"], "can't observe"),
        (&["swap", "bridge", &several, "--bridge", "yarb"], "there are: yarp"),
        (&["swap", "bridge", &wrong], "there is no kind `yarb`"),
        (&["swap", "bridge", &none], "add a table [yarp] or [[bridge]]"),
        (&["swap", "detector", &other], "no sensor"),
        (&["swap", "planner", &other], "can't be swapped"),
    ] {
        let (done, said) = ctl(words);
        assert!(!done && said.contains(why), "{words:?}: {said}");
    }
    let journal = run.end();
    assert!(journal.contains(HOLD), "{journal}");
    let all = events(&network.path().join("run"));
    let dead = |e: &&serde_json::Value| e["event"] == "outcome" && e["cause"] == "agent_died";
    assert!(all.iter().any(|e| dead(&e) && e["outcome"] == "rolled_back"), "nothing was under way: {all:#?}");
}
