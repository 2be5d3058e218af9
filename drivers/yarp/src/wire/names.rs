//! What port names may be (spec sections 2 and 4).

/// The longest port name that a listener reads, bytes.
pub const MAX_NAME: usize = 999;

/// Whether `name` can be a registered port's name: begins with `/`, has no blanks or control characters, is not too long.
pub fn is_rooted(name: &str) -> bool {
    name.starts_with('/') && name.len() > 1 && is_plain(name)
}

/// Whether `name` can stand in lines and tables: not empty, not too long, no blanks, no control characters.
pub fn is_plain(name: &str) -> bool {
    !name.is_empty() && name.len() <= MAX_NAME && !name.chars().any(|c| c.is_whitespace() || c.is_control())
}
