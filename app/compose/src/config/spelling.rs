//! Suggestions for misspelled keys.

use mobee_contract::nearest;

/// A remedy from the names that serde expected: the nearest one first.
pub fn did_you_mean(message: &str) -> Option<String> {
    let (wrong, rest) = message
        .strip_prefix("unknown field `")
        .or_else(|| message.strip_prefix("unknown variant `"))?
        .split_once('`')?;
    let names: Vec<&str> = rest.split('`').skip(1).step_by(2).collect();
    Some(nearest(wrong, &names).map_or_else(
        || format!("known here: {}", names.join(", ")),
        |n| format!("did you mean `{n}`? known here: {}", names.join(", ")),
    ))
}
