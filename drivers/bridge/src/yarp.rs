//! YARP's spelling of requests and replies: the one place where a bottle becomes a request, and a reply a bottle.
//!
//! ```text
//! Bottle ──world::parse──> WorldRequest ──WorldRpc──> WorldReply, WorldRefusal ──world::reply──> Bottle
//! Bottle ──part::parse──>  PartRequest  ──part_rpc──> PartReply, PartRefusal   ──part::reply──>  Bottle
//! Bottle ──robot::parse──> RobotRequest ──robot_rpc──> RobotReply, RobotRefusal ──robot::reply──> Bottle
//! Bottle ──seen::parse──>  SeenRegions (what a detector saw)                   ──bottle──>        Bottle
//! Bottle ──board::parse──> BoardRequest ──FilterCore──> BoardReply             ──board::reply──> Bottle
//! ```
//!
//! * Owns: verbs, the order of arguments, the sentences of replies and their bytes, all as the original and real boards have them.
//! * Promises: every bottle becomes a request, even if it is one that will be refused.

pub(crate) mod board;
pub(crate) mod observation;
pub(crate) mod part;
pub(crate) mod robot;
pub mod seen;
pub(crate) mod wish;
pub(crate) mod words;
pub mod world;
