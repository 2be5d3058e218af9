//! What robots do: roadmaps, planners and agents, pure.

pub mod nn;
