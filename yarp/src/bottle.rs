//! The two forms of a bottle: binary (spec section 9) and text (section 10, in [`crate::text`]).

mod decode;
mod encode;
pub(crate) mod tag;

pub use decode::DecodeError;

#[cfg(test)]
mod tests;

/// Limits of input from outside. Everything is checked before memory is allocated for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DecodeLimits {
    /// Greatest size of one message, or of one string or blob, bytes.
    pub max_bytes: usize,
    /// Greatest depth of nested lists.
    pub max_depth: usize,
    /// Greatest number of values of one bottle, including those in its lists.
    pub max_elements: usize,
}

impl DecodeLimits {
    /// 64 MiB, 64 levels of lists, a million values.
    pub const DEFAULT: DecodeLimits = DecodeLimits { max_bytes: 64 << 20, max_depth: 64, max_elements: 1 << 20 };
}

impl Default for DecodeLimits {
    fn default() -> DecodeLimits {
        DecodeLimits::DEFAULT
    }
}
