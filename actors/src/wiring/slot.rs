//! Who plans for a robot, as far as it must survive the death of the agent's actor.

use crate::runtime::swap::{SwapCore, SwapPolicy};
use mobee_contract::{Agent, Snapshot};
use std::sync::Arc;

/// Makes an agent, at the start and after each death.
#[derive(Clone)]
pub struct Maker(pub Arc<dyn Fn() -> Result<Box<dyn Agent>, String> + Send + Sync>);

impl std::fmt::Debug for Maker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Maker")
    }
}

/// A new planner, as it is offered.
#[derive(Clone, Debug)]
pub struct SwapRequest {
    /// Makes it.
    pub maker: Maker,
    /// What it is, in words: its kind and the file it comes from.
    pub what: String,
    /// Whether it begins anew instead of taking the old one's state.
    pub fresh: bool,
    /// What it must go through.
    pub terms: SwapPolicy,
}

/// A robot's planners, as far as they must survive the death of their actor.
#[derive(Debug, Default)]
pub struct PlannerSlot {
    /// Makes the one in force.
    pub maker: Option<Maker>,
    /// Makes the one that was replaced, from its state then; while the new one is on probation.
    pub former: Option<(Maker, Snapshot)>,
    /// How far the swap is.
    pub core: SwapCore,
}
