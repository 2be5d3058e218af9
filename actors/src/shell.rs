//! The shells: ractor actors that turn messages into inputs of the cores, and their outputs into sends.

mod agent;
mod driver;
mod history;
mod model;
mod reflex;
mod sensor;
mod service;
mod supervise;

pub use agent::AgentActor;
pub use driver::DriverActor;
pub use history::{HistoryActor, HistoryMsg};
pub use model::ModelActor;
pub use reflex::ReflexActor;
pub use sensor::{
    CameraActor, CameraSetup, DetectorActor, DetectorMsg, Eye, KeptObject, LocatorActor, LocatorMsg, LocatorSetup,
    PartMaker, Placing, Sensor, SensorSetup, WorldGate, WorldGateSettings,
};
pub use service::{GRACE, Post, ServiceActor, ServiceMsg, named_apart};
pub use supervise::SuperviseActor;
