//! Cartesian genetic programming for image processing, CGP-IP (Harding, Leitner, Schmidhuber 2013): a program is a list of nodes,
//! each an image function of two earlier nodes; the last one is the output. Only nodes that it needs are run.
//!
//! Beside grey, red, green, blue, hue, saturation and value the inputs hold what the colors say of the object and what a network
//! says ([`channels`]). The threshold belongs to the program in the papers; here it is fitted to each program's output, which
//! spares the search a gene that hides good programs.

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
