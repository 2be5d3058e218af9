//! The two forms of a bottle: binary (spec section 9) and text (section 10, in [`crate::text`]).

mod decode;
mod encode;
pub(crate) mod tag;

pub use decode::DecodeError;

#[cfg(test)]
mod tests;

/// What is read at most from anyone. Everything is checked before memory is taken for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DecodeLimits {
    /// Bytes of one message, or of one string or blob.
    pub max_bytes: usize,
    /// How deep lists may stand in lists.
    pub max_depth: usize,
    /// Values of one bottle, those in its lists counted too.
    pub max_elements: usize,
}

impl DecodeLimits {
    /// 64 MiB, 64 lists deep, a million values.
    pub const DEFAULT: DecodeLimits = DecodeLimits { max_bytes: 64 << 20, max_depth: 64, max_elements: 1 << 20 };
}

impl Default for DecodeLimits {
    fn default() -> DecodeLimits {
        DecodeLimits::DEFAULT
    }
}
