//! A robot's planners, as far as they survive the death of the agent's actor.

use crate::swap::{SwapCore, SwapPolicy};
use mobee_contract::{Agent, Snapshot};
use std::sync::Arc;

/// Creates an agent, at the start and after each death.
#[derive(Clone)]
pub struct Maker(pub Arc<dyn Fn() -> Result<Box<dyn Agent>, String> + Send + Sync>);

impl std::fmt::Debug for Maker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Maker")
    }
}

/// Offer of a new planner.
#[derive(Clone, Debug)]
pub struct SwapRequest {
    /// Creates it.
    pub maker: Maker,
    /// Description: its kind and the file that it comes from.
    pub what: String,
    /// True if it starts fresh instead of with the old one's state.
    pub fresh: bool,
    /// Requirements on it.
    pub terms: SwapPolicy,
}

/// A robot's planners, as far as they must survive the death of their actor.
#[derive(Debug, Default)]
pub struct PlannerSlot {
    /// Creates the active one.
    pub maker: Option<Maker>,
    /// Creates the one that was replaced, from its state then; while the new one is on probation.
    pub former: Option<(Maker, Snapshot)>,
    /// State of the swap.
    pub core: SwapCore,
}
