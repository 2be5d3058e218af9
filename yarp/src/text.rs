//! Text form of a bottle (spec section 10): printing by YARP's exact rules, and parsing of the input of
//! people and programs.

mod lines;
mod number;
mod parse;
mod print;

pub use lines::{LineJoiner, is_complete};
pub use number::{general, print_float};

#[cfg(test)]
mod tests;

/// Text beyond the limits.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TextError {
    /// Too many bytes.
    #[error("a text of more than {limit} bytes")]
    TooLong {
        /// Upper limit.
        limit: usize,
    },
    /// Too many nested lists.
    #[error("more than {limit} lists in lists")]
    TooDeep {
        /// Upper limit.
        limit: usize,
    },
    /// Too many values.
    #[error("more than {limit} values")]
    TooMany {
        /// Upper limit.
        limit: usize,
    },
}
