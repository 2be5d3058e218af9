//! Third-party robots: every URDF of `example-robot-data` and `icub-models` converts, or is reported as broken with the
//! reason.
//!
//! `tests/robots/install.sh` downloads them; `MOBEE_ROBOTS` names the folder.

use mobee_import::{UrdfOptions, load_surfaces, load_urdf};

use mobee_model::{parse_robot, write_robot};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Files that are broken or incomplete, with the line and the message for each.
const BROKEN: &[(&str, usize, &str)] = &[
    // Its hands are macros whose joints were renamed, but not the references to their leaders.
    ("alex_psyonic_hands.urdf", 1030, "joint `Left_index_q2` mimics `index_q1`, which does not exist"),
    (
        "ur_description/urdf/ur3.urdf",
        6,
        "there is no link: this is what xacro makes of a file that only defines macros",
    ),
];

/// The installed robots; empty, with a printed reason, if they could not be downloaded.
pub fn installed() -> Option<PathBuf> {
    let home = std::env::var_os("MOBEE_ROBOTS").map(PathBuf::from);
    let home = home.or_else(|| Some(PathBuf::from(std::env::var_os("HOME")?).join(".cache/mobee/robots-1")))?;
    if home.join(".installed").exists() {
        return Some(home.join("share"));
    }
    eprintln!("SKIPPED: no robots in {}; tests/robots/install.sh fetches them", home.display());
    None
}

/// All files below a folder with this extension, sorted.
pub fn files(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    let (folders, entries): (Vec<_>, Vec<_>) = entries.into_iter().partition(|p| p.is_dir());
    let here = entries.into_iter().filter(|p| p.extension().is_some_and(|e| e == extension));
    folders.iter().flat_map(|f| files(f, extension)).chain(here).collect()
}

#[test]
fn every_robot_converts_or_is_told_to_be_broken() {
    let Some(share) = installed() else { return };
    let files = files(&share, "urdf");
    assert_eq!(files.len(), 85, "69 of example-robot-data 6.0.0 and 16 of icub-models 3.2.0");
    let next = AtomicUsize::new(0);
    let work = || {
        let mut wrong = Vec::new();
        while let Some(path) = files.get(next.fetch_add(1, Ordering::Relaxed)) {
            let name = path.strip_prefix(&share).unwrap().display().to_string();
            if let Err(what) = judge(&name, path) {
                wrong.push(format!("{name}: {what}"));
            }
        }
        wrong
    };
    let mut wrong: Vec<String> = std::thread::scope(|s| {
        let threads: Vec<_> = (0..2).map(|_| s.spawn(work)).collect();
        threads.into_iter().flat_map(|t| t.join().unwrap()).collect()
    });
    wrong.sort();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Checks that a file converts to a robot that can be read back, or is broken in the known way.
fn judge(name: &str, path: &Path) -> Result<(), String> {
    let broken = BROKEN.iter().find(|(file, ..)| name.ends_with(file));
    // Meshes are read, but not fitted: the fit is tested elsewhere, and takes time.
    let read = load_surfaces(path, &UrdfOptions::default());
    let without_meshes = UrdfOptions { drop_meshes: true, ..UrdfOptions::default() };
    match (read.and_then(|_| load_urdf(path, &without_meshes)), broken) {
        (Ok(loaded), None) => {
            let text = write_robot(&loaded.value);
            parse_robot("converted.xml", &text).map_err(|e| format!("cannot be read back: {e}"))?;
            Ok(())
        }
        (Ok(_), Some(_)) => Err("converts, and is in the list of broken files".to_owned()),
        (Err(e), None) => Err(format!("{e} ({})", e.remedy())),
        (Err(e), Some((_, line, message))) if e.line() == *line && e.message().contains(message) => Ok(()),
        (Err(e), Some(_)) => Err(format!("is broken in another way than is known: {e}")),
    }
}
