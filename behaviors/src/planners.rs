//! Planners: ways through a scene that is known.

pub mod escape;
