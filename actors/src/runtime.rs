//! What actors run on: time, what they cost, bounded streams, supervision, and the exchange of one part for another.

pub(crate) mod attempt;
pub mod clock;
pub mod load;
pub mod stream;
pub mod supervision;
pub mod swap;
