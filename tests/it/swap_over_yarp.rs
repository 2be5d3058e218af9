//! The driver of a robot behind YARP is exchanged while its agent explores: the boards, in another process, never hear two drivers
//! at once, and the run goes on.

use crate::common::{HOLD, Run, network, sim};
use std::path::Path;

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
    let ctl = |words: &[&str]| {
        let mut command = network.command(env!("CARGO_BIN_EXE_mobee"));
        let out = command.args(["ctl", "--run"]).arg(network.path().join("run")).args(words).output().expect("mobee");
        (
            out.status.success(),
            String::from_utf8_lossy(&out.stdout).into_owned() + &String::from_utf8_lossy(&out.stderr),
        )
    };
    // each try ends at once while there is no port
    let moves = (0..20_000).any(|_| ctl(&["status"]).1.contains("ARMED  moving"));
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
