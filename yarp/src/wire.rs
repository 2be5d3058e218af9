//! Bytes of connections as pure functions over slices: nothing here reads a socket or waits, so that all of
//! it can be tested and fuzzed directly.
//!
//! Every parser takes the bytes received so far and returns `Ok(None)` while they are not a complete item, so
//! that a length that a peer merely claims never allocates anything.

pub mod admin;
pub mod carrier;
pub mod command;
pub mod datagram;
pub mod frame;
pub mod handshake;
pub mod line;
pub mod names;

pub use carrier::{Carrier, UnknownCarrier};
pub use command::{TextCommand, Verb};
pub use frame::FrameError;
pub use line::LineError;
