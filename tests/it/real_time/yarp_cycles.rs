//! Connect, move, reflex, name server killed and started anew, again and again: no hang, and nothing is left behind.
//!
//! `MOBEE_CYCLES` says how often (default 3).

use crate::common::{HOLD, Network, RealYarp, Run, network};
use std::process::{Child, Stdio};

/// A real name server; killed when dropped.
struct Server(Child);

impl Server {
    fn start(real: &RealYarp, network: &Network) -> Server {
        let mut command = real.tool("yarpserver", network);
        command.args(["--socket", &network.port.to_string(), "--read"]);
        Server(command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("yarpserver starts"))
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn cycles_of_connect_move_reflex_and_a_new_name_server_leave_nothing_behind() {
    let Some(real) = RealYarp::find() else { return };
    let cycles = std::env::var("MOBEE_CYCLES").ok().and_then(|n| n.parse().ok()).unwrap_or(3_usize);
    let network = network();
    let mut server = Server::start(&real, &network);
    let mut run = Run::start(&network, "configs/behaviors/filter.toml");
    let mut used = Vec::new();
    for cycle in 0..cycles {
        // each port registers itself anew, in its own time
        for port in ["rpc:i", "command:i", "stateExt:o"] {
            run.wait_for_port(&format!("/MoBeE/icub/right_arm/{port}"));
        }
        let args = [
            ["--remote", "/MoBeE/icub/right_arm"],
            ["--local", "/reach"],
            ["--speed", "10"],
            ["--pose", "(-20 75 0 60 10 -15 5)"],
            ["--pose", "(-45 35 35 95 15 -25 -5)"],
        ];
        let said = real.program("reach", &network, args.as_flattened());
        assert!(said.contains("reached 0") && said.contains("failed 1") && said.contains("again 1"), "{cycle}: {said}");
        assert!(said.contains("bye"), "{cycle}: {said}");
        drop(server);
        server = Server::start(&real, &network);
        used.push(run.used());
        let (files, kilobytes) = used[cycle];
        println!("cycle {cycle}: {files} file descriptors, {kilobytes} kB resident");
    }
    let said = run.end();
    assert!(said.contains(HOLD), "{said}");
    assert_eq!(run.summary()["counters"]["rolled_back"], cycles, "{said}");
    // the first cycles fill the history and the caches
    let (early, late) = (used[cycles / 3], used[cycles - 1]);
    assert!(late.0 <= early.0 + 4, "file descriptors grow: {used:?}");
    if cycles >= 30 {
        assert!(late.1 <= early.1 + early.1 / 10, "memory grows: {used:?}");
    }
}
