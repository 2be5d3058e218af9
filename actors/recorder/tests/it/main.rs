//! Promises of recordings, a module for each kind.

mod a_model_can_be_looked_at;
mod a_run_can_be_looked_at;
mod the_layout;
