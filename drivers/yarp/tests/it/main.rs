//! Tests of this package from outside, one module per promise, in one binary.

mod arms;
mod cameras;
mod net;
mod real_time;
mod way;
mod yarp_left_behind;
mod yarp_slides;
mod yarp_virtual;
