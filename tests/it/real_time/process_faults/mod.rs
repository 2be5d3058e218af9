//! What happens to the process: signals, a suspended process, full disks, limits, floods, a viewer that freezes. The robot is
//! brought to rest in order, no outcome is lost as far as the journal reaches, and whoever looks on is told what to do.

mod disk;
mod floods;
mod late_viewer;
mod signals;
mod start;
mod viewer;

pub(super) use crate::common::{events, mobee_here as mobee, said, text};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::Duration;

fn count(events: &[Value], what: &str) -> usize {
    events.iter().filter(|e| e["event"] == what).count()
}

/// The journal and its invariants are in order, and every commit has its outcome.
fn holds(run: &Path) -> Vec<Value> {
    let out = mobee().args(["check", text(run)]).output().expect("mobee starts");
    assert!(out.status.success(), "{}", said(&out));
    let all = events(run);
    assert_eq!(count(&all, "commit"), count(&all, "outcome"), "every commit has one outcome");
    all
}

/// A run in another process.
struct Run {
    /// None once it has ended.
    child: Option<Child>,
    out: PathBuf,
}

impl Run {
    /// Starts it with a real clock.
    fn start(out: PathBuf, args: &[&str]) -> Run {
        let mut command = mobee();
        command.args(["run", "--clock", "real", "--json", "--out", text(&out)]).args(args);
        let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("mobee starts");
        Run { child: Some(child), out }
    }

    /// Waits until the journal says so.
    fn wait(&mut self, done: impl Fn(&[Value]) -> bool) -> Vec<Value> {
        loop {
            let all = events(&self.out);
            if done(&all) {
                return all;
            }
            let ended = self.child.as_mut().and_then(|child| child.try_wait().expect("a child"));
            assert!(ended.is_none(), "it ended before its time");
            std::thread::park_timeout(Duration::from_millis(10));
        }
    }

    fn signal(&self, name: &str) {
        let id = self.child.as_ref().expect("a child").id().to_string();
        let sent = Command::new("kill").args([&format!("-{name}"), &id]).status();
        assert!(sent.expect("kill").success());
    }

    /// Waits for its end.
    fn end(mut self) -> Output {
        self.child.take().expect("a child").wait_with_output().expect("an end")
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        if let Some(child) = &mut self.child {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}
