//! A TOML file as plain values together with the place of each, so that every complaint can point at one.

use super::ConfigError;
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use toml::de::{DeTable, DeValue};

/// Where a value stands in the text, and its children.
#[derive(Clone, Debug, Default)]
struct Place {
    key: Option<Range<usize>>,
    value: Range<usize>,
    children: BTreeMap<String, Place>,
}

/// A configuration file, parsed but not yet understood.
#[derive(Clone, Debug)]
pub struct Source {
    /// The path as the user gave it.
    pub path: PathBuf,
    text: String,
    places: Place,
    /// The file's values after all `--set` overrides.
    pub value: Value,
    overridden: Vec<(String, String)>,
}

impl Source {
    /// Reads a file.
    ///
    /// # Errors
    /// If there is no such file, or it is not TOML.
    pub fn read(path: &Path) -> Result<Source, ConfigError> {
        let text = std::fs::read_to_string(path).map_err(|e| {
            ConfigError::plain(
                format!("can't read {}: {e}", path.display()),
                "give the path of a configuration file; `configs/behaviors/` has some to start from",
            )
        })?;
        Source::parse(path, text)
    }

    /// Parses a text that stands, or would stand, at `path`.
    ///
    /// # Errors
    /// If it is not TOML.
    pub fn parse(path: &Path, text: String) -> Result<Source, ConfigError> {
        let blank =
            Source { path: path.to_owned(), text, places: Place::default(), value: Value::Null, overridden: vec![] };
        let (value, places) = {
            let table = DeTable::parse(&blank.text).map_err(|e| {
                blank.error_at(e.span().unwrap_or(0..0), e.message().to_owned(), "mend the TOML syntax here")
            })?;
            let mut places = Place { key: None, value: table.span(), children: BTreeMap::new() };
            (table_value(table.get_ref(), &mut places, &blank)?, places)
        };
        Ok(Source { value, places, ..blank })
    }

    /// Values that were resolved before, for a file that stands at `path`. Complaints then have no place in a text.
    pub fn resolved(path: &Path, value: Value) -> Source {
        Source { path: path.to_owned(), text: String::new(), places: Place::default(), value, overridden: Vec::new() }
    }

    /// Overrides one value: `robot.icub.agent.vertices=30`. Array elements are named by index or by their `name`.
    ///
    /// # Errors
    /// If the assignment is malformed or leads through something that is no table.
    pub fn set(&mut self, assignment: &str) -> Result<(), ConfigError> {
        let bad = |what: String| {
            ConfigError::plain(
                format!("--set {assignment}: {what}"),
                "write --set a.b=value, as in --set robot.icub.agent.vertices=30",
            )
        };
        let (path, raw) = assignment.split_once('=').ok_or_else(|| bad("there is no `=`".into()))?;
        let value = match DeTable::parse(&format!("v = {raw}")) {
            Ok(t) => t.get_ref().get("v").map_or(Ok(Value::Null), |v| plain(v.get_ref()).map_err(&bad))?,
            Err(_) => Value::String(raw.to_owned()),
        };
        let mut at = &mut self.value;
        let mut resolved = Vec::new();
        let steps: Vec<&str> = path.trim().split('.').collect();
        let Some((last, way)) = steps.split_last() else { return Err(bad("the key is empty".into())) };
        for step in way {
            at = match at {
                Value::Object(map) => {
                    resolved.push((*step).to_owned());
                    map.entry(*step).or_insert_with(|| Value::Object(Map::new()))
                }
                Value::Array(list) => {
                    let i = list
                        .iter()
                        .position(|v| v.get("name").and_then(Value::as_str) == Some(step))
                        .or_else(|| step.parse().ok())
                        .ok_or_else(|| bad(format!("there is no `{step}` in this list")))?;
                    resolved.push(i.to_string());
                    list.get_mut(i).ok_or_else(|| bad(format!("there is no element {i} in this list")))?
                }
                _ => return Err(bad(format!("`{step}` leads through something that is no table"))),
            };
        }
        resolved.push(last.to_string());
        match at {
            Value::Object(map) => {
                map.insert(last.to_string(), value);
            }
            _ => return Err(bad("the key leads into something that is no table".into())),
        }
        self.overridden.push((resolved.join("."), assignment.to_owned()));
        Ok(())
    }

    /// A complaint about the value at `path` (such as `robot[0].agent.vertices`), with its place in the file.
    pub fn error(&self, path: &str, message: impl Into<String>, help: impl Into<String>) -> ConfigError {
        let message = message.into();
        let mut steps: Vec<String> =
            path.replace('[', ".").replace(']', "").split('.').filter(|s| !s.is_empty()).map(str::to_owned).collect();
        // serde names an unknown or missing field only in its message
        let unknown = message.strip_prefix("unknown field `").and_then(|r| r.split('`').next()).map(str::to_owned);
        if let Some(u) = &unknown
            && steps.last() != Some(u)
        {
            steps.push(u.clone());
        }
        let joined = steps.join(".");
        if let Some((_, assignment)) = self.overridden.iter().find(|(p, _)| joined.starts_with(p.as_str())) {
            return ConfigError::plain(format!("--set {assignment}: {message}"), help);
        }
        let mut place = &self.places;
        for step in &steps {
            match place.children.get(step) {
                Some(p) => place = p,
                None => break,
            }
        }
        let span = match (&place.key, &unknown) {
            (Some(key), Some(_)) => key.clone(),
            _ => first_line(&self.text, place.value.clone()),
        };
        self.error_at(span, message, help)
    }

    fn error_at(&self, span: Range<usize>, message: impl Into<String>, help: impl Into<String>) -> ConfigError {
        if self.text.is_empty() {
            return ConfigError::plain(format!("{}: {}", self.path.display(), message.into()), help);
        }
        ConfigError::at(&self.path.display().to_string(), &self.text, span, message, help)
    }
}

/// A span cut to its first line, so that a complaint about a table points at its head.
fn first_line(text: &str, span: Range<usize>) -> Range<usize> {
    let end = text.get(span.clone()).and_then(|t| t.find('\n')).map_or(span.end, |n| span.start + n);
    span.start..end
}

fn table_value(table: &DeTable<'_>, place: &mut Place, source: &Source) -> Result<Value, ConfigError> {
    let mut map = Map::new();
    for (key, value) in table.iter() {
        let mut child = Place { key: Some(key.span()), value: value.span(), children: BTreeMap::new() };
        map.insert(key.get_ref().to_string(), value_at(value.get_ref(), &mut child, source)?);
        place.children.insert(key.get_ref().to_string(), child);
    }
    Ok(Value::Object(map))
}

fn value_at(value: &DeValue<'_>, place: &mut Place, source: &Source) -> Result<Value, ConfigError> {
    match value {
        DeValue::Table(t) => table_value(t, place, source),
        DeValue::Array(list) => {
            let mut out = Vec::new();
            for (i, v) in list.iter().enumerate() {
                let mut child = Place { key: None, value: v.span(), children: BTreeMap::new() };
                out.push(value_at(v.get_ref(), &mut child, source)?);
                place.children.insert(i.to_string(), child);
            }
            Ok(Value::Array(out))
        }
        leaf => plain(leaf).map_err(|m| source.error_at(place.value.clone(), m, "write an ordinary finite number")),
    }
}

/// A TOML value without its place.
fn plain(value: &DeValue<'_>) -> Result<Value, String> {
    Ok(match value {
        DeValue::String(s) => Value::String(s.to_string()),
        DeValue::Boolean(b) => Value::Bool(*b),
        DeValue::Integer(i) => i64::from_str_radix(i.as_str(), i.radix())
            .map(Value::from)
            .map_err(|_| format!("{i} is too large a number"))?,
        DeValue::Float(f) => {
            let x: f64 = f.as_str().parse().map_err(|_| format!("{f} is not a number"))?;
            serde_json::Number::from_f64(x).map(Value::Number).ok_or(format!("{f} is not a finite number"))?
        }
        DeValue::Datetime(d) => Value::String(d.to_string()),
        DeValue::Array(list) => Value::Array(list.iter().map(|v| plain(v.get_ref())).collect::<Result<_, _>>()?),
        DeValue::Table(t) => Value::Object(
            t.iter().map(|(k, v)| Ok((k.get_ref().to_string(), plain(v.get_ref())?))).collect::<Result<_, String>>()?,
        ),
    })
}
