//! What MoBeE serves to programs outside: robots of its own on YARP ports, and the world.
//!
//! ```text
//! YARP program ──bottle──> yarp::board ──BoardRequest──> FilterCore ──Commit, Setpoints──> supervise   one filtered board for each part
//! YARP program ──bottle──> yarp::world ──WorldRequest──> WorldRpc ──Edit──> model                      the original's world RPC
//! latest values ──> state ports, contacts, torques                                                     for whoever listens
//! ```
//!
//! * Owns: the port filter ([`filter`]), the world's and the parts' RPC ([`world_rpc`], [`part_rpc`]), observations ([`observation`]) and
//!   the force-field steering ([`force_field`]), cores that name no middleware; YARP's spelling of what they take and give ([`yarp`]);
//!   and the services that put them onto ports ([`YarpServices`]).
//! * Accepts: requests of programs. Emits: what the filtered interface of a robot takes (`Filtered` of the contract), as any agent does.
//! * Promises: nothing here can move a robot past supervise; what a program says wrongly is answered, and costs nobody else anything.

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
