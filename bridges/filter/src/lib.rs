//! The filtered interface of a robot and the world's interface as requests and replies, independent of any middleware.
//!
//! ```text
//! BoardRequest ──FilterCore──> Commit, Setpoints ──> supervise     a filtered control board for each part
//! WorldRequest ──WorldRpc──> Edit ──> model                        objects, as in the original's world RPC
//! PartRequest, RobotRequest ──> markers, frames, state
//! Wish ──ForceField──> velocities ──> supervise                    force-field steering
//! ```
//!
//! * Owns: the port filter ([`filter`]), the requests for the world, the parts and the robots ([`world_rpc`],
//!   [`part_rpc`], [`robot_rpc`]), observations ([`observation`]) and the force-field steering ([`force_field`]).
//! * Accepts: requests of programs, decoded by a bridge. Emits: commands to the filtered interface of a robot
//!   (`Filtered` of the contract), like any agent.
//! * Promises: nothing here can move a robot past supervise; an invalid request is answered, and affects no
//!   other client.

#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::unreachable, clippy::indexing_slicing)
)]

// the benches of the unit tests serve the tests of bridges too, which use them from outside
#[cfg(test)]
extern crate self as mobee_filter;

pub mod filter;
pub mod force_field;
pub mod observation;
pub mod part_rpc;
pub mod robot_rpc;
pub mod world_rpc;
