//! The tests of this package from outside, one module per promise, in one binary: a binary for each took longer to link than to run.

mod check_at_once;
mod check_invariants;
mod check_retreat;
mod commanded;
mod common;
mod displaced;
mod exchange;
mod fifty_seeds;
mod forces;
mod holding_in_contact;
mod journal_chain;
mod one_outcome;
mod real_clock;
mod restart_does_not_move;
mod retreat_is_watched;
mod same_seed_same_run;
mod stream_bounds;
mod streams;
mod supervision_actors;
mod supervision_plan;
mod swap_agent;
mod swap_parts;
mod tap_threads;
mod throughput;
mod together;
mod told_twice;
