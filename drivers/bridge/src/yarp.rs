//! YARP encoding of requests and replies: the only place that converts between bottles and requests or
//! replies.
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

pub(crate) mod board;
pub(crate) mod observation;
pub(crate) mod part;
pub(crate) mod robot;
pub mod seen;
pub(crate) mod wish;
pub(crate) mod words;
pub mod world;
