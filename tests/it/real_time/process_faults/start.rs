//! A run that can't have what it needs does not begin, and says why (F26).

use super::{mobee, said};
use crate::common::network;
use std::net::{Ipv4Addr, TcpListener};
use std::process::Command;

#[test]
fn too_few_open_files_are_said_before_anything_moves() {
    let scratch = tempfile::tempdir().expect("a folder");
    for few in [4, 6, 8, 12, 20, 40] {
        let mut shell = Command::new("sh");
        let line = format!("ulimit -n {few}; exec \"$0\" run configs/behaviors/ball.toml --clock real --out \"$1\"");
        shell.args(["-c", &line, env!("CARGO_BIN_EXE_mobee")]).arg(scratch.path().join("run"));
        let out = shell.current_dir(env!("CARGO_MANIFEST_DIR")).env("NO_COLOR", "1").output().expect("sh starts");
        assert_eq!(out.status.code(), Some(2), "{few}: {}", said(&out));
        assert!(said(&out).contains("Too many open files") || said(&out).contains("ulimit -n"), "{}", said(&out));
    }
    assert!(!scratch.path().join("run").exists(), "nothing half-made stays");
}

#[test]
fn a_control_port_in_use_is_said_before_anything_moves() {
    let taken = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port");
    let address = taken.local_addr().expect("an address").to_string();
    let scratch = tempfile::tempdir().expect("a folder");
    let run = scratch.path().join("run");
    let args = ["run", "configs/behaviors/ball.toml", "--clock", "real", "--ctl", &address, "--out"];
    let out = mobee().args(args).arg(&run).output().expect("mobee starts");
    assert_eq!(out.status.code(), Some(2), "{}", said(&out));
    assert!(said(&out).contains("can't listen") && said(&out).contains("--ctl"), "{}", said(&out));
    assert!(!run.exists());
}

#[test]
fn a_control_port_that_others_can_reach_must_be_allowed() {
    let scratch = tempfile::tempdir().expect("a folder");
    let run = scratch.path().join("run");
    for address in ["0.0.0.0:0", "[::]:0", "192.0.2.1:10010"] {
        let args = ["run", "configs/behaviors/ball.toml", "--clock", "real", "--ctl", address, "--out"];
        let out = mobee().args(args).arg(&run).output().expect("mobee starts");
        assert_eq!(out.status.code(), Some(2), "{}", said(&out));
        assert!(said(&out).contains("allow_open_network"), "{}", said(&out));
        assert!(!run.exists());
    }
}

#[test]
fn an_open_network_needs_a_key() {
    let network = network();
    let run = network.path().join("run");
    let start = |more: &[&str]| {
        let mut command = network.command(env!("CARGO_BIN_EXE_mobee"));
        command.current_dir(env!("CARGO_MANIFEST_DIR")).env("NO_COLOR", "1");
        command.args(["run", "configs/behaviors/filter.toml", "--for", "0.5", "--no-record"]);
        command.args(["--set", "yarp.allow_open_network=true", "--out"]).arg(&run).args(more);
        command.output().expect("mobee starts")
    };
    let out = start(&[]);
    assert_eq!(out.status.code(), Some(2), "{}", said(&out));
    assert!(said(&out).contains("auth.conf") && !run.exists(), "{}", said(&out));
    assert!(start(&["--set", "yarp.without_auth=true"]).status.code() != Some(2));
    std::fs::remove_dir_all(&run).expect("a run");
    std::fs::write(network.path().join("auth.conf"), "[AUTH]\nkey = 4711\n").expect("auth.conf");
    assert!(start(&[]).status.code() != Some(2));
}

#[test]
fn output_that_nobody_takes_is_no_crash() {
    let line = |line: &str| {
        let mut shell = Command::new("sh");
        shell.args(["-c", line, env!("CARGO_BIN_EXE_mobee")]).output().expect("sh starts")
    };
    let out = line("\"$0\" kinds | true");
    assert!(out.status.success() && out.stderr.is_empty(), "{}", said(&out));
    let out = line("\"$0\" kinds >/dev/full");
    assert_eq!(out.status.code(), Some(1));
    assert!(said(&out).contains("No space left") && !said(&out).contains("backtrace"), "{}", said(&out));
}
