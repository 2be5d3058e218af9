//! Two runs of one robot, or under the same port names: the second is refused before anything moves, sends nothing, and the
//! first goes on as if nothing had been. A bridge that loses its ports later is visible wherever a run is.

use crate::common::{EDGE, HOLD, Network, Process, Run, events, mobee_in, network, real_name_server, said, text};
use mobee_yarp::{InputPort, Queue};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};
use std::time::Duration;

const MOBEE: &str = env!("CARGO_BIN_EXE_mobee");

/// A behavior of one robot with this driver, and this table before it.
fn behavior(network: &Network, name: &str, front: &str, driver: &str, agent: &str) -> PathBuf {
    std::fs::write(network.path().join("edge.xml"), EDGE).expect("written");
    let file = network.path().join(name);
    let controller = "controller = { period_ms = 20, history = 3000 }";
    let text = format!(
        "clock = \"real\"\n{front}\n[[robot]]\nname = \"edge\"\nmodel = \"edge.xml\"\n{controller}\ndriver = {driver}\n{agent}\n"
    );
    std::fs::write(&file, text).expect("written");
    file
}

fn waits_for(network: &Network, port: &str) {
    let waited = network.command(MOBEE).args(["yarp", "exists", "--wait", "60", port]).status();
    assert!(waited.expect("mobee starts").success(), "no port {port}");
}

fn runs(network: &Network, args: &[&str]) -> Output {
    network.command(MOBEE).env("NO_COLOR", "1").arg("run").args(args).output().expect("mobee starts")
}

/// What it says, without line breaks and frames.
fn words(out: &Output) -> String {
    said(out).split_whitespace().filter(|w| *w != "│").collect::<Vec<_>>().join(" ")
}

fn committed(run: &Path) -> usize {
    events(run).iter().filter(|e| e["event"] == "outcome" && e["outcome"] == "committed").count()
}

fn until(what: &str, there: impl Fn() -> bool) {
    for _ in 0..6000 {
        if there() {
            return;
        }
        std::thread::park_timeout(Duration::from_millis(10));
    }
    panic!("waited without success for {what}");
}

/// A second run, and one that resumes the first, of a robot behind boards.
fn refused(network: &Network) {
    let sim = behavior(network, "sim.toml", "", "{ kind = \"sim\", profile = \"ideal\" }", "");
    let mut served = network.command(MOBEE);
    served.args(["sim", text(&sim), "--prefix", "/edgeSim"]).stdout(Stdio::null());
    let _served = Process(served.spawn().expect("mobee starts"));
    waits_for(network, "/edgeSim/base/rpc:i");
    let driver = "{ kind = \"yarp\", parts = [{ part = \"base\", port = \"/edgeSim/base\" }] }";
    let agent = "agent = { kind = \"random\", motors = [\"base\"], count = 0 }";
    let file = behavior(network, "run.toml", "", driver, agent);
    let mut first = Run::with(network, text(&file), "edge", &[]);
    let run = network.path().join("run");
    until("a motion of the first run", || committed(&run) >= 1);
    let two = network.path().join("two");
    for args in [vec![text(&file), "--out", text(&two)], vec!["--resume", text(&run)]] {
        let before = events(&run).len();
        let out = runs(network, &args);
        assert_eq!(out.status.code(), Some(2), "{args:?}: {}", said(&out));
        let reason = if args[0] == "--resume" { "the run goes on" } else { "/MoBeE/edge/driver/base/state:i" };
        assert!(words(&out).contains(reason), "{args:?}: {}", said(&out));
        let done = committed(&run);
        until("the first run to go on", || committed(&run) >= done + 2);
        let since = &events(&run)[before..];
        let hurt = ["disabled", "warning", "died", "command_dropped"];
        let hurt: Vec<&Value> =
            since.iter().filter(|e| hurt.iter().any(|hurt| e["event"] == *hurt) || e["outcome"] == "faulted").collect();
        assert!(hurt.is_empty(), "{args:?}: {hurt:?}");
    }
    let checked = first.end();
    assert!(checked.contains(HOLD), "{checked}");
}

#[test]
fn a_refused_second_run_leaves_the_first_alone() {
    refused(&network());
}

/// The original's name server gives any name to the last that registers it.
#[test]
fn a_refused_second_run_leaves_the_first_alone_under_yarpserver() {
    let network = network();
    let Some(_server) = real_name_server(&network) else { return };
    let served =
        |network: &Network| network.command(MOBEE).args(["yarp", "where"]).output().is_ok_and(|o| o.status.success());
    until("yarpserver", || served(&network));
    refused(&network);
}

#[test]
fn a_bridge_whose_port_names_are_taken_is_refused_at_the_start() {
    let network = network();
    let file = behavior(&network, "run.toml", "[yarp]", "{ kind = \"sim\", profile = \"ideal\" }", "");
    let mut first = Run::with(&network, text(&file), "edge", &[]);
    first.wait_for_port("/MoBeE/edge/base/rpc:i");
    first.wait_for_port("/MoBeE/world");
    // what is checked at the start is what is served
    let listed = network.command(MOBEE).args(["yarp", "list", "/MoBeE"]).output().expect("mobee starts");
    assert_eq!(said(&listed).lines().count(), 10, "{}", said(&listed));
    let two = network.path().join("two");
    let out = runs(&network, &[text(&file), "--for", "5", "--out", text(&two)]);
    assert_eq!(out.status.code(), Some(2), "{}", said(&out));
    let words = words(&out);
    for part in ["another program holds the port name /MoBeE/edge/", "(at 127.0.0.1:", "set another `prefix` in [yarp]"]
    {
        assert!(words.contains(part), "{words}");
    }
    assert!(!events(&two).iter().any(|e| e["event"] == "started"), "it began");
    // under another prefix there is room
    let out = runs(
        &network,
        &[text(&file), "--for", "1", "--set", "yarp.prefix=/other", "--out", text(&network.path().join("three"))],
    );
    assert_eq!(out.status.code(), Some(0), "{}", said(&out));
    assert!(first.end().contains(HOLD));
}

#[test]
fn a_bridge_that_loses_its_ports_is_visible() {
    let network = network();
    let mut server = network.command(MOBEE);
    server.args(["yarp", "server", "--read"]).stdout(Stdio::null());
    let _server = Process(server.spawn().expect("mobee starts"));
    let file = behavior(&network, "run.toml", "[yarp]", "{ kind = \"sim\", profile = \"ideal\" }", "");
    let out = network.path().join("run");
    let mut first = network.command(MOBEE);
    first.args(["run", text(&file), "--for", "12", "--no-record", "--json", "--out", text(&out)]);
    let first = first.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("mobee starts");
    waits_for(&network, "/MoBeE/world");
    let runtime =
        tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().expect("a runtime");
    let names: mobee_yarp::Network = format!("127.0.0.1:{}", network.port).parse().expect("an address");
    let _thief = runtime.block_on(async {
        names.unregister("/MoBeE/world").await.expect("unregistered");
        InputPort::open(&names, "/MoBeE/world", Queue::Newest).await.expect("a port")
    });
    let ended = first.wait_with_output().expect("an end");
    assert_eq!(ended.status.code(), Some(4), "{}", said(&ended));
    let reason = "another program holds the port name /MoBeE/world";
    assert!(words(&ended).contains(&format!("service yarp failed: {reason}")), "{}", said(&ended));
    let summary: Value = serde_json::from_slice(&ended.stdout).expect("a summary");
    assert!(summary["counters"]["down"]["yarp"].as_str().is_some_and(|why| why.contains(reason)), "{summary}");
    let checked = mobee_in(network.path()).args(["check", "run"]).output().expect("mobee starts");
    assert!(checked.status.success(), "{}", said(&checked));
}
