//! The tests of this package from outside, one module per promise, in one binary: a binary for each took longer to link than to run.

mod agent_over_yarp;
mod broken_files;
mod common;
mod composition_matrix;
mod config_layers;
mod crash_recovery;
mod ctl;
mod dependency_direction;
mod doctor;
mod filter_transparency;
mod hostile_files;
mod new_behavior;
mod old_program;
mod planted_defects;
mod process_faults;
mod replay;
mod resume_evidence;
mod same_seed_same_run;
mod schema;
mod shipped_behaviors;
mod swap_over_yarp;
mod through_the_filter;
mod torture_seeds;
mod wrong_input;
mod yarp_cycles;
mod yarp_tools;
