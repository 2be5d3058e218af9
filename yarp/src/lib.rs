//! YARP in pure Rust: bottles, ports, carriers, the name server and control boards, without libYARP.

pub mod auth;
pub mod board;
mod bottle;
mod clock;
pub mod config;
mod contact;
mod guests;
pub mod name;
mod network;
pub mod payload;
mod port;
pub mod remote;
pub mod text;
mod value;
pub mod wire;

pub use bottle::{DecodeError, DecodeLimits};
pub use config::NetworkConfigError;
pub use contact::Contact;
pub use name::{NameError, NameServer, ServerOptions};
pub use network::{Network, NoAddress, TIMEOUT, local_address};
pub use payload::{Image, JointData, JointField, PixelCode, Stamp};
pub use port::*;
pub use text::TextError;
pub use value::*;
pub use wire::Carrier;
