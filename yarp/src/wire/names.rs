//! Valid port names (spec sections 2 and 4).

/// Greatest length of a port name that a listener accepts, bytes.
pub const MAX_NAME: usize = 999;

/// True if `name` can be a registered port's name: it begins with `/`, has no blanks or control characters,
/// and is not too long.
pub fn is_rooted(name: &str) -> bool {
    name.starts_with('/') && name.len() > 1 && is_plain(name)
}

/// True if `name` can be part of lines and tables: not empty, not too long, no blanks, no control characters.
pub fn is_plain(name: &str) -> bool {
    !name.is_empty() && name.len() <= MAX_NAME && !name.chars().any(|c| c.is_whitespace() || c.is_control())
}
