//! The planted defects still fit the sources, all of them together: `tools/planted` shows who finds each of them.

#[path = "../planted/plant.rs"]
mod plant;

use std::collections::BTreeSet;
use std::path::Path;

#[test]
fn all_planted_defects_fit_the_sources_together() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let defects = plant::defects(&root.join("tests/planted")).expect("what tests/planted describes");
    let names: BTreeSet<&str> = defects.iter().map(|d| d.name.as_str()).collect();
    assert_eq!(names.len(), defects.len(), "two have one name");
    assert!(names.len() >= 100, "{names:?}");
    if let Err(wrong) = plant::plant(root, &defects) {
        panic!("plant them anew in the changed sources:\n{wrong}");
    }
}

/// What ships has no switch: defects are in a copy of the sources only.
#[test]
fn the_shipped_sources_have_no_defects_to_switch_on() {
    let library = include_str!("../../model/core/src/lib.rs");
    assert!(!library.contains("planted"), "the switch belongs into the copy that tools/planted makes");
}
