//! Kinds of this crate: a driver `my_arm`, an agent `my_arm_wave` and a camera `my_arm_camera`.
//!
//! Each registers itself by `inventory::submit!`. `cargo run -- kinds my_arm` shows its settings.

pub mod agent;
pub mod camera;
pub mod driver;
