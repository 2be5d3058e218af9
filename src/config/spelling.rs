//! What a misspelt key may have meant.

use mobee_contract::nearest;

/// The nearest of the names that serde says it expected, as a remedy.
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
