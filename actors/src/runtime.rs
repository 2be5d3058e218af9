//! Services for actors: time, processor load, bounded streams, supervision, and the exchange of parts.

pub(crate) mod attempt;
pub mod clock;
pub mod load;
pub mod stream;
pub mod supervision;
pub mod swap;
