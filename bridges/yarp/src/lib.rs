//! The bridge to YARP: the services of MoBeE on YARP ports ([`YarpServices`]), and the encoding of their requests and
//! replies, the only place that converts between bottles and requests or replies.
//!
//! ```text
//! Bottle ──world::parse──> WorldRequest ──WorldRpc──> WorldReply, WorldRefusal ──world::reply──> Bottle
//! Bottle ──part::parse──>  PartRequest  ──part_rpc──> PartReply, PartRefusal   ──part::reply──>  Bottle
//! Bottle ──robot::parse──> RobotRequest ──robot_rpc──> RobotReply, RobotRefusal ──robot::reply──> Bottle
//! Bottle ──seen::parse──>  SeenRegions (detections in one image)               ──bottle──>        Bottle
//! Bottle ──board::parse──> BoardRequest ──FilterCore──> BoardReply             ──board::reply──> Bottle
//! ```
//!
//! * Owns: verbs, the order of arguments, the texts of replies and their bytes, as in the original and on
//!   real boards.
//! * Promises: every bottle becomes a request, possibly one that will be refused.

#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::unreachable, clippy::indexing_slicing)
)]

mod board;
mod observation;
mod part;
mod robot;
pub mod seen;
mod services;
mod wish;
mod words;
pub mod world;

pub use services::{RobotPorts, WorldService, YarpServices, YarpSettings};
