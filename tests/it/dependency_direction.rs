//! The paper's claim that Agent and Controller do not depend on each other, made executable: which crate may use which
//! (the table in ARCHITECTURE.md).

use serde_json::Value;
use std::collections::BTreeSet;
use std::process::Command;

/// Crate, and the crates of ours that it may use.
const ALLOWED: &[(&str, &[&str])] = &[
    ("mobee-model", &[]),
    ("mobee-contract", &["mobee-model"]),
    ("mobee-behaviors", &["mobee-contract", "mobee-model"]),
    ("mobee-yarp", &[]),
    ("mobee-drivers", &["mobee-contract", "mobee-model", "mobee-yarp"]),
    ("mobee-actors", &["mobee-contract", "mobee-model", "mobee-behaviors"]),
    ("mobee-recorder", &["mobee-contract", "mobee-model"]),
    (
        "mobee",
        &[
            "mobee-model",
            "mobee-contract",
            "mobee-behaviors",
            "mobee-drivers",
            "mobee-yarp",
            "mobee-actors",
            "mobee-recorder",
        ],
    ),
];

#[test]
fn crates_use_only_what_the_table_allows() {
    let out = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version=1", "--no-deps", "--offline"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo metadata runs");
    let metadata: Value = serde_json::from_slice(&out.stdout).expect("cargo metadata is JSON");
    let packages = metadata["packages"].as_array().expect("packages");
    let seen: BTreeSet<&str> = packages.iter().filter_map(|p| p["name"].as_str()).collect();
    let listed: BTreeSet<&str> = ALLOWED.iter().map(|(name, _)| *name).collect();
    assert_eq!(seen, listed, "the table names every crate of the workspace, and no other");
    for package in packages {
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
