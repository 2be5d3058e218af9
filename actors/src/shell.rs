//! The shells: ractor actors that turn messages into inputs of the cores, and their outputs into sends.

mod agent;
mod driver;
mod history;
mod model;
mod reflex;
mod sensor;
mod service;
mod supervise;

pub use agent::{AgentActor, AgentMsg, Maker, PlannerSlot, SwapRequest};
pub use driver::{DriverActor, DriverMsg};
pub use history::{HistoryActor, HistoryMsg};
pub use model::{ModelActor, ModelMsg};
pub use reflex::{ReflexActor, ReflexMsg};
pub use sensor::{CameraActor, DetectorActor, PartMaker, Sensor};
pub use service::{GRACE, Post, ServiceActor, ServiceMsg};
pub use supervise::{SuperviseActor, SuperviseMsg};
