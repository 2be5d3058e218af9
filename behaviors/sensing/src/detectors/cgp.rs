//! Cartesian genetic programming for image processing, CGP-IP (Harding, Leitner, Schmidhuber 2013):
//! a program is a list of nodes, each an image function of two earlier nodes. The last node is the
//! output; only nodes that it depends on are run.
//!
//! Besides gray, red, green, blue, hue, saturation and value, the inputs contain the color
//! likelihood and the output of a network ([`channels`]). In the papers the threshold is part of
//! the program; here it is fitted to each program's output, which removes a gene that hides good
//! programs from the search.

mod evolve;
mod filters;
mod local;
mod numbers;
mod op;
mod program;
mod show;

pub use evolve::{Evolution, EvolutionState};
pub use op::{ALL_OPS, Op};
pub use program::{Channels, ImageNode, ImageProgram, channels};
