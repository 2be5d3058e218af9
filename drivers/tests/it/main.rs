//! The tests of this package from outside, one module per promise, in one binary: a binary for each took longer to link than to run.

mod arms;
mod cameras;
mod conformance;
mod eyes;
mod net;
mod plant;
mod real_time;
mod sim;
mod stopping;
mod way;
mod yarp_left_behind;
mod yarp_slides;
mod yarp_virtual;
