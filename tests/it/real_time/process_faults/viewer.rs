//! A viewer that freezes, or never comes (F17, I16): the run, its recording and its end don't wait for it.

use super::{Run, count, holds, said};
use serde_json::Value;
use std::net::{Ipv4Addr, TcpListener};

#[test]
fn a_viewer_that_takes_the_connection_and_never_reads_is_left_behind() {
    // what is sent is taken by the system, and read by nobody
    let viewer = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port");
    let live = format!("record.live=\"{}\"", viewer.local_addr().expect("an address"));
    let scratch = tempfile::tempdir().expect("a folder");
    let args = ["configs/behaviors/explore.toml", "--for", "4", "--set", &live, "--set", "record.poses_hz=100.0"];
    let mut run = Run::start(scratch.path().join("run"), &args);
    let out = run.out.clone();
    run.wait(|all| count(all, "commit") > 0);
    let end = run.end();
    assert!(end.status.success(), "{}", said(&end));
    let summary: Value = serde_json::from_slice(&end.stdout).expect("JSON");
    let complaints = summary["complaints"].to_string();
    assert!(complaints.contains("viewer"), "{complaints}");
    assert!(!complaints.contains("recorder"), "{complaints}");
    holds(&out);
    let recording = mobee_recorder::Contents::read(&out.join("recording.rrd")).expect("the recording loads");
    assert!(recording.until.secs() > 1.0);
}
