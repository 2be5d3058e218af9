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
    CameraActor, CameraChannel, CameraSetup, DetectorActor, DetectorMsg, KeptObject, LocatorActor, LocatorMsg,
    LocatorSetup, LocatorSlot, PartMaker, Sensor, SensorSetup, WorldGate, WorldGateSettings,
};
pub use service::{GRACE, ServiceActor, ServiceMsg, ServiceSlot, named_apart};
pub use supervise::SuperviseActor;
