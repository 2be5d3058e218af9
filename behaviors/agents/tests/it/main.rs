//! Integration tests of this package, one module per property, in one binary: a binary for each
//! took longer to link than to run.

mod explorer;
mod hand_goals;
mod icub;
mod join;
mod plan_agent;
mod reach_agent;
mod roadmap_agent;
mod short_way;
mod simple_agents;
mod validation;
// registers the agents
use mobee_agents as _;

#[allow(dead_code, reason = "the tests of the planners use the rest")]
#[path = "../../../planning/tests/it/world/mod.rs"]
mod world;
