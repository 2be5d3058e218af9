//! Names: the client of a name server, and the name server itself (spec section 3).

mod client;
mod server;
mod table;
pub mod text;

pub use client::NameError;
pub use server::{NameServer, ServerOptions};
pub use table::{Handled, NameCounts, NameReply, NameTable, PendingConnection};
