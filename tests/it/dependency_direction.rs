//! The paper's claim that Agent and Controller do not depend on each other, made executable: which crate may use which
//! (the table in ARCHITECTURE.md).

use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::Command;

/// Crate, and the crates of ours that it may use.
const ALLOWED: &[(&str, &[&str])] = &[
    ("mobee-text", &[]),
    ("mobee-yarp", &[]),
    ("mobee-model", &["mobee-text"]),
    ("mobee-fast", &["mobee-model"]),
    ("mobee-import", &["mobee-model", "mobee-text"]),
    ("mobee-contract", &["mobee-model"]),
    ("mobee-controller", &["mobee-contract", "mobee-model"]),
    ("mobee-journal", &["mobee-contract", "mobee-model"]),
    ("mobee-planning", &["mobee-contract", "mobee-fast", "mobee-model"]),
    ("mobee-agents", &["mobee-contract", "mobee-fast", "mobee-model", "mobee-planning"]),
    ("mobee-sensing", &["mobee-contract", "mobee-model"]),
    ("mobee-sim", &["mobee-contract", "mobee-model"]),
    // its boards in virtual time, and those of `mobee sim`, are simulated arms
    ("mobee-driver-yarp", &["mobee-contract", "mobee-model", "mobee-sim", "mobee-yarp"]),
    ("mobee-feetech", &["mobee-contract", "mobee-model", "mobee-sim"]),
    ("mobee-mujoco", &["mobee-contract", "mobee-model", "mobee-sim"]),
    ("mobee-conformance", &["mobee-contract"]),
    ("mobee-filter", &["mobee-contract", "mobee-model"]),
    ("mobee-bridge-yarp", &["mobee-contract", "mobee-filter", "mobee-model", "mobee-yarp"]),
    ("mobee-runtime", &["mobee-contract", "mobee-controller", "mobee-journal", "mobee-model"]),
    // the surfaces of an imported robot are drawn as its file has them
    ("mobee-recorder", &["mobee-contract", "mobee-import", "mobee-model"]),
    (
        "mobee-compose",
        &[
            "mobee-agents",
            "mobee-bridge-yarp",
            "mobee-contract",
            "mobee-controller",
            "mobee-driver-yarp",
            "mobee-model",
            "mobee-planning",
            "mobee-runtime",
            "mobee-sensing",
            "mobee-sim",
        ],
    ),
    (
        "mobee-cli",
        &[
            "mobee-agents",
            "mobee-bridge-yarp",
            "mobee-compose",
            "mobee-contract",
            "mobee-controller",
            "mobee-driver-yarp",
            "mobee-feetech",
            "mobee-import",
            "mobee-journal",
            "mobee-model",
            "mobee-mujoco",
            "mobee-planning",
            "mobee-recorder",
            "mobee-runtime",
            "mobee-sensing",
            "mobee-sim",
            "mobee-yarp",
        ],
    ),
    ("mobee", &["mobee-cli", "mobee-compose"]),
    (
        "mobee-python",
        &[
            "mobee",
            "mobee-conformance",
            "mobee-contract",
            "mobee-fast",
            "mobee-import",
            "mobee-journal",
            "mobee-model",
            "mobee-planning",
            "mobee-runtime",
            "mobee-sim",
        ],
    ),
    // as a crate outside of this repository
    ("my_arm", &["mobee", "mobee-contract", "mobee-sim"]),
];

/// Crate, and a dependency that no line of it names: it is there for the features that it asks for.
const UNNAMED: &[(&str, &str)] = &[
    ("mobee-cli", "bytemuck"),
    ("mobee-recorder", "getrandom"),
    ("mobee-recorder", "libc"),
    ("mobee-model", "num-complex"),
    ("mobee-model", "num-integer"),
    ("mobee-recorder", "regex"),
    // its build script does
    ("mobee-python", "pyo3-build-config"),
];

fn packages() -> Vec<Value> {
    let out = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version=1", "--no-deps", "--offline"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo metadata runs");
    let mut metadata: Value = serde_json::from_slice(&out.stdout).expect("cargo metadata is JSON");
    serde_json::from_value(metadata["packages"].take()).expect("packages")
}

#[test]
fn crates_use_only_what_the_table_allows() {
    let packages = packages();
    let seen: BTreeSet<&str> = packages.iter().filter_map(|p| p["name"].as_str()).collect();
    let listed: BTreeSet<&str> = ALLOWED.iter().map(|(name, _)| *name).collect();
    assert_eq!(seen, listed, "the table names every crate of the workspace, and no other");
    for package in &packages {
        let name = package["name"].as_str().expect("a name");
        let allowed = ALLOWED.iter().find(|(n, _)| *n == name).expect("in the table").1;
        for dependency in package["dependencies"].as_array().expect("dependencies") {
            let used = dependency["name"].as_str().expect("a name");
            // tests may use more: what is tested together is not what ships together
            if dependency["kind"].is_null() && used.starts_with("mobee") {
                assert!(allowed.contains(&used), "{name} may not use {used}");
            }
            assert!(used != "rerun" || name == "mobee-recorder", "only the recorder names rerun, not {name}");
        }
    }
}

/// The pure crates: what decides has no mailbox, no thread and no socket, whatever comes later.
const PURE: &[&str] = &[
    "mobee-agents",
    "mobee-contract",
    "mobee-controller",
    "mobee-fast",
    "mobee-filter",
    "mobee-import",
    "mobee-journal",
    "mobee-model",
    "mobee-planning",
    "mobee-sensing",
    "mobee-text",
];

/// Libraries of a program's terminal and of its recording, which the crates that a program embeds must not bring along.
const TERMINAL: &[&str] = &["clap", "miette", "indicatif", "rerun"];

/// `mobee-compose` is for programs that print as they like: with its default features it brings no command line and no
/// recorder along, however deep in its dependencies.
#[test]
fn what_a_program_embeds_has_no_terminal() {
    let out = Command::new(env!("CARGO"))
        .args(["tree", "--offline", "--package=mobee-compose", "--edges=normal", "--prefix=none", "--format={p}"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo tree runs");
    let tree = String::from_utf8(out.stdout).expect("text");
    let names: BTreeSet<&str> = tree.lines().filter_map(|line| line.split(' ').next()).collect();
    assert!(names.contains("mobee-runtime"), "{tree}{}", String::from_utf8_lossy(&out.stderr));
    let found: Vec<&&str> = TERMINAL.iter().filter(|name| names.contains(*name)).collect();
    assert!(found.is_empty(), "{found:?}");
}

#[test]
fn pure_crates_know_no_actor_library_and_no_runtime() {
    let packages = packages();
    for pure in PURE {
        let package = packages.iter().find(|p| p["name"] == *pure).expect("in the workspace");
        for dependency in package["dependencies"].as_array().expect("dependencies") {
            let used = dependency["name"].as_str().expect("a name");
            assert!(!["ractor", "tokio", "rerun", "tracing"].contains(&used), "{pure} is pure and may not use {used}");
        }
    }
}

/// A dependency that nobody uses hides what a crate really depends on.
#[test]
fn crates_use_whatever_they_depend_on() {
    let mut unused = Vec::new();
    for package in packages() {
        let name = package["name"].as_str().expect("a name");
        let manifest = Path::new(package["manifest_path"].as_str().expect("a path"));
        let folder = manifest.parent().expect("a folder");
        let shipped = sources(folder, &["src"]);
        let tested = sources(folder, &["src", "tests", "benches", "examples"]);
        for dependency in package["dependencies"].as_array().expect("dependencies") {
            let used = dependency["name"].as_str().expect("a name");
            let text = if dependency["kind"].is_null() { &shipped } else { &tested };
            if !names(text, &used.replace('-', "_")) && !UNNAMED.contains(&(name, used)) {
                unused.push(format!("{name}: {used}"));
            }
        }
    }
    assert!(unused.is_empty(), "strike these from the manifests: {unused:#?}");
}

/// The Rust files of a package under these of its folders, as one text.
fn sources(folder: &Path, parts: &[&str]) -> String {
    let mut text = String::new();
    let mut open: Vec<_> = parts.iter().map(|part| folder.join(part)).collect();
    while let Some(path) = open.pop() {
        if let Ok(entries) = fs::read_dir(&path) {
            open.extend(entries.map(|entry| entry.expect("an entry").path()));
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            text.push_str(&fs::read_to_string(&path).expect("a source"));
        }
    }
    text
}

/// Whether the text has the path `name::`, or brings it in by `use name;` or `use name as`.
fn names(text: &str, name: &str) -> bool {
    let in_word = |c: char| c.is_alphanumeric() || c == '_';
    text.match_indices(name).any(|(at, _)| {
        let after = &text[at + name.len()..];
        !text[..at].ends_with(in_word) && ["::", ";", " as "].iter().any(|end| after.starts_with(end))
    })
}
