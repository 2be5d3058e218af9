//! A run is its user's alone: whatever the umask nobody else can look into its folder, and no folder of somebody else is used.

use super::common::{mobee_here, said, text};
use std::os::unix::fs::{MetadataExt, PermissionsExt, chown};
use std::path::Path;
use std::process::Command;

/// A user that owns nothing.
pub(super) const NOBODY: u32 = 65_534;

/// Whether this is the user that may become any other; said plainly if not.
pub(super) fn is_root(of: &Path) -> bool {
    let root = of.metadata().expect("a folder").uid() == 0;
    if !root {
        eprintln!("SKIPPED: only root can try what another user may do");
    }
    root
}

fn mode(path: &Path) -> u32 {
    path.metadata().expect("it is there").permissions().mode() & 0o7777
}

#[test]
fn nobody_else_can_look_into_a_run() {
    let dir = tempfile::tempdir().expect("a folder");
    for umask in ["000", "077", "177"] {
        let out = dir.path().join(umask);
        let line = format!("umask {umask}; exec \"$0\" run configs/behaviors/ball.toml --for 2 --out \"$1\"");
        let mut shell = Command::new("sh");
        shell.args(["-c", &line, env!("CARGO_BIN_EXE_mobee"), text(&out)]);
        let ran = shell.current_dir(env!("CARGO_MANIFEST_DIR")).output().expect("sh starts");
        assert!(ran.status.success(), "{}", said(&ran));
        assert_eq!(mode(&out), 0o700);
        let files: Vec<_> = out.read_dir().expect("a folder").flatten().map(|e| e.path()).collect();
        assert!(files.len() > 3, "{files:?}");
        for file in files {
            assert_eq!(mode(&file), 0o600, "umask {umask}: {}", file.display());
        }
    }
}

#[test]
fn a_folder_of_somebody_else_is_not_used() {
    let dir = tempfile::tempdir().expect("a folder");
    if !is_root(dir.path()) {
        return;
    }
    let theirs = dir.path().join("theirs");
    std::fs::create_dir(&theirs).expect("a folder");
    chown(&theirs, Some(NOBODY), Some(NOBODY)).expect("given away");
    let link = dir.path().join("link");
    std::os::unix::fs::symlink(&theirs, &link).expect("a link");
    for out in [&theirs, &link] {
        let ran = mobee_here().args(["run", "configs/behaviors/ball.toml", "--for", "1", "--out", text(out)]).output();
        let ran = ran.expect("mobee starts");
        assert_eq!(ran.status.code(), Some(2), "{}", said(&ran));
        assert!(said(&ran).contains("another user"), "{}", said(&ran));
        assert_eq!(theirs.read_dir().expect("a folder").count(), 0, "nothing half-made stays");
    }
}
