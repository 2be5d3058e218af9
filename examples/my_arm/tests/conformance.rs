//! The driver keeps every promise of the contract, and the behavior runs: checked, repeated, tortured.

use mobee_conformance::Bench;
use mobee_contract::{Axis, Driver, Hardware, Time};
use my_arm::driver::{Arm, Loopback};
use std::path::Path;
use std::process::Command;

/// One arm, and virtual time.
struct OnTheBench(Arm, Time);

impl Bench for OnTheBench {
    fn connect(&mut self) -> Result<Box<dyn Driver>, String> {
        self.0.connect().map_err(|e| e.to_string())
    }
    fn now(&self) -> Time {
        self.1
    }
    fn wait_until(&mut self, then: Time) {
        self.1 = self.1.max(then);
    }
}

#[test]
fn the_driver_keeps_every_promise() {
    let axis = |name: &str| Axis {
        name: name.into(),
        min: -1.0,
        max: 1.0,
        max_speed: 1.7,
        max_acceleration: 3.5,
        ..Axis::default()
    };
    let failures = mobee_conformance::failures(&mut || {
        let arm = Arm::new(vec![axis("shoulder"), axis("elbow")], &[0.0, 0.2], 100.0, Box::new(Loopback));
        Box::new(OnTheBench(arm, Time::ZERO))
    });
    assert_eq!(failures, []);
}

#[test]
fn the_behavior_runs_and_holds_all_invariants() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let behavior = Path::new(env!("CARGO_MANIFEST_DIR")).join("my_arm.toml");
    let mobee = |args: &[&str]| {
        let out = Command::new(env!("CARGO_BIN_EXE_my_arm"))
            .args(args)
            .current_dir(folder.path())
            .output()
            .expect("the program starts");
        let text = [out.stdout, out.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
        assert!(out.status.success(), "{args:?}: {text}");
        text
    };
    let behavior = behavior.to_str().expect("a path in UTF-8");
    for kind in ["my_arm", "my_arm_wave", "my_arm_camera"] {
        mobee(&["kinds", kind]);
    }
    mobee(&["check", behavior]);
    mobee(&["run", behavior, "--no-record", "--out", "run"]);
    assert!(mobee(&["check", "run"]).contains("hold"));
    mobee(&["torture", behavior, "--seeds", "3"]);
}
