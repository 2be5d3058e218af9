//! A tree of values with their origins, and the merging of two such trees, in which the later one takes precedence.

use mobee_model::hidden_in;
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::ops::Range;
use toml::de::{DeTable, DeValue};

/// The place in which a value was written.
#[derive(Clone, Debug, PartialEq)]
pub enum Origin {
    /// In a file.
    File {
        /// The index into the source's files.
        file: usize,
        /// The span of its key; `None` for elements of lists.
        key: Option<Range<usize>>,
        /// The span of the value.
        value: Range<usize>,
    },
    /// By an environment variable: the whole assignment.
    Environment(String),
    /// By `--set`: the whole assignment.
    Set(String),
    /// In no text: the values come resolved.
    Resolved,
}

/// A value with its origin.
#[derive(Clone, Debug)]
pub struct LayerNode {
    /// The place of the value.
    pub origin: Origin,
    /// The value.
    pub content: Content,
}

/// The content of a node.
#[derive(Clone, Debug)]
pub enum Content {
    /// A value without parts.
    Leaf(Value),
    /// A table.
    Table(BTreeMap<String, LayerNode>),
    /// A list.
    List(Vec<LayerNode>),
}

/// A value that can't be used: its span and the problem.
pub type Unusable = (Range<usize>, String);

impl LayerNode {
    /// A tree of a plain value, all of one origin.
    pub fn plain(value: Value, origin: &Origin) -> LayerNode {
        let content = match value {
            Value::Object(map) => {
                Content::Table(map.into_iter().map(|(k, v)| (k, LayerNode::plain(v, origin))).collect())
            }
            Value::Array(list) => Content::List(list.into_iter().map(|v| LayerNode::plain(v, origin)).collect()),
            leaf => Content::Leaf(leaf),
        };
        LayerNode { origin: origin.clone(), content }
    }

    /// A parsed TOML document; numbers and texts that can't be used are added to `bad` and omitted.
    pub fn document(table: &DeTable<'_>, span: Range<usize>, file: usize, bad: &mut Vec<Unusable>) -> LayerNode {
        let origin = Origin::File { file, key: None, value: span };
        LayerNode { origin, content: Content::Table(table_nodes(table, file, bad)) }
    }

    /// The value without origins.
    pub fn value(&self) -> Value {
        match &self.content {
            Content::Leaf(value) => value.clone(),
            Content::Table(map) => {
                Value::Object(map.iter().map(|(k, n)| (k.clone(), n.value())).collect::<Map<_, _>>())
            }
            Content::List(list) => Value::Array(list.iter().map(LayerNode::value).collect()),
        }
    }

    /// The child of this key, or the element of this index.
    pub fn child(&self, step: &str) -> Option<&LayerNode> {
        match &self.content {
            Content::Leaf(_) => None,
            Content::Table(map) => map.get(step),
            Content::List(list) => list.get(step.parse::<usize>().ok()?),
        }
    }

    /// The text under a key of this table.
    pub fn text(&self, key: &str) -> Option<&str> {
        match &self.child(key)?.content {
            Content::Leaf(value) => value.as_str(),
            _ => None,
        }
    }

    /// This layer with a later one over it. Tables merge, unless the later one names another `kind`: then it replaces
    /// the earlier one, whose settings were for its own kind. Lists of tables that all have a `name` merge by name;
    /// other lists are replaced.
    pub fn under(self, later: LayerNode) -> LayerNode {
        let other_kind = later.text("kind").is_some_and(|k| self.text("kind").is_some_and(|old| old != k));
        match (self.content, later.content) {
            (Content::Table(mut map), Content::Table(over)) if !other_kind => {
                for (key, node) in over {
                    let merged = match map.remove(&key) {
                        Some(old) => old.under(node),
                        None => node,
                    };
                    map.insert(key, merged);
                }
                LayerNode { origin: later.origin, content: Content::Table(map) }
            }
            (Content::List(list), Content::List(over)) if named(&list) && named(&over) => {
                LayerNode { origin: later.origin, content: Content::List(by_name(list, over)) }
            }
            (_, content) => LayerNode { origin: later.origin, content },
        }
    }
}

/// True if all elements are tables with a name.
fn named(list: &[LayerNode]) -> bool {
    list.iter().all(|n| n.text("name").is_some())
}

fn by_name(list: Vec<LayerNode>, over: Vec<LayerNode>) -> Vec<LayerNode> {
    let mut merged: Vec<(LayerNode, bool)> = list.into_iter().map(|n| (n, false)).collect();
    for node in over {
        // merge each element once: two elements of one name in one list stay two
        let old = merged.iter().position(|(old, met)| !met && old.text("name") == node.text("name"));
        match old {
            Some(i) => {
                let (old, _) = merged.remove(i);
                merged.insert(i, (old.under(node), true));
            }
            None => merged.push((node, true)),
        }
    }
    merged.into_iter().map(|(n, _)| n).collect()
}

fn table_nodes(table: &DeTable<'_>, file: usize, bad: &mut Vec<Unusable>) -> BTreeMap<String, LayerNode> {
    let mut map = BTreeMap::new();
    for (key, value) in table.iter() {
        if let Some(what) = hidden_in(key.get_ref()) {
            bad.push((key.span(), what));
            continue;
        }
        let origin = Origin::File { file, key: Some(key.span()), value: value.span() };
        if let Some(content) = content(value.get_ref(), value.span(), file, bad) {
            map.insert(key.get_ref().to_string(), LayerNode { origin, content });
        }
    }
    map
}

fn content(value: &DeValue<'_>, span: Range<usize>, file: usize, bad: &mut Vec<Unusable>) -> Option<Content> {
    Some(match value {
        DeValue::Table(t) => Content::Table(table_nodes(t, file, bad)),
        DeValue::Array(list) => {
            let element = |v: &toml::Spanned<DeValue<'_>>, bad: &mut Vec<Unusable>| {
                let origin = Origin::File { file, key: None, value: v.span() };
                content(v.get_ref(), v.span(), file, bad).map(|content| LayerNode { origin, content })
            };
            Content::List(list.iter().filter_map(|v| element(v, bad)).collect())
        }
        leaf => match plain(leaf) {
            Ok(value) => Content::Leaf(value),
            Err(what) => {
                bad.push((span, what));
                return None;
            }
        },
    })
}

/// Converts a TOML value without its place.
///
/// # Errors
/// The problem of a number or a text.
pub fn plain(value: &DeValue<'_>) -> Result<Value, String> {
    Ok(match value {
        DeValue::String(s) => hidden_in(s).map_or_else(|| Ok(Value::String(s.to_string())), Err)?,
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
