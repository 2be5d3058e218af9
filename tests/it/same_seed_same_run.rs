//! I13: the same seed gives the same journal, over processes; and a difference would be seen.

use mobee::compose::compose;
use mobee::config::Config;
use mobee::run::{Folder, run};
use mobee_contract::{Board, Command, ControlMode, Driver, DriverFault, Hardware, Sample, Time};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

const BALL: &str = "configs/behaviors/ball.toml";

/// The journal's last hash of a run in a process of its own.
fn hash_of_a_process(seed: &str) -> String {
    let dir = tempfile::tempdir().expect("a folder");
    let out = dir.path().join("run");
    let ran = std::process::Command::new(env!("CARGO_BIN_EXE_mobee"))
        .args(["run", BALL, "--no-record", "--json", "--seed", seed, "--out", out.to_str().expect("a readable path")])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("mobee starts");
    let summary: serde_json::Value = serde_json::from_slice(&ran.stdout).expect("the summary is JSON");
    summary["journal_hash"].as_str().expect("a hash").to_owned()
}

#[test]
fn three_processes_write_one_journal() {
    let first = hash_of_a_process("1");
    assert_eq!(first, hash_of_a_process("1"));
    assert_eq!(first, hash_of_a_process("1"));
    assert_ne!(first, hash_of_a_process("2"), "another seed is another run");
}

/// Counts over all runs of this process: what a hidden source of nondeterminism looks like.
static LEAK: AtomicU64 = AtomicU64::new(0);

struct Leaky(Arc<dyn Hardware>);
struct LeakyDriver(Box<dyn Driver>);

impl Hardware for Leaky {
    fn connect(&self) -> Result<Box<dyn Driver>, DriverFault> {
        Ok(Box::new(LeakyDriver(self.0.connect()?)))
    }
}

impl Driver for LeakyDriver {
    fn board(&self) -> &Board {
        self.0.board()
    }
    fn command(&mut self, now: Time, command: &Command) -> Result<(), DriverFault> {
        self.0.command(now, command)
    }
    fn sample(&mut self, now: Time) -> Result<Option<Sample>, DriverFault> {
        let mut sample = self.0.sample(now)?;
        if let Some(s) = &mut sample {
            let off = 1e-9 * LEAK.fetch_add(1, Ordering::Relaxed) as f64;
            s.q = s.q.iter().map(|q| q + off).collect();
        }
        Ok(sample)
    }
    fn next_sample(&self, now: Time) -> Time {
        self.0.next_sample(now)
    }
    fn lease(&mut self, now: Time, until: Time) {
        self.0.lease(now, until);
    }
    fn modes(&self) -> Vec<ControlMode> {
        self.0.modes()
    }
}

fn hash_of_a_run(wrap: fn(Arc<dyn Hardware>) -> Arc<dyn Hardware>) -> String {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(BALL);
    let (config, source) = Config::load(&file, &["record.enabled=false".into(), "for_s=10".into()]).expect("it loads");
    let mut composition = compose(config, &source).expect("it composes");
    for r in &mut composition.robots {
        r.hardware = wrap(r.hardware.clone());
    }
    let dir = tempfile::tempdir().expect("a folder");
    let (_controls, receiver) = tokio::sync::mpsc::channel(1);
    run(composition, &Folder::create("run", Some(dir.path())).expect("new"), receiver, |_| ()).expect("it runs").hash
}

#[test]
fn a_planted_nanoradian_is_seen() {
    assert_eq!(hash_of_a_run(|h| h), hash_of_a_run(|h| h));
    let leaky: fn(Arc<dyn Hardware>) -> Arc<dyn Hardware> = |h| Arc::new(Leaky(h));
    assert_ne!(hash_of_a_run(leaky), hash_of_a_run(leaky), "the check must see what differs between two runs");
}
