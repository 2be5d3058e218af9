//! Suggestions for misspelled names.

use std::cmp::Reverse;

/// Maximum number of names in a remedy.
const MAX_LISTED_NAMES: usize = 20;
/// Maximum length of a name to compare, bytes: longer text is not a name, and the comparison would be slow.
const MAX_NAME_BYTES: usize = 200;

/// The name closest to `wrong` in spelling, if any is close.
pub fn nearest<'a>(wrong: &str, names: &[&'a str]) -> Option<&'a str> {
    if wrong.len() > MAX_NAME_BYTES {
        return None;
    }
    let begins = |n: &str| !wrong.is_empty() && (n.starts_with(wrong) || wrong.starts_with(n));
    let ranked = names.iter().map(|n| (if begins(n) { 1 } else { distance(wrong, n) }, *n));
    // If two are equally close, prefer the one with the longer common prefix.
    let alike = |n: &str| n.chars().zip(wrong.chars()).take_while(|(a, b)| a == b).count();
    ranked.filter(|(d, n)| *d <= 1 + n.len() / 3).min_by_key(|(d, n)| (*d, Reverse(alike(n)))).map(|(_, n)| n)
}

/// A remedy for an unknown name: the nearest known one, and all of them if they are few.
pub fn suggestion(wrong: &str, what: &str, names: &[&str]) -> String {
    match (nearest(wrong, names), names.len()) {
        (_, 0) => format!("there is no {what} at all"),
        (Some(near), n) if n > MAX_LISTED_NAMES => format!("did you mean `{near}`?"),
        (Some(near), _) => format!("did you mean `{near}`? known here: {}", names.join(", ")),
        (None, n) => {
            let more = if n > MAX_LISTED_NAMES { format!(" and {} more", n - MAX_LISTED_NAMES) } else { String::new() };
            let some = names.get(..n.min(MAX_LISTED_NAMES)).unwrap_or_default();
            format!("known here: {}{more}", some.join(", "))
        }
    }
}

/// Levenshtein distance of two words.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut left = i + 1;
        let mut next = vec![left];
        for ((before, above), y) in row.iter().zip(row.iter().skip(1)).zip(&b) {
            left = (left + 1).min(above + 1).min(before + usize::from(x != *y));
            next.push(left);
        }
        row = next;
    }
    row.last().copied().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn close_names_are_found_and_others_are_not() {
        let names = ["r_elbow", "r_shoulder_pitch", "torso"];
        assert_eq!(nearest("r_elbwo", &names), Some("r_elbow"));
        assert_eq!(nearest("tors", &names), Some("torso"));
        assert_eq!(nearest("sped", &["seed", "speed"]), Some("speed"));
        assert_eq!(nearest("gripper", &names), None);
        assert_eq!(nearest("", &names), None);
        assert_eq!(suggestion("x", "pose", &[]), "there is no pose at all");
        assert_eq!(suggestion("gripper", "motor", &names), "known here: r_elbow, r_shoulder_pitch, torso");
    }
}
