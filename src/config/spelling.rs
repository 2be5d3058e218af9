//! What a misspelt name may have meant.

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

/// The name that is nearest to `wrong` in spelling, if any is near.
pub fn nearest<'a>(wrong: &str, names: &[&'a str]) -> Option<&'a str> {
    names
        .iter()
        .map(|n| (if n.starts_with(wrong) || wrong.starts_with(n) { 1 } else { distance(wrong, n) }, *n))
        .filter(|(d, n)| *d <= 1 + n.len() / 3)
        .min_by_key(|(d, _)| *d)
        .map(|(_, n)| n)
}

/// Levenshtein distance.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = i;
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let next = (diagonal + usize::from(x != *y)).min(row[j] + 1).min(row[j + 1] + 1);
            diagonal = row[j + 1];
            row[j + 1] = next;
        }
    }
    row[b.len()]
}

/// A remedy for an unknown name: the nearest known one, and all of them.
pub fn suggestion(wrong: &str, what: &str, names: &[&str]) -> String {
    let near = nearest(wrong, names).map_or(String::new(), |n| format!("did you mean `{n}`? "));
    match names {
        [] => format!("there is no {what} at all"),
        _ => format!("{near}known here: {}", names.join(", ")),
    }
}
