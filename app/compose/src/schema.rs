//! `mobee schema`: the JSON Schema of a configuration file, with the settings of every registered kind. The same schema
//! checks the shape of files when they are read, so the two can't differ.

use crate::config::Config;
use crate::kinds::{KindEntry, entries};
use mobee_contract::Role;
use mobee_controller::{DEFAULT_KIND, Drive};
use serde_json::{Map, Value, json};
use std::sync::OnceLock;

/// The schema of a whole file, in draft 7, which editors support best.
pub fn whole() -> &'static Value {
    static WHOLE: OnceLock<Value> = OnceLock::new();
    WHOLE.get_or_init(make)
}

/// The schema as text.
pub fn text() -> String {
    serde_json::to_string_pretty(whole()).unwrap_or_default() + "\n"
}

fn make() -> Value {
    let mut root = schemars::schema_for!(Config).to_value();
    let mut definitions = taken(&mut root, "$defs");
    let mut roles: Vec<(&str, Vec<Value>)> = Vec::new();
    for KindEntry { role, name, doc, mut schema } in entries() {
        let id = format!("{role}_{name}");
        for (key, inner) in taken(&mut schema, "$defs") {
            definitions.insert(format!("{id}_{key}"), relinked(inner, &id));
        }
        let mut schema = relinked(schema, &id);
        schema["properties"]["kind"] = json!({ "const": name, "description": doc });
        let needed = (role != Drive::NAME || name != DEFAULT_KIND).then(|| json!("kind"));
        let required = schema["required"].as_array().cloned().unwrap_or_default();
        schema["required"] = required.into_iter().chain(needed).collect();
        schema["description"] = doc.into();
        definitions.insert(id.clone(), schema);
        let link = json!({ "$ref": format!("#/$defs/{id}") });
        match roles.iter_mut().find(|(known, _)| *known == role) {
            Some((_, links)) => links.push(link),
            None => roles.push((role, vec![link])),
        }
    }
    for (role, links) in roles {
        // a role is a key of each robot, sensor or eye, or a list of tables at the top level
        let holder = ["Robot", "Sensor", "Eye"].into_iter().find(|h| !definitions[*h]["properties"][role].is_null());
        let property = match holder.and_then(|h| definitions.get_mut(h)) {
            Some(holder) => &mut holder["properties"][role],
            None => match root["properties"].get_mut(role) {
                Some(tables) => &mut tables["items"],
                None => continue,
            },
        };
        let text = |key: &str| property.get(key).cloned();
        *property = json!({ "description": text("description"), "default": text("default"), "oneOf": links });
        if let Value::Object(map) = property {
            map.retain(|_, v| !v.is_null());
        }
    }
    definitions.remove("Controller");
    root["$defs"] = Value::Object(definitions);
    let mut root = draft7(root);
    root["$schema"] = "http://json-schema.org/draft-07/schema#".into();
    root["title"] = "MoBeE configuration".into();
    root
}

/// Takes a table out of an object.
fn taken(value: &mut Value, key: &str) -> Map<String, Value> {
    match value.as_object_mut().and_then(|map| map.remove(key)) {
        Some(Value::Object(map)) => map,
        _ => Map::new(),
    }
}

/// A schema whose links to its own definitions have the prefix `id`, as in the whole schema.
fn relinked(value: Value, id: &str) -> Value {
    mapped(value, &|key, v| match v {
        Value::String(link) if key == "$ref" => Value::String(link.replace("#/$defs/", &format!("#/$defs/{id}_"))),
        other => other,
    })
}

/// Converts to draft 7, which has another name for definitions, and ignores keys beside a link.
fn draft7(value: Value) -> Value {
    let renamed = mapped(value, &|key, v| match v {
        Value::String(link) if key == "$ref" => Value::String(link.replace("#/$defs/", "#/definitions/")),
        Value::Object(mut map) => {
            if let Some(link) = map.get("$ref").filter(|l| l.is_string() && map.len() > 1).cloned() {
                map.remove("$ref");
                map.insert("allOf".into(), json!([{ "$ref": link }]));
            }
            Value::Object(map)
        }
        other => other,
    });
    let mut root = renamed;
    let definitions = taken(&mut root, "$defs");
    root["definitions"] = Value::Object(definitions);
    root
}

/// Changes every value with its key (no key for elements of lists), inner values first.
fn mapped(value: Value, change: &impl Fn(&str, Value) -> Value) -> Value {
    match value {
        Value::Object(map) => map
            .into_iter()
            .map(|(k, v)| {
                let v = change(&k, mapped(v, change));
                (k, v)
            })
            .collect(),
        Value::Array(list) => list.into_iter().map(|v| change("", mapped(v, change))).collect(),
        leaf => leaf,
    }
}
