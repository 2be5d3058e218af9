//! What waits for a serial line.

mod conformance;
mod faults;
mod motions;
mod run;
