//! Tests of this package from outside, one module per promise, in one binary.

mod conformance;
mod eyes;
mod plant;
mod sim;
mod stopping;
