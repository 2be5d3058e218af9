//! Checks that values match the schema: keys, types and choices. Reports all mismatches at once.

use super::complaints::MAX_COMPLAINTS;
use crate::kinds::PYTHON;
use mobee_contract::{nearest, suggestion};
use serde_json::{Map, Value};

/// A value that does not match.
#[derive(Clone, Debug, PartialEq)]
pub struct Misfit {
    /// Keys and indices that lead to it.
    pub steps: Vec<String>,
    /// True if the key is wrong, not the value.
    pub at_key: bool,
    /// The problem.
    pub what: String,
    /// The remedy.
    pub help: String,
}

/// All values that do not match the schema.
pub fn misfits(schema: &Value, value: &Value) -> Vec<Misfit> {
    let mut walk = SchemaCheck { root: schema, steps: Vec::new(), found: Vec::new() };
    walk.value(schema, value);
    walk.found
}

struct SchemaCheck<'a> {
    root: &'a Value,
    steps: Vec<String>,
    found: Vec<Misfit>,
}

impl<'a> SchemaCheck<'a> {
    fn complain(&mut self, at_key: bool, what: String, help: String) {
        self.found.push(Misfit { steps: self.steps.clone(), at_key, what, help });
    }

    fn within(&mut self, step: &str, then: impl FnOnce(&mut Self)) {
        self.steps.push(step.to_owned());
        then(self);
        self.steps.pop();
    }

    /// Follows a schema's links.
    fn resolve(&self, mut schema: &'a Value) -> &'a Value {
        // links don't nest deeper than types do
        for _ in 0..16 {
            let link = schema["$ref"].as_str().or_else(|| schema["allOf"][0]["$ref"].as_str());
            match link.and_then(|l| self.root.pointer(l.strip_prefix('#')?)) {
                Some(found) => schema = found,
                None => break,
            }
        }
        schema
    }

    fn value(&mut self, schema: &'a Value, value: &Value) {
        let outer = schema;
        let mut schema = self.resolve(schema);
        if let Some(options) = schema["anyOf"].as_array() {
            // an optional value; TOML has no null
            let Some(some) = options.iter().find(|o| o["type"] != "null") else { return };
            schema = self.resolve(some);
        }
        let doc = outer["description"].as_str().or(schema["description"].as_str()).unwrap_or_default();
        if let Some(options) = schema["oneOf"].as_array() {
            let options: Vec<&Value> = options.iter().map(|o| self.resolve(o)).collect();
            return self.choice(&options, value, doc);
        }
        if let Some(words) = schema["enum"].as_array() {
            return self.word(&words.iter().filter_map(Value::as_str).collect::<Vec<_>>(), value);
        }
        let expected = types(schema);
        match value {
            _ if !fits(value, &expected) => self.mistyped(value, &expected, doc),
            Value::Object(map) => self.table(schema, map),
            Value::Array(list) => self.list(schema, list, doc),
            Value::Number(n) => {
                let least = schema["minimum"].as_f64();
                let most = schema["maximum"].as_f64();
                let n = n.as_f64().unwrap_or_default();
                if let Some(least) = least.filter(|least| n < *least) {
                    self.complain(false, format!("{n} is below {least}"), format!("give a number of {least} or more"));
                }
                if let Some(most) = most.filter(|most| n > *most) {
                    self.complain(false, format!("{n} is above {most}"), format!("give a number up to {most}"));
                }
            }
            _ => {}
        }
    }

    fn mistyped(&mut self, value: &Value, expected: &[&str], doc: &str) {
        let names: Vec<&str> = expected.iter().map(|t| name(t)).collect();
        let help = [hint(value, expected), doc.replace('\n', " ")];
        let help: Vec<String> = help.into_iter().filter(|h| !h.is_empty()).collect();
        self.complain(false, format!("expected {}, found {}", names.join(" or "), given(value)), help.join("\n"));
    }

    fn list(&mut self, schema: &'a Value, list: &[Value], doc: &str) {
        let least = schema["minItems"].as_u64();
        let most = schema["maxItems"].as_u64();
        let n = list.len() as u64;
        if least.is_some_and(|least| n < least) || most.is_some_and(|most| n > most) {
            let wanted = least.or(most).unwrap_or(0);
            let help = if doc.is_empty() { format!("give {wanted} values") } else { doc.replace('\n', " ") };
            self.complain(false, format!("expected {wanted} values, found {n}"), help);
        }
        for (i, element) in list.iter().enumerate() {
            if self.found.len() >= MAX_COMPLAINTS {
                return;
            }
            self.within(&i.to_string(), |w| w.value(&schema["items"], element));
        }
    }

    fn table(&mut self, schema: &'a Value, map: &Map<String, Value>) {
        let none = Map::new();
        let known = schema["properties"].as_object();
        let names: Vec<&str> = known.unwrap_or(&none).keys().map(String::as_str).collect();
        let mut meant = Vec::new();
        // null is never written; it occurs only in values that were resolved before
        for (key, value) in map.iter().filter(|(_, value)| !value.is_null()) {
            if self.found.len() >= MAX_COMPLAINTS {
                return;
            }
            match (known.and_then(|k| k.get(key)), schema.get("additionalProperties")) {
                (Some(inner), _) => self.within(key, |w| w.value(inner, value)),
                (None, Some(Value::Bool(false))) => {
                    meant.extend(nearest(key, &names));
                    let help = suggestion(key, "key", &names);
                    self.within(key, |w| w.complain(true, format!("there is no key `{key}` here"), help));
                }
                (None, Some(inner)) if inner.is_object() => self.within(key, |w| w.value(inner, value)),
                _ => {}
            }
        }
        for key in schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str) {
            if !map.contains_key(key) && !meant.contains(&key) {
                let Some(inner) = known.and_then(|k| k.get(key)) else { continue };
                let doc = inner["description"].as_str().unwrap_or_default().replace('\n', " ");
                let example = match types(self.resolve(inner))[..] {
                    ["array"] if self.resolve(&inner["items"])["type"] == "object" => format!("a table [[{key}]]"),
                    ["array"] => format!("{key} = [...]"),
                    ["object"] => format!("a table {key} = {{ ... }}"),
                    ["string"] => format!("{key} = \"...\""),
                    _ => format!("{key} = ..."),
                };
                self.complain(true, format!("`{key}` is missing"), format!("add {example}\n{doc}"));
            }
        }
    }

    /// Checks a choice: words, kinds, or tables of one key.
    fn choice(&mut self, options: &[&'a Value], value: &Value, doc: &str) {
        let words: Vec<&str> = options.iter().filter_map(|o| o["const"].as_str()).collect();
        if words.len() == options.len() {
            return self.word(&words, value);
        }
        let Value::Object(map) = value else { return self.mistyped(value, &["object"], doc) };
        if let Some((tag, names)) = tag(options) {
            return self.tagged(options, tag, &names, map);
        }
        let keys =
            |o: &&'a Value| o["properties"].as_object().and_then(|p| p.iter().next()).map(|(k, s)| (k.as_str(), s));
        let keys: Vec<(&str, &'a Value)> = options.iter().filter_map(keys).collect();
        let names: Vec<&str> = keys.iter().map(|(k, _)| *k).collect();
        if map.len() != 1 {
            let what = format!("expected one key, found {}", map.len());
            return self.complain(false, what, format!("choose one of {}", names.join(", ")));
        }
        for (key, value) in map {
            match keys.iter().find(|(k, _)| k == key) {
                Some((_, inner)) => self.within(key, |w| w.value(inner, value)),
                None => {
                    let help = suggestion(key, "key", &names);
                    self.within(key, |w| w.complain(true, format!("there is no key `{key}` here"), help));
                }
            }
        }
    }

    /// Checks a table whose `tag` (usually `kind`) names its variant.
    fn tagged(&mut self, options: &[&'a Value], tag: &str, names: &[&str], map: &Map<String, Value>) {
        let known = || names.join(", ");
        match map.get(tag) {
            // tables without a tag are of the variant whose tag is optional
            None => match options.iter().find(|o| o["required"].as_array().is_none_or(|r| !r.contains(&tag.into()))) {
                Some(option) => self.table(option, map),
                None => {
                    let help = format!("add {tag} = \"...\"; known: {}", known());
                    self.complain(true, format!("there is no `{tag}` here"), help);
                }
            },
            Some(Value::String(name)) => match options.iter().zip(names).find(|(_, known)| *known == name) {
                Some((option, _)) => self.table(option, map),
                None if tag == "kind" && name == PYTHON => {
                    let what = "this is Python code, and this program runs none";
                    let help = "run the file by the Python package `mobee`: mobee.run(file, agent=...)";
                    self.within(tag, |w| w.complain(false, what.into(), help.into()));
                }
                None => {
                    let help = suggestion(name, tag, names);
                    self.within(tag, |w| w.complain(false, format!("there is no {tag} `{name}`"), help));
                }
            },
            Some(other) => {
                let help = format!("known: {}", known());
                self.within(tag, |w| w.mistyped(other, &["string"], &help));
            }
        }
    }

    fn word(&mut self, words: &[&str], value: &Value) {
        match value {
            Value::String(word) if words.contains(&word.as_str()) => {}
            Value::String(word) => {
                self.complain(false, format!("`{word}` can't be chosen here"), suggestion(word, "choice", words));
            }
            other => self.mistyped(other, &["string"], &format!("choose {}", words.join(" or "))),
        }
    }
}

/// The key that distinguishes the variants of a table, and the word of each.
fn tag<'a>(options: &[&'a Value]) -> Option<(&'a str, Vec<&'a str>)> {
    let first = options.first()?["properties"].as_object()?;
    first.keys().find_map(|key| {
        let names: Vec<&str> = options.iter().filter_map(|o| o["properties"][key]["const"].as_str()).collect();
        (names.len() == options.len()).then_some((key.as_str(), names))
    })
}

/// The types that a schema allows; empty: all.
fn types(schema: &Value) -> Vec<&str> {
    match &schema["type"] {
        Value::String(one) => vec![one],
        Value::Array(list) => list.iter().filter_map(Value::as_str).filter(|t| *t != "null").collect(),
        _ => Vec::new(),
    }
}

fn fits(value: &Value, expected: &[&str]) -> bool {
    expected.is_empty()
        || expected.iter().any(|t| match (*t, value) {
            ("number", Value::Number(_)) | ("string", Value::String(_)) | ("boolean", Value::Bool(_)) => true,
            ("array", Value::Array(_)) | ("object", Value::Object(_)) => true,
            ("integer", Value::Number(n)) => n.is_i64() || n.is_u64(),
            _ => false,
        })
}

fn name(expected: &str) -> &str {
    match expected {
        "number" => "a number",
        "integer" => "a whole number",
        "string" => "text in quotes",
        "boolean" => "true or false",
        "array" => "a list",
        _ => "a table",
    }
}

fn given(value: &Value) -> String {
    match value {
        Value::String(s) => format!("the text {:?}", s.chars().take(40).collect::<String>()),
        Value::Array(_) => "a list".into(),
        Value::Object(_) => "a table".into(),
        Value::Number(n) => format!("the number {n}"),
        other => other.to_string(),
    }
}

/// A guess at the intended value.
fn hint(value: &Value, expected: &[&str]) -> String {
    let number = expected.iter().any(|t| matches!(*t, "number" | "integer"));
    match value {
        Value::String(s) if number => {
            let end = s.find(|c: char| !c.is_ascii_digit() && c != '.' && c != '-').unwrap_or(s.len());
            match s.get(..end).filter(|n| n.parse::<f64>().is_ok()) {
                Some(n) if end == s.len() => format!("write it without quotes: {n}"),
                Some(n) => format!("write the number alone, in the unit that the key names: {n}"),
                None => String::new(),
            }
        }
        Value::String(s) if expected == ["boolean"] && matches!(s.as_str(), "true" | "false") => {
            format!("write it without quotes: {s}")
        }
        Value::Number(n) if expected == ["integer"] => {
            n.as_f64().filter(|x| x.fract() == 0.0).map_or(String::new(), |x| format!("write {x}"))
        }
        Value::Object(_) if expected == ["array"] => {
            "a list of tables needs double brackets in its header: [[...]]".into()
        }
        Value::Array(_) | Value::Object(_) => String::new(),
        other if expected == ["array"] => format!("write it in brackets: [{other}]"),
        other if expected == ["string"] => format!("write it in quotes: \"{other}\""),
        _ => String::new(),
    }
}
