//! The values of a configuration, merged from its layers: included files, the file, the environment, `--set`. Each has
//! its place, so that every complaint can point at one.
//!
//! ```text
//! include = [a, b]  <  the file  <  MOBEE_SET__robot__icub__agent__vertices=30  <  --set robot.icub.agent.vertices=30
//! ```

use super::include::{IncludeReader, TextFile, from_home};
use super::layer::{Content, LayerNode, Origin, plain};
use super::{Complaints, ConfigError};
use mobee_contract::nearest;
use serde_json::Value;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use toml::de::DeTable;

/// Prefix of environment variables that set values; the steps of the key follow, joined by two underscores.
const VARIABLE: &str = "MOBEE_SET__";

/// A configuration as values, before conversion to its types.
#[derive(Clone, Debug)]
pub struct Source {
    /// The path as the user gave it.
    pub path: PathBuf,
    /// The values after all layers.
    pub value: Value,
    root: LayerNode,
    files: Vec<TextFile>,
    /// The contents of the files that it names, if they were sent along: then none of them is opened.
    files_sent: Option<BTreeMap<PathBuf, Vec<u8>>>,
}

impl Source {
    /// Reads a file, its includes, this process's environment, and assignments as of `--set`. Later layers take
    /// precedence.
    ///
    /// # Errors
    /// All files and assignments that can't be read.
    pub fn load(path: &Path, assignments: &[String]) -> Result<Source, Complaints> {
        let ours =
            |(k, v): (std::ffi::OsString, std::ffi::OsString)| Some((k.into_string().ok()?, v.into_string().ok()?));
        let environment = std::env::vars_os().filter_map(ours).filter(|(k, _)| k.starts_with(VARIABLE)).collect();
        Source::layers(path, &environment, assignments)
    }

    /// Like [`Source::load`], with a given environment.
    ///
    /// # Errors
    /// As for [`Source::load`].
    pub fn layers(
        path: &Path,
        environment: &BTreeMap<String, String>,
        assignments: &[String],
    ) -> Result<Source, Complaints> {
        let mut reader = IncludeReader::new(path);
        let root = reader.main(path)?;
        let mut source =
            Source { path: path.to_owned(), value: root.value(), root, files: reader.files, files_sent: None };
        let mut wrong = Complaints::default();
        for (name, raw) in environment {
            let origin = Origin::Environment(format!("{name}={raw}"));
            let key = name.strip_prefix(VARIABLE).unwrap_or(name);
            wrong.keep(source.assign(&key.split("__").collect::<Vec<_>>(), raw, origin));
        }
        for assignment in assignments {
            wrong.keep(source.set(assignment));
        }
        source.value = source.root.value();
        wrong.none_or(source)
    }

    /// Values that were resolved before, for a file at `path`. Complaints then have no place in a text.
    pub fn resolved(path: &Path, value: Value) -> Source {
        let root = LayerNode::plain(value.clone(), &Origin::Resolved);
        Source { path: path.to_owned(), value, root, files: Vec::new(), files_sent: None }
    }

    /// Values that a client resolved, with the contents of the files that they name: nothing is read from this disk.
    pub fn sent(path: &Path, value: Value, files: BTreeMap<PathBuf, Vec<u8>>) -> Source {
        Source { files_sent: Some(files), ..Source::resolved(path, value) }
    }

    /// True if the configuration was sent to a run, which then opens none of the files that it names.
    pub fn was_sent(&self) -> bool {
        self.files_sent.is_some()
    }

    /// The bytes sent in place of the file at `path`, which the value at `at` names; `None` if files are read from the
    /// disk.
    ///
    /// # Errors
    /// If this file was not sent.
    pub fn bytes_sent(&self, at: &str, path: &Path) -> Option<Result<&[u8], ConfigError>> {
        let bytes = self.files_sent.as_ref()?.get(path).map(Vec::as_slice);
        let missing = || self.error(at, format!("{} was not sent", path.display()), "send all files that it names");
        Some(bytes.ok_or_else(missing))
    }

    /// Like [`Source::bytes_sent`], for a text file.
    ///
    /// # Errors
    /// If it was not sent, or is not text.
    pub fn text_sent(&self, at: &str, path: &Path) -> Option<Result<&str, ConfigError>> {
        let foreign =
            |_| self.error(at, format!("{} is not text", path.display()), "give a file of the kind that is named");
        Some(self.bytes_sent(at, path)?.and_then(|bytes| std::str::from_utf8(bytes).map_err(foreign)))
    }

    /// Overrides one value: `robot.icub.agent.vertices=30`. Elements of lists are named by index or by their `name`.
    ///
    /// # Errors
    /// If the assignment is malformed, or its key leads through a value that is not a table.
    pub fn set(&mut self, assignment: &str) -> Result<(), ConfigError> {
        let origin = Origin::Set(assignment.to_owned());
        let (key, raw) =
            assignment.split_once('=').ok_or_else(|| misassigned(&origin, "there is no `=`".to_owned()))?;
        self.assign(&key.trim().split('.').collect::<Vec<_>>(), raw, origin)?;
        self.value = self.root.value();
        Ok(())
    }

    fn assign(&mut self, steps: &[&str], raw: &str, origin: Origin) -> Result<(), ConfigError> {
        let bad = |what: String| misassigned(&origin, what);
        if steps.iter().any(|s| s.is_empty()) {
            return Err(bad("the key has an empty step".into()));
        }
        let text = format!("v = {raw}");
        let value = match DeTable::parse(&text) {
            Ok(t) => t.get_ref().get("v").map_or(Ok(Value::Null), |v| plain(v.get_ref())).map_err(&bad)?,
            Err(_) => Value::String(raw.to_owned()),
        };
        // the assignment is a layer of its own, merged as any other
        let mut at = &self.root;
        let mut elements: Vec<Option<usize>> = Vec::new();
        let nothing = LayerNode { origin: origin.clone(), content: Content::Table(BTreeMap::new()) };
        for step in steps {
            elements.push(match &at.content {
                Content::List(list) => Some(
                    list.iter()
                        .position(|n| n.text("name") == Some(step))
                        .or_else(|| step.parse().ok().filter(|i| *i < list.len()))
                        .ok_or_else(|| bad(not_in(list, step)))?,
                ),
                Content::Table(_) => None,
                Content::Leaf(_) => return Err(bad(format!("`{step}` leads through a value that is not a table"))),
            });
            let index = elements.last().copied().flatten().map(|i| i.to_string());
            at = at.child(index.as_deref().unwrap_or(step)).unwrap_or(&nothing);
        }
        put(&mut self.root, steps, &elements, LayerNode::plain(value, &origin), &origin);
        Ok(())
    }

    /// A complaint about the value at `path` (such as `robot[0].agent.vertices`), with its place in the file that set it.
    pub fn error(&self, path: &str, message: impl Into<String>, help: impl Into<String>) -> ConfigError {
        let message = message.into();
        let mut steps = steps(path);
        // serde names an unknown or missing field only in its message
        let unknown = message.strip_prefix("unknown field `").and_then(|r| r.split('`').next()).map(str::to_owned);
        if let Some(u) = &unknown
            && steps.last() != Some(u)
        {
            steps.push(u.clone());
        }
        self.complain(&steps, unknown.is_some(), message, help)
    }

    /// A complaint about a key: the caret is at the key, not at the value.
    pub fn key_error(&self, path: &str, message: impl Into<String>, help: impl Into<String>) -> ConfigError {
        self.complain(&steps(path), true, message.into(), help)
    }

    /// A complaint about the value at these steps, or about the nearest table if there is none; at its key, or at the
    /// value.
    pub fn complain(&self, steps: &[String], at_key: bool, message: String, help: impl Into<String>) -> ConfigError {
        let node = self.nearest(steps);
        let help = match (message.ends_with(" is missing"), node.child("kind").map(|kind| &kind.origin)) {
            // the caret is at a file that has the key for another kind
            (true, Some(Origin::Set(by) | Origin::Environment(by))) if matches!(node.origin, Origin::File { .. }) => {
                let first = "a changed kind starts without the other kind's settings; give them with it";
                format!(
                    "`{by}` changed the kind, and {first}, as a table: KEY={{kind=\"...\", key=...}}\n{}",
                    help.into()
                )
            }
            _ => help.into(),
        };
        let plain = |place: &str| ConfigError::plain(format!("{place}: {message}"), "");
        match &node.origin {
            Origin::Set(assignment) => plain(&format!("--set {assignment}")).with_help(help),
            Origin::Environment(assignment) => plain(assignment).with_help(help),
            Origin::Resolved => plain(&self.path.display().to_string()).with_help(help),
            Origin::File { file, key, value } => {
                let Some(file) = self.files.get(*file) else { return ConfigError::plain(message, help) };
                let span = match key {
                    Some(key) if at_key => key.clone(),
                    _ => first_line(&file.text, value.clone()),
                };
                file.error(span, message, help)
            }
        }
    }

    /// The node at these steps, or the deepest one on the path to it.
    fn nearest(&self, steps: &[String]) -> &LayerNode {
        let mut at = &self.root;
        for step in steps {
            match at.child(step) {
                Some(child) => at = child,
                None => break,
            }
        }
        at
    }

    /// The files that it was read from.
    pub fn files(&self) -> Vec<PathBuf> {
        self.files.iter().map(|f| PathBuf::from(&f.name)).collect()
    }

    /// True if a file sets the value at `path`, and not the environment, `--set` or an earlier run.
    pub fn in_file(&self, path: &str) -> bool {
        matches!(self.nearest(&steps(path)).origin, Origin::File { .. })
    }

    /// The tree of values with their origins.
    pub fn root(&self) -> &LayerNode {
        &self.root
    }

    /// An origin in a few words: `explore.toml:12`, `environment`, `--set`.
    pub fn describe(&self, origin: &Origin) -> String {
        match origin {
            Origin::File { file, key, value } => self
                .files
                .get(*file)
                .map_or(String::new(), |f| format!("{}:{}", f.name, f.line(key.as_ref().unwrap_or(value).start))),
            Origin::Environment(assignment) => {
                format!("environment {}", assignment.split('=').next().unwrap_or_default())
            }
            Origin::Set(_) => "--set".into(),
            Origin::Resolved => self.path.display().to_string(),
        }
    }

    /// A path at `at` in the configuration, relative to the main file's folder; `~/` is the user's home.
    pub fn relocated(&self, at: &str, path: &Path) -> PathBuf {
        match &self.nearest(&steps(at)).origin {
            Origin::File { file, .. } => {
                let path = from_home(path);
                self.files.get(*file).map_or(path.clone(), |f| f.folder.join(&path))
            }
            // the program that resolved it has expanded it
            Origin::Resolved => path.to_owned(),
            Origin::Environment(_) | Origin::Set(_) => from_home(path),
        }
    }
}

/// Splits `robot[0].agent` into steps.
fn steps(path: &str) -> Vec<String> {
    path.replace('[', ".").replace(']', "").split('.').filter(|s| !s.is_empty()).map(str::to_owned).collect()
}

/// The complaint about a step that names no element of a list.
fn not_in(list: &[LayerNode], step: &str) -> String {
    let names: Vec<&str> = list.iter().filter_map(|n| n.text("name")).collect();
    let near = nearest(step, &names).map_or(String::new(), |n| format!("; did you mean `{n}`?"));
    match (names.as_slice(), near.as_str()) {
        ([], _) => format!("there is no `{step}` in this list of {}", list.len()),
        (known, "") => format!("there is no `{step}` in this list, which has {}", known.join(", ")),
        _ => format!("there is no `{step}` in this list{near}"),
    }
}

fn misassigned(origin: &Origin, what: String) -> ConfigError {
    match origin {
        Origin::Environment(assignment) => ConfigError::plain(
            format!("{assignment}: {what}"),
            "name the variable MOBEE_SET__a__b for the key a.b, as in MOBEE_SET__robot__icub__agent__vertices=30",
        ),
        Origin::Set(assignment) => ConfigError::plain(
            format!("--set {assignment}: {what}"),
            "write --set a.b=value, as in --set robot.icub.agent.vertices=30",
        ),
        _ => ConfigError::plain(what, ""),
    }
}

/// Writes a value at the steps; elements of lists by their index.
fn put(at: &mut LayerNode, steps: &[&str], elements: &[Option<usize>], value: LayerNode, origin: &Origin) {
    let (Some((step, steps)), Some((element, elements))) = (steps.split_first(), elements.split_first()) else {
        return;
    };
    let last = steps.is_empty();
    match &mut at.content {
        Content::Table(map) => {
            if last {
                let same = map.get("kind").is_none_or(|old| old.value() == value.value());
                if *step == "kind" && !same {
                    // settings of the previous kind do not apply to another one
                    map.clear();
                }
                map.insert((*step).to_owned(), value);
            } else {
                let empty = || LayerNode { origin: origin.clone(), content: Content::Table(BTreeMap::new()) };
                put(map.entry((*step).to_owned()).or_insert_with(empty), steps, elements, value, origin);
            }
        }
        Content::List(list) => {
            if let Some(slot) = element.and_then(|i| list.get_mut(i)) {
                if last {
                    *slot = value;
                } else {
                    put(slot, steps, elements, value, origin);
                }
            }
        }
        Content::Leaf(_) => {}
    }
}

/// A span cut to its first line, so that a complaint about a table points at its header.
fn first_line(text: &str, span: Range<usize>) -> Range<usize> {
    let end = text.get(span.clone()).and_then(|t| t.find('\n')).map_or(span.end, |n| span.start + n);
    span.start..end
}
