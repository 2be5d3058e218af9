//! Properties of the locators.

mod files;
mod recorded;
mod rows;
mod running;
mod simulated;
#[path = "../../benches/simulated_head/mod.rs"]
mod simulated_head;
