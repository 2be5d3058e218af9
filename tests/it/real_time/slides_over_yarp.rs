//! A robot with motors that slide, from its URDF to programs behind the filter: `mobee new`, `mobee sim`, the driver of boards, the port filter,
//! and an ordinary C++ program on the real library. Millimeters inside, meters on every wire.

use crate::common::{HOLD, Network, RealYarp, Run, mobee_in, network, said, text};
use serde_json::Value;
use std::io::Write;
use std::path::PathBuf;
use std::process::{Child, Stdio};

/// The ports of the simulated boards, and of the filter in front of them.
const SIM: &str = "/rail_armSim/rail_arm";
const FILTER: &str = "/MoBeE/rail_arm/rail_arm";

/// A simulation in another process; ends when dropped.
struct Served(Child);

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The robot of `tests/data/rail_arm.urdf` as `mobee new` makes it, served as boards.
fn served(network: &Network) -> Served {
    let urdf = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/rail_arm.urdf");
    let made =
        mobee_in(network.path()).args(["new", "pick", "--robot", urdf, "--poses", "500"]).output().expect("mobee");
    assert!(made.status.success(), "{}", said(&made));
    let mut sim = network.command(env!("CARGO_BIN_EXE_mobee"));
    let sim = sim
        .args(["sim", "pick.toml", "--set", "robot.rail_arm.driver.profile=ideal"])
        .current_dir(network.path())
        .stdout(Stdio::null());
    let sim = Served(sim.spawn().expect("mobee starts"));
    let port = format!("{SIM}/rpc:i");
    let exists = network.command(env!("CARGO_BIN_EXE_mobee")).args(["yarp", "exists", "--wait", "60", &port]).status();
    assert!(exists.expect("mobee starts").success(), "no port {port}");
    sim
}

/// What the filtered board answers to these lines.
fn typed(network: &Network, lines: &[&str]) -> String {
    let mut rpc = network.command(env!("CARGO_BIN_EXE_mobee"));
    let rpc = rpc.args(["yarp", "rpc", &format!("{FILTER}/rpc:i")]).stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut rpc = rpc.spawn().expect("mobee starts");
    let mut input = rpc.stdin.take().expect("an input");
    input.write_all((lines.join("\n") + "\n").as_bytes()).expect("written");
    drop(input);
    said(&rpc.wait_with_output().expect("an end"))
}

/// The behavior with the robot behind YARP, and this table before it.
fn behind_yarp(network: &Network, front: &str, agent: bool) -> PathBuf {
    let pick = std::fs::read_to_string(network.path().join("pick.toml")).expect("a behavior");
    let parts = format!("parts = [{{ part = \"rail_arm\", port = \"{SIM}\" }}]");
    let driver = format!("driver = {{ kind = \"yarp\", max_speed_deg_per_s = 100.0, {parts} }}");
    let written = pick.lines().find(|line| line.starts_with("driver = ")).expect("a driver").to_owned();
    let mut pick = pick.replace(&written, &driver);
    assert!(pick.contains(&driver), "{pick}");
    if !agent {
        pick.truncate(pick.find("[robot.agent]").expect("an agent"));
    }
    let file = network.path().join("yarp.toml");
    let pick = pick.replacen("[[robot]]", &format!("{front}\n\n[[robot]]"), 1);
    std::fs::write(&file, format!("clock = \"real\"\n{pick}")).expect("written");
    file
}

#[test]
fn a_robot_on_a_rail_explores_over_yarp() {
    let network = network();
    let _sim = served(&network);
    let file = behind_yarp(&network, "", true);
    let set = ["robot.rail_arm.agent.vertices=5", "robot.rail_arm.agent.speed=0.5"];
    let ran = network
        .command(env!("CARGO_BIN_EXE_mobee"))
        .args(["run", text(&file), "--set", set[0], "--set", set[1], "--for", "40", "--no-record", "--json"])
        .args(["--set", "robot.rail_arm.controller.stale_ms=3000", "--out", "run"])
        .current_dir(network.path())
        .output()
        .expect("mobee starts");
    assert!(ran.status.success(), "{}", said(&ran));
    let checked = mobee_in(network.path()).args(["check", "run"]).output().expect("mobee starts");
    assert!(checked.status.success() && said(&checked).contains(HOLD), "{}", said(&checked));
    let summary: Value = serde_json::from_slice(&ran.stdout).expect("a summary");
    let counters = &summary["counters"];
    assert!(counters["committed"].as_u64().is_some_and(|n| n >= 3), "{summary}");
    // the one that was under way at the end
    assert!(counters["faulted"].as_u64().is_some_and(|n| n <= 1), "{summary}");
    assert_eq!((&counters["rolled_back"], &counters["hard_contacts"]), (&Value::from(0), &Value::from(0)), "{summary}");
}

/// The rail is joint 0, from -0.1 to 0.7 m; the gripper joint 3, from 0 to 0.05 m.
#[test]
fn an_ordinary_program_moves_the_rail_in_meters() {
    let Some(real) = RealYarp::find() else { return };
    let network = network();
    let _sim = served(&network);
    let file = behind_yarp(&network, "[yarp]", false);
    let mut run = Run::of(&network, text(&file), "rail_arm");
    run.wait_for_port(&format!("{FILTER}/rpc:i"));
    let poses = ["--pose", "(0.05 10 -10 0.02)", "--pose", "(0.0 0 0 0.0)", "--pose", "(0.03 0 0 0.04)"];
    let args = ["--remote", FILTER, "--local", "/reach", "--facts", "yes"];
    let said = real.program("reach", &network, &[args.as_slice(), poses.as_slice()].concat());
    let lines: Vec<&str> = said.lines().collect();
    for line in ["joint 0 prismatic -0.100 0.700", "joint 1 revolute -57.296 57.296", "joint 3 prismatic 0.000 0.050"] {
        assert!(lines.contains(&line), "{line}: {said}");
    }
    let at: Vec<Vec<f64>> = lines
        .iter()
        .filter_map(|line| line.strip_prefix("at "))
        .map(|line| line.split(' ').skip(1).map(|n| n.parse().expect("a number")).collect())
        .collect();
    let wanted = [[0.05, 10.0, -10.0, 0.02], [0.0, 0.0, 0.0, 0.0], [0.03, 0.0, 0.0, 0.04]];
    assert_eq!(at.len(), 3, "{said}");
    for (at, wanted) in at.iter().zip(wanted) {
        let off: Vec<f64> = at.iter().zip(wanted).map(|(a, w)| (a - w).abs()).collect();
        assert!(off[0] < 1e-3 && off[1] < 1.0 && off[2] < 1.0 && off[3] < 1e-3, "{said}");
    }
    let typed = typed(&network, &["set pos 0 30", "set pos 3 0.06", "get enc 0", "get llim 3"]);
    assert_eq!(typed.matches("[fail]").count(), 2, "thirty meters, and six centimeters: {typed}");
    assert!(typed.contains("[is] llim 0.0 0.05") || typed.contains("[is] [llim] 0.0 0.05"), "{typed}");
    let journal = run.end();
    assert!(journal.contains(HOLD), "{journal}");
    let summary = run.summary();
    assert_eq!(summary["counters"]["commits"], 3, "{summary}");
}
