//! `mobee kinds`: the registered kinds that a configuration file can name, with docs and settings.

use crate::config::{ConfigError, controller_schema, nearest};
use mobee_contract::{AnyKind, Role, registered};
use mobee_controller::Drive;
use serde_json::Value;
use std::fmt::Write;

/// The kind of an agent that is Python code, which the Python package registers.
pub const PYTHON: &str = "python";

/// A registered kind.
pub struct KindEntry {
    /// Its role.
    pub role: &'static str,
    /// Its name.
    pub name: &'static str,
    /// Its documentation.
    pub doc: &'static str,
    /// Its settings.
    pub schema: Value,
}

/// All registered kinds, by role and name.
pub fn entries() -> Vec<KindEntry> {
    let schema = |k: &dyn AnyKind| match k.role() {
        // a controller's table has the settings of all controllers beside those of its kind
        Drive::NAME => controller_schema(k),
        _ => k.schema().to_value(),
    };
    let entry = |k: &dyn AnyKind| KindEntry { role: k.role(), name: k.name(), doc: k.doc(), schema: schema(k) };
    registered().into_iter().map(entry).collect()
}

/// The defaults of a kind's settings.
pub fn defaults(role: &str, name: &str) -> Vec<(String, Value)> {
    let entry = entries().into_iter().find(|e| e.role == role && e.name == name);
    let properties = entry.and_then(|mut e| match e.schema["properties"].take() {
        Value::Object(map) => Some(map),
        _ => None,
    });
    let default = |(key, s): (String, Value)| Some((key, s.get("default").filter(|d| !d.is_null())?.clone()));
    properties.into_iter().flatten().filter_map(default).collect()
}

/// The listing: all kinds in a line each, or one kind with its settings.
///
/// # Arguments
/// * `expert`: with the settings that are marked in the schema (`"expert": true`): those that few users need.
///
/// # Errors
/// If there is no kind of that name.
pub fn listing(name: Option<&str>, expert: bool) -> Result<String, ConfigError> {
    let all = entries();
    let mut out = String::new();
    let Some(name) = name else {
        for of_role in all.chunk_by(|a, b| a.role == b.role) {
            let _ = writeln!(out, "{}s", of_role.first().map_or("", |e| e.role));
            for e in of_role {
                let _ = writeln!(out, "  {:10} {}", e.name, first_sentence(e.doc));
            }
        }
        let _ = writeln!(out, "\n`mobee kinds NAME` shows one with its settings.");
        return Ok(out);
    };
    let names: Vec<&str> = all.iter().map(|e| e.name).collect();
    let found: Vec<&KindEntry> = all.iter().filter(|e| e.name == name).collect();
    if found.is_empty() {
        let near = nearest(name, &names).map_or(String::new(), |n| format!("did you mean `{n}`? "));
        return Err(ConfigError::plain(
            format!("there is no kind `{name}`"),
            format!("{near}the kinds are: {}", names.join(", ")),
        ));
    }
    // kinds of different roles may share a name
    for (i, e) in found.into_iter().enumerate() {
        let gap = if i > 0 { "\n" } else { "" };
        let _ = writeln!(out, "{gap}{} ({})\n\n{}\n\nsettings", e.name, e.role, e.doc.trim());
        let hidden = rows(&mut out, (&e.schema, expert), &e.schema, 2);
        if !hidden.is_empty() {
            let _ = writeln!(out, "\nfor experts: {}; `mobee kinds {} --all` shows them", hidden.join(", "), e.name);
        }
    }
    Ok(out)
}

/// One line per setting, with those of nested tables indented below. Returns the names of settings that it leaves out,
/// for experts.
fn rows(out: &mut String, (root, expert): (&Value, bool), schema: &Value, indent: usize) -> Vec<String> {
    let mut hidden = Vec::new();
    let required = |key: &str| schema["required"].as_array().is_some_and(|r| r.iter().any(|k| k == key));
    for (key, s) in schema["properties"].as_object().into_iter().flatten().filter(|(key, _)| *key != "kind") {
        if !expert && s["expert"] == true {
            hidden.push(key.clone());
            continue;
        }
        let default = match s.get("default") {
            _ if required(key) => "required".to_owned(),
            Some(d) if !d.is_null() => format!("default {d}"),
            _ => "optional".to_owned(),
        };
        let inner = resolved(root, s);
        let element = [&inner["items"], &inner["additionalProperties"]].map(|e| resolved(root, e));
        let doc = s["description"].as_str().or(inner["description"].as_str()).unwrap_or("").replace('\n', " ");
        let name = type_name(root, s);
        let width = 28usize.saturating_sub(indent);
        let _ = writeln!(out, "{:indent$}{key:width$} {name:10} {default:16} {doc}", "");
        if indent < 8
            && let Some(table) = [inner].into_iter().chain(element).find(|t| t["properties"].is_object())
        {
            hidden.extend(rows(out, (root, expert), table, indent + 2));
        }
    }
    hidden
}

/// Follows a link, or takes the type of an optional value.
fn resolved<'a>(root: &'a Value, schema: &'a Value) -> &'a Value {
    let optional = schema["anyOf"].as_array().and_then(|o| o.iter().find(|o| o["type"] != "null"));
    let schema = optional.unwrap_or(schema);
    schema["$ref"].as_str().and_then(|link| root.pointer(link.strip_prefix('#')?)).unwrap_or(schema)
}

fn first_sentence(doc: &str) -> String {
    let line = doc.trim().replace('\n', " ");
    line.split_once(". ").map_or(line.clone(), |(first, _)| format!("{first}."))
}

fn type_name(root: &Value, schema: &Value) -> String {
    let schema = resolved(root, schema);
    let choices = schema["enum"].as_array().or(schema["oneOf"].as_array()).into_iter().flatten();
    let words: Vec<&str> = choices.filter_map(|c| c.as_str().or(c["const"].as_str())).collect();
    match &schema["type"] {
        _ if !words.is_empty() => words.join("|"),
        Value::String(s) if s == "array" => format!("[{}]", type_name(root, &schema["items"])),
        Value::String(s) if s == "object" => "table".to_owned(),
        Value::String(s) => s.clone(),
        Value::Array(options) => {
            options.iter().filter_map(Value::as_str).filter(|s| *s != "null").collect::<Vec<_>>().join("|")
        }
        _ => "table".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mobee_contract::{Camera, Detector, Locator, kinds};

    #[test]
    fn a_role_has_a_heading_once_it_has_a_kind() {
        let listed = listing(None, false).expect("all of them");
        let schema = crate::schema::text();
        let roles = [
            (<dyn Camera>::NAME, kinds::<dyn Camera>().is_empty()),
            (<dyn Detector>::NAME, kinds::<dyn Detector>().is_empty()),
            (<dyn Locator>::NAME, kinds::<dyn Locator>().is_empty()),
            (<dyn mobee_contract::Bridge>::NAME, false),
        ];
        for (role, empty) in roles {
            assert_eq!(listed.lines().any(|line| line == format!("{role}s")), !empty, "{listed}");
            assert_eq!(schema.contains(&format!("\"{role}_")), !empty, "{role}");
        }
    }

    #[test]
    fn settings_for_experts_are_named_and_shown_on_request() {
        let basic = listing(Some("sim"), false).expect("a kind");
        let all = listing(Some("sim"), true).expect("a kind");
        let line = |text: &str, key: &str| text.lines().any(|line| line.trim_start().starts_with(&format!("{key} ")));
        assert!(line(&basic, "profile") && !line(&basic, "jitter_ms"), "{basic}");
        assert!(basic.contains("for experts: ") && basic.contains("jitter_ms"), "{basic}");
        assert!(line(&all, "jitter_ms") && line(&all, "stiffness_nm_per_rad") && !all.contains("for experts"), "{all}");
    }

    /// A setting that a file must have can't be one for experts.
    #[test]
    fn required_settings_are_basic() {
        for e in entries() {
            let required = e.schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str);
            let hidden: Vec<&str> = required.filter(|key| e.schema["properties"][*key]["expert"] == true).collect();
            assert!(hidden.is_empty(), "{} {}: {hidden:?}", e.role, e.name);
        }
    }
}
