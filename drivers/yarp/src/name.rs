//! Names: the client of a name server, and the name server itself (spec section 3).

mod client;
pub mod text;

pub use client::NameError;
