//! YARP in pure Rust: bottles, ports, carriers, the name server and control boards, without libYARP.

mod value;

pub use value::*;
