//! The text form of a bottle (spec section 10): printing by YARP's exact rules, and reading what people and programs type.

mod lines;
mod number;
mod parse;
mod print;

pub use lines::{LineJoiner, is_complete};
pub use number::{general, print_float};

#[cfg(test)]
mod tests;

/// Text that is not read, being beyond the limits.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TextError {
    /// Too many bytes.
    #[error("a text of more than {limit} bytes")]
    TooLong {
        /// The most that is taken.
        limit: usize,
    },
    /// Too many lists in lists.
    #[error("more than {limit} lists in lists")]
    TooDeep {
        /// The most that is taken.
        limit: usize,
    },
    /// Too many values.
    #[error("more than {limit} values")]
    TooMany {
        /// The most that is taken.
        limit: usize,
    },
}
