//! `mobee doctor` says what is there, what is not, and what to do about it.

use crate::common::{Network, network, sim};
use std::path::Path;

fn doctor(network: &Network, args: &[&str]) -> (Option<i32>, String) {
    let mut command = network.command(env!("CARGO_BIN_EXE_mobee"));
    // who moves something leaves a journal in the working directory
    let dir = tempfile::tempdir().expect("a folder");
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR"));
    let args = args.iter().map(|arg| if arg.starts_with("configs/") { shipped.join(arg) } else { arg.into() });
    let out = command.arg("doctor").args(args).current_dir(&dir).output().expect("mobee starts");
    (out.status.code(), String::from_utf8_lossy(&out.stdout).into_owned() + &String::from_utf8_lossy(&out.stderr))
}

#[test]
fn a_simulated_robot_needs_no_network() {
    let network = network();
    let (code, said) = doctor(&network, &["configs/behaviors/explore.toml"]);
    assert_eq!(code, Some(0), "{said}");
    for line in [
        "processor",
        "timers are",
        "runs/ can be written",
        "of disk are free",
        "explore.toml is right",
        "icub is simulated",
    ] {
        assert!(said.contains(line), "{line}: {said}");
    }
    // nobody answers there, and nobody has to
    assert!(said.contains("warn  the YARP name server"), "{said}");
    let (code, said) = doctor(&network, &["configs/behaviors/explore.toml", "--set", "robot.icub.agent.sped=1"]);
    assert!(code == Some(1) && said.contains("did you mean `speed`?"), "{said}");
}

#[test]
fn the_boards_of_a_robot_are_looked_for() {
    let network = network();
    let server = format!("robot.icub.driver.server=\"127.0.0.1:{}\"", network.port);
    let file = ["configs/behaviors/explore-yarp.toml", "--set", &server];
    // whose limits are others than the model's
    let like = ["robot.icub.driver.imitates=\"iCub_SIM\"".to_owned()];
    let boards = sim(&network, "configs/behaviors/explore.toml", "/icubSim", &like);
    let (code, said) = doctor(&network, &file);
    assert_eq!(code, Some(0), "{said}");
    for line in [
        "icub torso at /icubSim/torso: 3 joints",
        "icub right_arm at /icubSim/right_arm",
        "states per second of 50",
        "torso_pitch -10.0..70.0 of -20.0..70.0",
    ] {
        assert!(said.contains(line), "{line}: {said}");
    }
    let moved = |motor: &str| {
        let (code, said) = doctor(&network, &[&file[..], &["--move", motor]].concat());
        (code, said.lines().skip_while(|l| !l.contains(motor) || !l.contains("moved")).collect::<Vec<_>>().join(" "))
    };
    let (code, said) = moved("r_elbow");
    assert!(code == Some(1) && said.contains("/icubSim/right_arm does not honor reference speeds"), "{said}");
    assert!(said.contains("-> set moves = \"set-points\""), "{said}");
    let (code, said) = moved("r_elbo");
    assert!(code == Some(1) && said.contains("was not moved") && said.contains("did you mean `r_elbow`?"), "{said}");
    let mut names = network.command(env!("CARGO_BIN_EXE_mobee"));
    let names = names.args(["yarp", "--server", &format!("127.0.0.1:{}", network.port), "list", "/MoBeE"]).output();
    assert_eq!(String::from_utf8_lossy(&names.expect("it lists").stdout), "", "no name is left behind");
    drop(boards);
    let (code, said) = doctor(&network, &file);
    assert_eq!(code, Some(1), "{said}");
    assert!(
        said.contains("bad   icub torso at /icubSim/torso") && said.contains("-> start the robot's boards"),
        "{said}"
    );
}

/// The robot is moved on request only, and what its boards do is measured.
#[test]
fn a_board_is_measured_on_request() {
    let network = network();
    let server = format!("robot.icub.driver.server=\"127.0.0.1:{}\"", network.port);
    let _boards = sim(&network, "configs/behaviors/explore.toml", "/icubSim", &[]);
    let file = ["configs/behaviors/explore-yarp.toml", "--set", &server, "--move", "torso_yaw"];
    let (code, said) = doctor(&network, &file);
    let measured = said.contains("in 12 stretches: /icubSim/torso honors reference speeds");
    assert!(code == Some(0) && measured, "{said}");
    for words in ["ms behind its set-points", "has arrived", "and stays there", "accelerations that it is sent"] {
        assert!(said.contains(words), "{words}: {said}");
    }
}
