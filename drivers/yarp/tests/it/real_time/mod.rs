//! In real time, with sockets and other processes: most of each of these tests is waiting. nextest finds them by this module's name
//! (`.config/nextest.toml`) and keeps those that compute away from them.

mod yarp_conformance;
mod yarp_faults;
mod yarp_stops;
