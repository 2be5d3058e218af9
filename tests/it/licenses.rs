//! What our dependencies may be used under: the list in `deny.toml`, held against what their manifests say.

use serde_json::Value;
use spdx::{Expression, ParseMode};
use std::fs;
use std::process::Command;

#[test]
fn every_dependency_is_under_a_license_that_we_allow() {
    let deny = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/deny.toml")).expect("the list");
    let deny: toml::Table = deny.parse().expect("a list that can be read");
    let allowed: Vec<&str> =
        deny["licenses"]["allow"].as_array().expect("licenses").iter().filter_map(|l| l.as_str()).collect();
    // of one platform, since only what is built here is sure to be here
    let out = Command::new(env!("CARGO"))
        .args([
            "metadata",
            "--format-version=1",
            "--offline",
            "--locked",
            "--filter-platform",
            "x86_64-unknown-linux-gnu",
        ])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo metadata runs");
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let metadata: Value = serde_json::from_slice(&out.stdout).expect("cargo metadata is JSON");
    let packages = metadata["packages"].as_array().expect("packages");
    assert!(packages.len() > 100, "only {} packages", packages.len());
    for package in packages {
        let (name, license) = (&package["name"], package["license"].as_str().unwrap_or("no license"));
        let expression = Expression::parse_mode(license, ParseMode::LAX).map_err(|e| e.to_string());
        let is_allowed = expression.map(|e| e.evaluate(|r| allowed.contains(&r.to_string().as_str())));
        assert_eq!(is_allowed, Ok(true), "{name} is under {license}: see deny.toml");
    }
}
