//! A run with a real clock is looked at, exchanged in part, paused and stopped by `mobee ctl`, without a name server.

use crate::common::{mobee_here, network, said};
use crate::private_runs::{NOBODY, is_root};
use std::fs::Permissions;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Output, Stdio};
use std::time::Duration;

/// A run that can be controlled.
pub(crate) struct Run {
    pub(crate) child: Child,
    /// Its folder.
    pub(crate) out: std::path::PathBuf,
}

impl Run {
    pub(crate) fn start(dir: &Path, file: &Path, more: &[&str]) -> Run {
        let out = dir.join("run");
        let child = mobee_here()
            .arg("run")
            .arg(file)
            .args(["--clock", "real", "--for", "120", "--no-record", "--json"])
            .args(more)
            .args([Path::new("--out"), &out])
            .stdout(Stdio::null())
            .spawn()
            .expect("mobee starts");
        let run = Run { child, out };
        // each try ends at once while there is no port
        let up = (0..20_000).any(|_| run.ctl(&["status"]).status.success());
        assert!(up, "the run can't be controlled");
        run
    }

    pub(crate) fn ctl(&self, words: &[&str]) -> Output {
        mobee_here().args(["ctl", "--run"]).arg(&self.out).args(words).output().expect("mobee starts")
    }

    pub(crate) fn says(&self, words: &[&str]) -> String {
        let out = self.ctl(words);
        assert!(out.status.success(), "{words:?}: {}", String::from_utf8_lossy(&out.stderr));
        String::from_utf8_lossy(&out.stdout).into_owned()
    }

    pub(crate) fn refuses(&self, words: &[&str]) -> String {
        let out = self.ctl(words);
        assert_eq!(out.status.code(), Some(2), "{words:?}: {}", String::from_utf8_lossy(&out.stdout));
        String::from_utf8_lossy(&out.stderr).into_owned()
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn a_run_is_controlled_from_outside() {
    let dir = tempfile::tempdir().expect("a folder");
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/behaviors/explore.toml");
    let file = |name: &str, table: &str, setting: &str| {
        let text = format!("include = [{shipped:?}]\n[[robot]]\nname = \"icub\"\n[robot.{table}]\n{setting}\n");
        let path = dir.path().join(name);
        std::fs::write(&path, text).expect("a file");
        path.display().to_string()
    };
    let (faster, wrong) = (file("faster.toml", "agent", "speed = 0.4"), file("wrong.toml", "agent", "sped = 0.4"));
    let (wider, worse) =
        (file("wider.toml", "controller", "margin_mm = 12"), file("worse.toml", "controller", "margin_mm = 900"));
    let other = file("other.toml", "driver", "start_deg = { r_elbow = 40 }");
    let mut run = Run::start(dir.path(), &shipped, &[]);

    let status = run.says(&["status"]);
    assert!(status.starts_with("icub  ARMED"), "{status}");
    assert!(status.contains("icub/supervise") && status.contains("icub/driver>history"), "{status}");

    let swapped = run.says(&["swap", "--robot", "icub", "agent", &faster, "--shadow", "0.5", "--probation", "0.5"]);
    assert!(swapped.contains("took over") || swapped.contains("settled"), "{swapped}");
    let why = run.refuses(&["swap", "agent", &wrong]);
    assert!(why.contains("did you mean `speed`?") && why.contains("wrong.toml:5"), "{why}");
    let why = run.refuses(&["swap", "--robot", "icup", "agent", &faster]);
    assert!(why.contains("there are: icub"), "{why}");
    let swapped = run.says(&["swap", "controller", &wider, "--probation", "0.5"]);
    assert!(swapped.contains("settled"), "{swapped}");
    let why = run.refuses(&["swap", "controller", &worse]);
    assert!(why.contains("worse.toml"), "{why}");
    let why = run.refuses(&["swap", "controller", &wider, "--shadow", "1"]);
    assert!(why.contains("can't observe"), "{why}");
    let swapped = run.ctl(&["swap", "driver", &other]);
    let said = String::from_utf8_lossy(&swapped.stdout);
    assert!(swapped.status.code() == Some(1) && said.contains("another robot"), "{said}");
    assert!(run.says(&["top", "--times", "1"]).starts_with("icub  "));
    let why = run.refuses(&["swap", "agent", "configs/behaviors/nothing.toml"]);
    assert!(why.contains("nothing.toml"), "{why}");

    assert!(run.says(&["pause"]).contains("icub: its agent pauses"));
    assert!(run.says(&["status"]).contains("its agent is paused"));
    run.says(&["resume", "icub"]);
    run.says(&["world", "mk", "ssph", "0.05", "-2", "-2", "0.5"]);
    assert!(run.says(&["world", "ls"]).contains("ssph1"));
    let help = run.says(&["world", "help"]);
    assert!(help.lines().count() > 10 && help.lines().any(|line| line.starts_with("ls - ")), "{help}");
    run.refuses(&["record", "off"]);
    assert!(run.refuses(&["recover"]).contains("icub: there is nothing to recover from"));
    run.says(&["stop"]);
    assert!(run.child.wait().expect("an end").success());
    run.refuses(&["status"]);
    let checked = mobee_here().arg("check").arg(&run.out).output().expect("mobee starts");
    assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stdout));
}

/// A behavior on the shipped robots, with this in place of the shipped agent.
fn behavior(dir: &Path, name: &str, agent: &str) -> std::path::PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let robot = root.join("configs/robots/icub.xml");
    let text = format!(
        "[[robot]]\nname = \"icub\"\nmodel = {robot:?}\ndriver = {{ kind = \"sim\", profile = \"ideal\" }}\n\
         [robot.controller]\nperiod_ms = 20\nhistory = 6000\n{agent}"
    );
    let path = dir.join(name);
    std::fs::write(&path, text).expect("a file");
    path
}

/// An operator stops, looks at and moves a robot; a robot without an agent gets one.
#[test]
fn an_operator_halts_moves_and_releases_a_robot() {
    let dir = tempfile::tempdir().expect("a folder");
    let mut run = Run::start(dir.path(), &behavior(dir.path(), "idle.toml", ""), &[]);
    let status = |what: &str| (0..20_000).any(|_| run.says(&["status"]).contains(what));
    assert!(
        status("icub  ARMED: rests; it moves when a program or `mobee ctl go` commits"),
        "{}",
        run.says(&["status"])
    );

    assert!(run.says(&["go", "r_elbow=60", "--speed", "0.8"]).contains("reached its target"));
    let pose = run.says(&["pose", "--robot", "icub"]);
    let elbow = pose.lines().find(|line| line.contains("r_elbow ")).expect("the elbow");
    let degrees: f64 = elbow.split_whitespace().nth(1).and_then(|n| n.parse().ok()).expect("degrees");
    assert!((degrees - 60.0).abs() < 0.5, "{pose}");
    assert!(pose.contains("r_hand at "), "{pose}");
    assert!(run.refuses(&["go", "r_elbo=60"]).contains("did you mean `r_elbow`?"));
    assert!(run.refuses(&["go", "r_elbow=600"]).contains("outside its limits"));

    assert!(run.says(&["halt"]).contains("icub: halted, at rest"));
    assert!(run.says(&["status"]).starts_with("icub  HALTED: a person halted it"), "{}", run.says(&["status"]));
    assert!(run.refuses(&["go", "r_elbow=30"]).contains("mobee ctl release"));
    assert!(run.refuses(&["recover"]).contains("`mobee ctl release` lets it act again"));
    assert!(run.refuses(&["release", "icup"]).contains("there are: icub"));
    assert!(run.says(&["release", "icub"]).contains("icub: released"));
    assert!(run.refuses(&["release"]).contains("icub: it is not halted"));
    assert!(status("icub  ARMED"));
    assert!(run.says(&["home", "--speed", "0.8"]).contains("reached its target"));

    let log = run.says(&["log", "-n", "50"]);
    assert!(log.contains("icub: halted") && log.contains("icub: released") && log.contains("of ctl begins"), "{log}");

    assert!(run.refuses(&["world", "def", "nothing", "ghost"]).contains("not found"));
    assert!(run.refuses(&["world", "mk", "cone", "1"]).contains("MK ERROR"));
    run.says(&["world", "mk", "ssph", "0.05", "-2", "-2", "0.5"]);
    assert!(run.says(&["world", "def", "ssph1", "ghost"]).contains("'ghost'"));
    assert!(run.says(&["world", "def", "ssph1", "tgt"]).contains("'target'"));

    let random = "[robot.agent]\nkind = \"random\"\nmotors = [\"right_arm\"]\ncount = 100\nspeed = 0.1\n";
    let random = behavior(dir.path(), "random.toml", random).display().to_string();
    assert!(run.says(&["swap", "agent", &random]).contains("settled"));
    let acts = ["icub  ARMED: moves", "its agent may move it"];
    assert!((0..20_000).any(|_| acts.iter().any(|what| run.says(&["status"]).contains(what))));
    assert!(run.refuses(&["go", "r_elbow=30"]).contains("mobee ctl pause icub"));
    run.says(&["pause", "--robot", "icub"]);

    // an agent that is soon done ends the run in the middle of its own swap
    let over = "[robot.agent]\nkind = \"random\"\nmotors = [\"right_arm\"]\ncount = 1\nspeed = 1.0\n";
    let over = behavior(dir.path(), "over.toml", over).display().to_string();
    run.says(&["resume"]);
    let swapped = run.ctl(&["swap", "agent", &over, "--fresh"]);
    assert!(swapped.status.success(), "{}", said(&swapped));
    assert!(said(&swapped).contains("the run has ended: icub: its agent is done"), "{}", said(&swapped));
    assert!(run.child.wait().expect("an end").success());
}

/// `stop` returns when the run is over: what is read then is whole. The terminal has said what the run was about.
#[test]
fn a_run_talks_and_a_stop_waits_for_its_end() {
    let dir = tempfile::tempdir().expect("a folder");
    let (file, out) = (behavior(dir.path(), "idle.toml", ""), dir.path().join("run"));
    let child = mobee_here()
        .arg("run")
        .arg(&file)
        .args(["--clock", "real", "--for", "60", "--no-record"])
        .args([Path::new("--out"), &out])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("mobee starts");
    let run = Run { child, out };
    assert!((0..20_000).any(|_| run.ctl(&["status"]).status.success()));
    run.says(&["halt"]);
    let why = run.refuses(&["swap", "agent", &file.display().to_string()]);
    assert!(why.contains("has no agent"), "{why}");
    run.says(&["release"]);
    assert!(run.says(&["stop"]).contains("the run is over"));
    let checked = mobee_here().arg("check").arg(&run.out).output().expect("mobee starts");
    let checked = String::from_utf8_lossy(&checked.stdout).into_owned();
    assert!(checked.contains("the run ended in order"), "{checked}");
    let mut run = std::mem::ManuallyDrop::new(run);
    let (mut told, mut summary) = (String::new(), String::new());
    run.child.stderr.take().expect("piped").read_to_string(&mut told).expect("text");
    run.child.stdout.take().expect("piped").read_to_string(&mut summary).expect("text");
    assert!(run.child.wait().expect("an end").success());
    for what in ["running for 60 s, into ", "  watch   mobee ctl", "  stop    Ctrl-C", "icub: halted", "icub: released"]
    {
        assert!(told.contains(what), "{what}: {told}");
    }
    assert!(!told.contains('\u{1b}'), "{told}");
    assert!(summary.contains("stopped on request") && summary.contains("motions"), "{summary}");
    assert!(!summary.contains("restarts") && !summary.contains("times real time"), "{summary}");
}

#[test]
fn an_edit_of_the_running_file_is_taken_over_or_said() {
    let dir = tempfile::tempdir().expect("a folder");
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/behaviors/explore.toml");
    let file = dir.path().join("mine.toml");
    let write = |seed: u32, setting: &str| {
        let text =
            format!("include = [{shipped:?}]\nseed = {seed}\n[[robot]]\nname = \"icub\"\n[robot.agent]\n{setting}\n");
        std::fs::write(&file, text).expect("a file");
    };
    write(1, "speed = 0.1");
    let run = Run::start(dir.path(), &file, &["--watch"]);
    // a look at the journal after each answer of the run: it passes the time
    let told = |text: &str| {
        (0..20_000).any(|_| {
            run.says(&["status"]);
            std::fs::read_to_string(run.out.join("journal.jsonl")).expect("a journal").contains(text)
        })
    };
    write(2, "speed = 0.1");
    assert!(told("seed can't be changed while the run goes on"));
    write(1, "sped = 0.1");
    assert!(told("did you mean `speed`"));
    write(1, "speed = 0.3");
    assert!(told("took_over"));
    // the swap is on probation for ten seconds: an edit is answered at once
    write(1, "sped = 0.4");
    assert!(told("the edit is taken up once that has ended"));
}

#[test]
fn an_edited_bridge_is_exchanged_and_an_added_one_needs_a_restart() {
    let network = network();
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/behaviors/filter.toml");
    let file = network.path().join("mine.toml");
    let write = |speed: f64, more: &str| {
        let (port, text) = (network.port, format!("include = [{shipped:?}]\n{more}\n[yarp]\nspeed = {speed}\n"));
        std::fs::write(&file, format!("{text}name_server = \"127.0.0.1:{port}\"\n")).expect("a file");
    };
    write(0.1, "");
    let run = Run::start(network.path(), &file, &["--watch"]);
    let told = |text: &str| {
        (0..20_000).any(|_| {
            run.says(&["status"]);
            std::fs::read_to_string(run.out.join("journal.jsonl")).expect("a journal").contains(text)
        })
    };
    write(0.1, "[[bridge]]\nkind = \"yarp\"\nprefix = \"/Third\"\n");
    assert!(told("bridge can't be changed while the run goes on"));
    write(0.05, "");
    assert!(told("yarp.bridge is exchanged"));
    assert!(run.says(&["status"]).contains("yarp  swap of the bridge: settled"));
}

/// What another user gets who asks for this.
fn as_nobody(run: &Run, words: &[&str]) -> Output {
    let mut command = mobee_here();
    command.args(["ctl", "--run"]).arg(&run.out).args(words).uid(NOBODY).gid(NOBODY);
    command.output().expect("mobee starts")
}

#[test]
fn another_user_controls_nothing() {
    let dir = tempfile::tempdir().expect("a folder");
    if !is_root(dir.path()) {
        return;
    }
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/behaviors/explore.toml");
    let open = |path: &Path, mode| std::fs::set_permissions(path, Permissions::from_mode(mode)).expect("opened");
    open(dir.path(), 0o755);
    for (ctl, file) in [(&[][..], "ctl.sock"), (&["--ctl", "127.0.0.1:0"][..], "ctl.tcp")] {
        let mut run = Run::start(dir.path(), &shipped, ctl);
        let refused = |why: &str| {
            for words in [&["status"][..], &["stop"], &["swap", "agent", "configs/behaviors/explore.toml"]] {
                let out = as_nobody(&run, words);
                assert_eq!(out.status.code(), Some(2), "{words:?}: {}", said(&out));
                assert!(said(&out).contains(why), "{words:?}: {}", said(&out));
            }
        };
        refused("own user");
        // even if somebody opens the folder by hand, the system says who is at the other end
        open(&run.out, 0o755);
        if file == "ctl.sock" {
            open(&run.out.join(file), 0o666);
            refused("own user");
        } else {
            refused("own user");
            let at = std::fs::read_to_string(run.out.join(file)).expect("an address");
            let mut line = TcpStream::connect(at.split(' ').next().expect("an address")).expect("a connection");
            line.set_read_timeout(Some(Duration::from_secs(10))).expect("a limit");
            line.write_all(b"CONNECT attacker\nd\nstatus\n{\"words\":[\"stop\"]}\n").expect("sent");
            let mut answer = Vec::new();
            let _ = line.read_to_end(&mut answer);
            assert!(!String::from_utf8_lossy(&answer).contains("icub"), "{answer:?}");
        }
        run.says(&["status"]);
        run.says(&["stop"]);
        assert!(run.child.wait().expect("an end").success());
        std::fs::rename(&run.out, dir.path().join(file)).expect("the next one has its place");
    }
}
