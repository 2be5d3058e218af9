//! A run with a real clock is looked at, exchanged in part, paused and stopped by `mobee ctl`, without a name server.

use std::path::Path;
use std::process::{Child, Command, Output, Stdio};

fn mobee() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mobee"));
    command.current_dir(env!("CARGO_MANIFEST_DIR"));
    command
}

struct Run {
    child: Child,
    out: std::path::PathBuf,
}

impl Run {
    fn start(dir: &Path) -> Run {
        let out = dir.join("run");
        let child = mobee()
            .args(["run", "configs/behaviors/explore.toml", "--clock", "real", "--for", "120", "--no-record", "--json"])
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

    fn ctl(&self, words: &[&str]) -> Output {
        mobee().args(["ctl", "--run"]).arg(&self.out).args(words).output().expect("mobee starts")
    }

    fn says(&self, words: &[&str]) -> String {
        let out = self.ctl(words);
        assert!(out.status.success(), "{words:?}: {}", String::from_utf8_lossy(&out.stderr));
        String::from_utf8_lossy(&out.stdout).into_owned()
    }

    fn refuses(&self, words: &[&str]) -> String {
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
    let file = |name: &str, setting: &str| {
        let text = format!("include = [{shipped:?}]\n[[robot]]\nname = \"icub\"\n[robot.agent]\n{setting}\n");
        let path = dir.path().join(name);
        std::fs::write(&path, text).expect("a file");
        path.display().to_string()
    };
    let (faster, wrong) = (file("faster.toml", "speed = 0.4"), file("wrong.toml", "sped = 0.4"));
    let mut run = Run::start(dir.path());

    let status = run.says(&["status"]);
    assert!(status.starts_with("icub  ARMED"), "{status}");
    assert!(status.contains("icub/supervise") && status.contains("icub/driver>history"), "{status}");

    let swapped = run.says(&["swap", "--robot", "icub", "agent", &faster, "--shadow", "0.5", "--probation", "0.5"]);
    assert!(swapped.contains("took over") || swapped.contains("settled"), "{swapped}");
    let why = run.refuses(&["swap", "agent", &wrong]);
    assert!(why.contains("did you mean `speed`?") && why.contains("wrong.toml:5"), "{why}");
    let why = run.refuses(&["swap", "--robot", "icup", "agent", &faster]);
    assert!(why.contains("there are: icub"), "{why}");
    let why = run.refuses(&["swap", "agent", "configs/behaviors/nothing.toml"]);
    assert!(why.contains("nothing.toml"), "{why}");

    assert!(run.says(&["pause"]).contains("icub: its agent pauses"));
    assert!(run.says(&["status"]).contains("its agent is paused"));
    run.says(&["resume", "icub"]);
    run.says(&["world", "mk", "ssph", "0.05", "-2", "-2", "0.5"]);
    assert!(run.says(&["world", "ls"]).contains("ssph1"));
    run.refuses(&["record", "off"]);
    run.says(&["recover"]);
    run.says(&["stop"]);
    assert!(run.child.wait().expect("an end").success());
    run.refuses(&["status"]);
    let checked = mobee().arg("check").arg(&run.out).output().expect("mobee starts");
    assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stdout));
}
