//! Control boards: the words of their ports (pure), the server and the client of one board.
//!
//! ```text
//! Bottle ──Ask::parse──> Ask ──fits──> a device's business          (rpc:i, spec section 12)
//! Bottle ──Shadow::answer──> Bottle                                 (every reading, from a board's state alone)
//! (head, body) ──Streamed::parse──> Streamed                        (command:i, spec section 13)
//! ```
//!
//! Everything here is in the board's own joint order, and in its units: degrees where a joint turns, **meters** where it slides. A program that
//! counts millimeters there converts with [`Units`] (`units.rs`) as it reads and writes.

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
