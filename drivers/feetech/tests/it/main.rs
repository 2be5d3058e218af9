//! The tests of this package from outside, in one binary.

#![cfg(unix)]

mod arm;
mod calibrating;
mod real_time;
mod settings;
