//! What a misspelt name may have meant.

use std::cmp::Reverse;

/// How many names a remedy lists at most.
const LISTED: usize = 20;
/// What is longer was not meant as a name, bytes; comparing it would take its length times that of all names.
const LONGEST: usize = 200;

/// The name that is nearest to `wrong` in spelling, if any is near.
pub fn nearest<'a>(wrong: &str, names: &[&'a str]) -> Option<&'a str> {
    if wrong.len() > LONGEST {
        return None;
    }
    let begins = |n: &str| !wrong.is_empty() && (n.starts_with(wrong) || wrong.starts_with(n));
    let ranked = names.iter().map(|n| (if begins(n) { 1 } else { distance(wrong, n) }, *n));
    // of two that are as near, the one that begins alike
    let alike = |n: &str| n.chars().zip(wrong.chars()).take_while(|(a, b)| a == b).count();
    ranked.filter(|(d, n)| *d <= 1 + n.len() / 3).min_by_key(|(d, n)| (*d, Reverse(alike(n)))).map(|(_, n)| n)
}

/// A remedy for an unknown name: the nearest known one, and all of them if they are few.
pub fn suggestion(wrong: &str, what: &str, names: &[&str]) -> String {
    match (nearest(wrong, names), names.len()) {
        (_, 0) => format!("there is no {what} at all"),
        (Some(near), n) if n > LISTED => format!("did you mean `{near}`?"),
        (Some(near), _) => format!("did you mean `{near}`? known here: {}", names.join(", ")),
        (None, n) => {
            let more = if n > LISTED { format!(" and {} more", n - LISTED) } else { String::new() };
            let some = names.get(..n.min(LISTED)).unwrap_or_default();
            format!("known here: {}{more}", some.join(", "))
        }
    }
}

/// How many letters must be changed, added or dropped to make one word the other (Levenshtein).
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
    fn what_was_meant_is_found_and_nonsense_is_not() {
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
