//! The schema that editors get is the one that files are checked by: every shipped file fits it, mistakes of its sort do not.

use mobee::config::{Source, misfits};
use mobee_contract::registered;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// What our checker understands. A keyword that it does not know would promise editors what nobody checks.
const KEYWORDS: &[&str] = &[
    "$ref",
    "$schema",
    "additionalProperties",
    "allOf",
    "anyOf",
    "const",
    "default",
    "definitions",
    "description",
    "enum",
    // marks settings that `mobee kinds` shows on request
    "expert",
    "format",
    "items",
    "maxItems",
    "maximum",
    "minItems",
    "minimum",
    "oneOf",
    "properties",
    "required",
    "title",
    "type",
    "writeOnly",
];

fn tomls(folder: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(folder)).expect("the folder");
    let files = entries.map(|e| e.expect("an entry").path());
    files.filter(|p| p.extension().is_some_and(|e| e == "toml")).collect()
}

fn walk(schema: &Value, root: &Value, unknown: &mut BTreeSet<String>) {
    let Value::Object(map) = schema else { return };
    for (key, value) in map {
        if !KEYWORDS.contains(&key.as_str()) {
            unknown.insert(key.clone());
        }
        match (key.as_str(), value) {
            ("$ref", Value::String(link)) => {
                assert!(root.pointer(link.trim_start_matches('#')).is_some(), "{link} leads nowhere");
            }
            ("properties" | "definitions", Value::Object(inner)) => inner.values().for_each(|s| walk(s, root, unknown)),
            ("oneOf" | "anyOf" | "allOf", Value::Array(list)) => list.iter().for_each(|s| walk(s, root, unknown)),
            ("items" | "additionalProperties", inner) => walk(inner, root, unknown),
            _ => {}
        }
    }
}

#[test]
fn the_schema_is_whole_and_names_every_kind() {
    let schema = mobee::schema::whole();
    let mut unknown = BTreeSet::new();
    walk(schema, schema, &mut unknown);
    assert!(unknown.is_empty(), "keywords that files are not checked by: {unknown:?}");
    for (role, name) in registered().iter().map(|k| (k.role(), k.name())) {
        assert_eq!(schema["definitions"][format!("{role}_{name}")]["properties"]["kind"]["const"], name);
    }
}

#[test]
fn shipped_files_fit_and_mistakes_do_not() {
    let fits = |file: &Path| {
        let source = Source::load(file, &[]).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
        misfits(mobee::schema::whole(), &source.value)
    };
    for file in tomls("configs/behaviors").into_iter().chain(tomls("configs/robots")) {
        let wrong = fits(&file);
        assert!(wrong.is_empty(), "{}: {wrong:?}", file.display());
    }
    let mut judged = 0;
    for file in tomls("tests/broken") {
        let name = file.file_stem().expect("a name").to_string_lossy().into_owned();
        if ["key_", "missing_", "type_", "kind_"].iter().any(|sort| name.starts_with(sort)) {
            assert!(!fits(&file).is_empty(), "{name}");
            judged += 1;
        }
    }
    assert!(judged >= 40, "{judged} files are of the sort that a schema can tell");
}
