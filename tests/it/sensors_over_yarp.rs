//! Robot, run, detectors and locator in processes of their own, behind one YARP network: what the simulated eyes see is where the world of
//! the run has it soon after. Wrong input is answered before any port is opened.

use super::common::{HOLD, Network, Process, Run, complaint, network, real_name_server, sim};
use std::io::Write;
use std::process::{Command, Stdio};

fn mobee(network: &Network, words: &[&str]) -> Command {
    let mut command = network.command(env!("CARGO_BIN_EXE_mobee"));
    command.args(words).current_dir(env!("CARGO_MANIFEST_DIR"));
    command
}

fn start(network: &Network, words: &[&str]) -> Process {
    Process(mobee(network, words).stdout(Stdio::null()).spawn().expect("mobee starts"))
}

/// Ends it as Ctrl-C does; whether it ended well.
fn interrupt(mut process: Process) -> bool {
    let kill = Command::new("kill").args(["-INT", &process.0.id().to_string()]).status().expect("kill");
    kill.success() && process.0.wait().expect("an end").success()
}

/// What the world answers.
fn world(network: &Network, request: &str) -> String {
    let mut rpc = mobee(network, &["yarp", "rpc", "/MoBeE/world"]);
    let mut rpc = rpc.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("mobee starts");
    rpc.stdin.take().expect("a pipe").write_all(request.as_bytes()).expect("it reads");
    String::from_utf8_lossy(&rpc.wait_with_output().expect("an end").stdout).into_owned()
}

/// How far the world has the cup from where it is in truth, meters.
fn off(network: &Network) -> Option<f64> {
    let told = world(network, "get cup\n");
    let numbers: Vec<f64> = told.split_whitespace().filter_map(|w| w.parse().ok()).collect();
    let [x, y, z] = *numbers.get(12..15)? else { return None };
    Some([x + 0.36, y - 0.04, z + 0.10].iter().map(|d: &f64| d * d).sum::<f64>().sqrt())
}

#[test]
fn what_is_seen_in_one_process_and_placed_in_another_moves_the_world_of_a_third() {
    let network = network();
    let _server = real_name_server(&network);
    let _robot = sim(&network, "configs/behaviors/look.toml", "/icubSim", &["script=[]".to_owned()]);
    let mut run = Run::start(&network, "configs/behaviors/look-yarp.toml");
    run.wait_for_port("/MoBeE/world");
    assert!(world(&network, "set cup -0.2 0.3 0.4\n").contains("Set"));
    assert!(off(&network) > Some(0.3));
    let locator = start(&network, &["locator", "run", "configs/sensing/eyes-yarp.toml"]);
    let detector = start(&network, &["detector", "run", "configs/sensing/eyes-yarp.toml"]);
    run.wait_for_port("/MoBeE/eyes/left/mask:o");
    // each try is a process of its own
    let near = (0..2_000).any(|_| off(&network).is_some_and(|off| off < 0.025));
    assert!(near, "the cup is {:?} m off", off(&network));
    assert!(interrupt(detector) && interrupt(locator), "they end in order");
    let journal = run.end();
    assert!(journal.contains(HOLD), "{journal}");
}

#[test]
fn wrong_input_is_answered_before_any_port_is_opened() {
    for (words, what, help) in [
        (&["detector", "run", "configs/behaviors/look.toml"][..], "look.toml:30", "mobee sim"),
        (&["detector", "run", "configs/behaviors/explore.toml"], "has no sensor", "[[sensor]]"),
        (&["detector", "run", "configs/sensing/eyes-yarp.toml", "--sensor", "eye"], "no sensor `eye`", "eyes"),
        (
            &["detector", "run", "configs/sensing/eyes-yarp.toml", "--server", "127.0.0.1:9"],
            "127.0.0.1:9",
            "yarp server",
        ),
        (
            &["locator", "run", "configs/sensing/eyes-yarp.toml", "--set", "sensor.eyes.gate.objects=[\"cop\"]"],
            "`cop`",
            "cup",
        ),
        (&["locator", "run", "nothing.toml"], "nothing.toml", "configs/behaviors/"),
    ] {
        let told = complaint(words);
        assert!(told.contains(what) && told.contains(help), "{words:?}: {told}");
    }
}
