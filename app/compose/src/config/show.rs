//! `mobee config show`: the resolved configuration as TOML, each value with its origin.

use super::layer::LayerNode;
use super::{Complaints, Config, Source};
use crate::kinds::defaults;
use serde_json::{Map, Value};
use std::fmt::Write;
use std::path::Path;

/// The resolved configuration of a file as equivalent TOML, with the origin of every value as a comment.
///
/// # Errors
/// As for [`Config::load`].
pub fn text(path: &Path, set: &[String]) -> Result<String, Complaints> {
    let (config, source) = Config::load(path, set)?;
    let mut value = serde_json::to_value(&config).unwrap_or_default();
    for robot in value["robot"].as_array_mut().into_iter().flatten() {
        for role in ["driver", "agent", "controller"] {
            if let Some(Value::Object(table)) = robot.get_mut(role) {
                for (key, default) in defaults(role, table.get("kind").and_then(Value::as_str).unwrap_or_default()) {
                    table.entry(key).or_insert(default);
                }
            }
        }
    }
    let mut shown = TomlWriter { source: &source, out: String::new() };
    if let Value::Object(map) = &value {
        shown.table(map, Some(source.root()), &[]);
    }
    Ok(shown.out)
}

struct TomlWriter<'a> {
    source: &'a Source,
    out: String,
}

impl TomlWriter<'_> {
    fn table(&mut self, map: &Map<String, Value>, node: Option<&LayerNode>, path: &[String]) {
        let child = |key: &str| node.and_then(|n| n.child(key));
        // values first: a key after the header of a table would belong to that table
        for (key, value) in map.iter().filter(|(_, v)| !is_section(v)) {
            if !value.is_null() {
                self.line(key, value, child(key));
            }
        }
        for (key, value) in map.iter().filter(|(_, v)| is_section(v)) {
            let here: Vec<String> = path.iter().cloned().chain([quoted(key)]).collect();
            match value {
                Value::Object(map) => {
                    let _ = writeln!(self.out, "\n[{}]", here.join("."));
                    self.table(map, child(key), &here);
                }
                Value::Array(list) => {
                    for (i, element) in list.iter().enumerate() {
                        let _ = writeln!(self.out, "\n[[{}]]", here.join("."));
                        if let Value::Object(map) = element {
                            self.table(map, child(key).and_then(|n| n.child(&i.to_string())), &here);
                        }
                    }
                }
                _ => {}
            }
        }
    }

    fn line(&mut self, key: &str, value: &Value, node: Option<&LayerNode>) {
        let origin = node.map_or("default".into(), |n| self.source.describe(&n.origin));
        let _ = writeln!(self.out, "{} = {}  # {origin}", quoted(key), inline(value));
    }
}

/// True for values with a header of their own: tables, and lists of tables.
fn is_section(value: &Value) -> bool {
    match value {
        Value::Object(_) => true,
        Value::Array(list) => !list.is_empty() && list.iter().all(Value::is_object),
        _ => false,
    }
}

fn quoted(key: &str) -> String {
    let bare = !key.is_empty() && key.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-');
    if bare { key.to_owned() } else { toml::Value::String(key.to_owned()).to_string() }
}

/// A value on one line.
fn inline(value: &Value) -> String {
    match value {
        Value::String(s) => toml::Value::String(s.clone()).to_string(),
        Value::Array(list) => format!("[{}]", list.iter().map(inline).collect::<Vec<_>>().join(", ")),
        Value::Object(map) => {
            let entries = map.iter().filter(|(_, v)| !v.is_null());
            let entries: Vec<String> = entries.map(|(k, v)| format!("{} = {}", quoted(k), inline(v))).collect();
            format!("{{ {} }}", entries.join(", "))
        }
        other => other.to_string(),
    }
}
