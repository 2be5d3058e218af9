//! One word for one thing: a public type has a name that no other public type of the workspace has, so that a reader who
//! meets it in a message, in a log or in another crate's code knows which one it is.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Names that are defined more than once, and why they may be.
const ALLOWED: &[(&str, &str)] = &[("Contact", "two solids that touch, and YARP's own word for a port's address")];

/// All sources of the workspace that ship: no tests, fuzz targets, examples or benchmarks.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    const ELSEWHERE: &[&str] = &["target", "tests", "fuzz", "examples", "benches", ".git"];
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        let name = path.file_name().and_then(|n| n.to_str()).unwrap_or_default();
        if path.is_dir() && !ELSEWHERE.contains(&name) {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// The name of the public type that a line at the margin defines.
fn defined(line: &str) -> Option<&str> {
    let (kind, rest) = line.strip_prefix("pub ")?.split_once(' ')?;
    let is_type = matches!(kind, "struct" | "enum" | "trait" | "type" | "union");
    is_type.then(|| rest.split(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap_or_default())
}

#[test]
fn a_public_type_name_is_defined_once() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    sources(root, &mut files);
    let mut places: BTreeMap<String, Vec<PathBuf>> = BTreeMap::new();
    for file in files {
        for name in fs::read_to_string(&file).expect("a source").lines().filter_map(defined) {
            let place = file.strip_prefix(root).unwrap_or(&file).to_owned();
            places.entry(name.to_owned()).or_default().push(place);
        }
    }
    assert!(places.len() > 400, "only {} types were found: the search itself is broken", places.len());
    let allowed = |name: &str| ALLOWED.iter().any(|(n, _)| *n == name);
    let doubled: Vec<_> = places.iter().filter(|(name, at)| at.len() > 1 && !allowed(name)).collect();
    assert!(doubled.is_empty(), "name one of each so that it says what it is: {doubled:#?}");
    for (name, why) in ALLOWED {
        assert!(
            places.get(*name).is_some_and(|at| at.len() > 1),
            "{name} ({why}) is defined once: strike it from the list"
        );
    }
}
