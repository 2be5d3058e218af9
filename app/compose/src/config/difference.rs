//! Differences between two configurations.

use serde_json::Value;
use std::fmt;

/// A value that differs.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// Its key, such as `robot.0.controller.margin_mm`.
    pub key: String,
    /// The value in the first one.
    pub old: Option<Value>,
    /// The value in the second one.
    pub new: Option<Value>,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let word = |v: &Option<Value>| v.as_ref().map_or("nothing".to_owned(), Value::to_string);
        write!(f, "{} is {}, not {}", self.key, word(&self.new), word(&self.old))
    }
}

/// All values that differ, each with its full key.
pub fn differences(old: &Value, new: &Value) -> Vec<Difference> {
    let mut found = Vec::new();
    compare(Some(old), Some(new), "", &mut found);
    found
}

fn compare(old: Option<&Value>, new: Option<&Value>, at: &str, found: &mut Vec<Difference>) {
    let join = |key: &str| if at.is_empty() { key.to_owned() } else { format!("{at}.{key}") };
    match (old, new) {
        _ if old == new => {}
        (Some(Value::Object(a)), Some(Value::Object(b))) => {
            let keys = a.keys().chain(b.keys().filter(|k| !a.contains_key(*k)));
            keys.for_each(|k| compare(a.get(k), b.get(k), &join(k), found));
        }
        (Some(Value::Array(a)), Some(Value::Array(b))) if a.len() == b.len() => {
            let both = a.iter().zip(b).enumerate();
            both.for_each(|(i, (a, b))| compare(Some(a), Some(b), &join(&i.to_string()), found));
        }
        _ => found.push(Difference { key: at.to_owned(), old: old.cloned(), new: new.cloned() }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn each_difference_is_named_with_both_values() {
        let old = json!({ "a": [{ "x": 1 }], "b": 2, "c": null });
        let new = json!({ "a": [{ "x": 3 }], "c": null, "d": "e" });
        let texts: Vec<String> = differences(&old, &new).iter().map(ToString::to_string).collect();
        assert_eq!(texts, ["a.0.x is 3, not 1", "b is nothing, not 2", "d is \"e\", not nothing"]);
        assert!(differences(&old, &old).is_empty());
    }
}
