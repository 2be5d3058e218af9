//! The planted defects still fit the sources: `tools/planted` shows that torture finds each of them.

use std::path::Path;
use std::process::Command;

#[test]
fn every_planted_defect_still_applies() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let inside = Command::new("git").args(["rev-parse", "--is-inside-work-tree"]).current_dir(root).output();
    if !inside.is_ok_and(|out| out.status.success()) {
        eprintln!("skipped: git, or a checkout, is not there");
        return;
    }
    let folder = root.join("tests/planted");
    let mut patches: Vec<_> =
        std::fs::read_dir(folder).expect("the folder").map(|e| e.expect("a file").path()).collect();
    patches.sort();
    assert!(patches.len() >= 12, "{patches:?}");
    for patch in patches {
        let out =
            Command::new("git").args(["apply", "--check"]).arg(&patch).current_dir(root).output().expect("git runs");
        assert!(
            out.status.success(),
            "{} does not apply any more: plant it anew in the changed sources\n{}",
            patch.display(),
            String::from_utf8_lossy(&out.stderr)
        );
    }
}
