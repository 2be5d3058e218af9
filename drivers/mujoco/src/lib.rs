//! MuJoCo as the physics of simulated arms: `driver = { kind = "sim", physics = "mujoco", ... }`.
//!
//! ```text
//! Scene (robot, objects) + servos ──mjcf──> MJCF ──MuJoCo──> MujocoArm, an ArmBody behind the simulated board
//! ```
//!
//! * Owns: the conversion of a robot model to MuJoCo's XML format ([`mjcf`]), and, with the feature `mujoco`,
//!   the arm simulated by MuJoCo.
//! * Promises: shapes, joints, limits and the pairs that may touch are those of the robot model; the same commands give the same motion,
//!   bit for bit.
//! * The board in front of the arm (moves, stops, leases, encoders, faults) is that of `mobee-sim`: the
//!   two kinds of physics differ in nothing else.
//!
//! Source: Todorov, Erez, Tassa, "MuJoCo: A physics engine for model-based control", IROS 2012, doi:10.1109/IROS.2012.6386109.

#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::unreachable, clippy::indexing_slicing)
)]

pub mod mjcf;

#[cfg(feature = "mujoco")]
mod arm;

#[cfg(feature = "mujoco")]
pub use arm::MujocoArm;
