//! Control boards: the messages of their ports (pure), and the server and the client of one board.
//!
//! ```text
//! Bottle ──Ask::parse──> Ask ──fits──> the device                   (rpc:i, spec section 12)
//! Bottle ──Shadow::answer──> Bottle                                 (all queries, from a board's state alone)
//! (head, body) ──Streamed::parse──> Streamed                        (command:i, spec section 13)
//! ```
//!
//! Everything here is in the board's own joint order and units: degrees for revolute, **meters** for
//! prismatic joints. A program that uses millimeters converts with [`Units`] (`units.rs`) when it parses and
//! encodes.

mod ask;
mod joints;
mod remote;
pub mod reply;
mod server;
mod shadow;
mod streamed;
mod units;
mod words;

pub use ask::{Ask, Get, Quantity, Set};
pub use joints::Joints;
pub use remote::{AxisFacts, LinkState, RemoteBoard, RemoteOptions, RemoteState};
pub use server::{BoardServer, Device, Reply};
pub use shadow::{Shadow, ShadowAxis};
pub use streamed::Streamed;
pub use units::{JointKind, Units};
pub use words::mode;
