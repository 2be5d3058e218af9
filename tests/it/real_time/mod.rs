//! In real time, with sockets and other processes: most of each of these tests is waiting. nextest finds them by this module's name
//! (`.config/nextest.toml`) and keeps those that compute away from them.

mod agent_over_yarp;
mod crash_recovery;
pub(crate) mod ctl;
mod ctl_sensors;
mod doctor;
mod filter_transparency;
mod old_program;
mod process_faults;
mod rest_pose;
mod second_run;
mod servo_arm;
mod slides_over_yarp;
mod swap_over_yarp;
mod through_the_filter;
mod yarp_cycles;
