//! YARP in pure Rust: bottles, ports, carriers, the name server and control boards, without libYARP.

pub mod auth;
pub mod config;
mod contact;
pub mod name;
mod network;
mod value;

pub use config::ConfigError;
pub use contact::Contact;
pub use name::NameError;
pub use network::{Network, TIMEOUT};
pub use value::*;
