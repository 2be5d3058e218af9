//! Interfaces to other programs: filtered robots on YARP ports, and the world.
//!
//! ```text
//! YARP program ──bottle──> yarp::board ──BoardRequest──> FilterCore ──Commit, Setpoints──> supervise   one filtered board for each part
//! YARP program ──bottle──> yarp::world ──WorldRequest──> WorldRpc ──Edit──> model                      the original's world RPC
//! latest values ──> state ports, contacts, torques                                                     for any listener
//! ```
//!
//! * Owns: the port filter ([`filter`]), the world's and the parts' RPC ([`world_rpc`], [`part_rpc`]),
//!   observations ([`observation`]) and the force-field steering ([`force_field`]), whose cores are
//!   independent of the middleware; their YARP encoding ([`yarp`]); and the services that put them onto ports
//!   ([`YarpServices`]).
//! * Accepts: requests of programs. Emits: commands to the filtered interface of a robot (`Filtered` of the
//!   contract), like any agent.
//! * Promises: nothing here can move a robot past supervise; an invalid request is answered, and affects no
//!   other client.

#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::unreachable, clippy::indexing_slicing)
)]

pub mod filter;
pub mod force_field;
pub mod observation;
pub mod part_rpc;
mod robot_rpc;
mod services;
pub mod world_rpc;
pub mod yarp;

pub use services::{RobotPorts, WorldService, YarpServices, YarpSettings};
