//! A sensor's shells: its cameras, the detector behind each of them, and the locator behind these.
//!
//! ```text
//! camera ──Frame──> [ latest value ] ──> detector ──Seen──> [ latest value ] ──┐
//! camera ──Frame──> [ latest value ] ──> detector ──Seen──> [ latest value ] ──┴──> locator ──Located──> journal
//!                                           └──Sighted──> journal                      │
//!                                                              history at the exposure ┘
//! ```
//! The world gate (`sensor/world_gate.rs`) admits the locator's results to the model. A part that is slower
//! than its source receives the newest value; the values in between are dropped and counted.

mod camera;
mod detector;
mod locator;
mod world_gate;

pub use camera::CameraActor;
pub use detector::{DetectorActor, DetectorMsg};
pub use locator::{LocatorActor, LocatorMsg};
pub use world_gate::{KeptObject, WorldGate, WorldGateSettings};

use crate::stream::{Stream, StreamCounters};
use crate::wiring::{ActorLink, LatestCell, PartSlot, RobotContext, SharedContext};
use mobee_contract::{
    Camera, CameraMount, Detector, Event, Frame, Intrinsics, Locator, Region, Snapshot, SwapPart, SwapStep, Time,
};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64};
use std::time::Duration;

/// Time limit for one frame.
const FRAME_TIMEOUT: Duration = Duration::from_secs(10);

/// Creates a part of a sensor, at the start and after each of its deaths.
pub type PartMaker<T> = Arc<dyn Fn() -> Result<Box<T>, String> + Send + Sync>;

/// Settings of a sensor: cameras that see one world, with the detectors and the locator for their frames.
pub struct SensorSetup {
    /// Name of the sensor: unique in the setup, and different from all robots' names.
    pub name: String,
    /// Its cameras.
    pub cameras: Vec<CameraSetup>,
    /// True if they are simulated: scripts then move the objects that the sensor tracks in the truth only.
    pub is_simulated: bool,
    /// Locator for the detections; `None`: they are recorded, and no object is located.
    pub locator: Option<LocatorSetup>,
}

/// Settings of a camera and its detector.
pub struct CameraSetup {
    /// Name of the camera, unique in its sensor.
    pub name: String,
    /// Creates the camera.
    pub camera: PartMaker<dyn Camera>,
    /// Creates the detector.
    pub detector: PartMaker<dyn Detector>,
    /// Greatest number of regions of each object in one image.
    pub max_regions: usize,
}

/// Settings of a locator, and of the robot that carries the cameras.
pub struct LocatorSetup {
    /// The robot that carries the cameras.
    pub robot: String,
    /// Creates the locator.
    pub locator: PartMaker<dyn Locator>,
    /// Settings of the gate to the model; `None`: results are recorded, and the model is not changed.
    pub gate: Option<WorldGateSettings>,
}

impl SensorSetup {
    /// Names of the objects that it tracks.
    pub fn tracked_objects(&self) -> &[String] {
        self.locator.iter().find_map(|l| l.gate.as_ref()).map_or(&[], |gate| &gate.objects)
    }
}

/// State of one sensor that survives its actors.
pub struct Sensor {
    /// Name of the sensor.
    pub name: String,
    /// Its cameras.
    pub channels: Vec<Arc<CameraChannel>>,
    /// Its locator, if it has one.
    pub locator_slot: Option<Arc<LocatorSlot>>,
}

/// State of one camera and its detector that survives their actors.
pub struct CameraChannel {
    /// Name in the run: `<sensor>/<camera>`.
    pub name: String,
    camera: PartMaker<dyn Camera>,
    /// Mount of the camera on its robot, for the recording.
    mount: LatestCell<Option<CameraMount>>,
    /// Greatest number of regions of each object in one image.
    max_regions: usize,
    /// Number of images that its camera has skipped.
    skipped: AtomicU64,
    /// True if the warning about omitted regions has been logged.
    warned_omitted: AtomicBool,
    /// The active detector, and the state of its exchange.
    pub slot: PartSlot<DetectorVersion>,
    /// Reason for which a new, observing detector has failed.
    pub onlooker_fault: LatestCell<Option<String>>,
    /// Link to its detector.
    pub detector: ActorLink<DetectorMsg>,
    frames: Stream<Frame>,
    /// Detections for the locator; `None` without a locator.
    seen: Option<Stream<FrameDetections>>,
}

/// State of a locator that survives its actor.
pub struct LocatorSlot {
    /// Name of the locator in the run.
    pub name: String,
    /// Name of its sensor.
    pub sensor: String,
    robot: Arc<RobotContext>,
    /// The active locator, and the state of its exchange.
    pub slot: PartSlot<LocatorVersion>,
    /// Link to its actor.
    pub locator: ActorLink<LocatorMsg>,
    /// Gate to the model.
    pub gate: Option<LatestCell<WorldGate>>,
}

/// An exchangeable detector: its maker and its trained state.
#[derive(Clone)]
pub struct DetectorVersion {
    /// Creates it.
    pub maker: PartMaker<dyn Detector>,
    /// State after its last frame.
    pub state: Option<Snapshot>,
}

/// An exchangeable locator: its maker and its state.
#[derive(Clone)]
pub struct LocatorVersion {
    /// Creates it.
    pub maker: PartMaker<dyn Locator>,
    /// State after its last call.
    pub state: Option<Snapshot>,
}

/// Detections in one frame.
struct FrameDetections {
    camera: Arc<str>,
    intrinsics: Intrinsics,
    exposed: Time,
    regions: Vec<Region>,
}

impl Sensor {
    /// Creates the sensor from its settings, in a run with these robots.
    ///
    /// # Errors
    /// The name of a robot that does not exist.
    pub fn new(setup: SensorSetup, robots: &[Arc<RobotContext>], now: Time) -> Result<Sensor, String> {
        let SensorSetup { name, cameras, is_simulated: _, locator } = setup;
        let placed = locator.is_some();
        let channel =
            |setup: CameraSetup| Arc::new(CameraChannel::new(format!("{name}/{}", setup.name), setup, placed));
        let channels = cameras.into_iter().map(channel).collect();
        let locator_slot = locator.map(|setup| {
            let robot = robots.iter().find(|r| r.name == setup.robot).cloned().ok_or(setup.robot)?;
            let own = format!("{name}/{}", mobee_journal::names::LOCATOR);
            let sensor = name.clone();
            let locator = ActorLink::default();
            let slot = PartSlot::new(LocatorVersion { maker: setup.locator, state: None });
            let gate = setup.gate.map(|settings| LatestCell::new(WorldGate::new(settings, now)));
            Ok::<_, String>(Arc::new(LocatorSlot { name: own, sensor, robot, slot, locator, gate }))
        });
        let locator_slot = locator_slot.transpose()?;
        Ok(Sensor { name, channels, locator_slot })
    }
}

impl CameraChannel {
    fn new(name: String, setup: CameraSetup, placed: bool) -> CameraChannel {
        CameraChannel {
            camera: setup.camera,
            mount: LatestCell::default(),
            max_regions: setup.max_regions,
            skipped: AtomicU64::new(0),
            warned_omitted: AtomicBool::new(false),
            slot: PartSlot::new(DetectorVersion { maker: setup.detector, state: None }),
            onlooker_fault: LatestCell::default(),
            detector: ActorLink::default(),
            frames: Stream::new(format!("{name}/camera>detector"), 1),
            seen: placed.then(|| Stream::new(format!("{name}/detector>locator"), 1)),
            name,
        }
    }

    /// Names and counters of its links.
    pub fn counters(&self) -> impl Iterator<Item = (String, StreamCounters)> {
        let frames = (self.frames.name(), self.frames.counters());
        [frames].into_iter().chain(self.seen.as_ref().map(|seen| (seen.name(), seen.counters())))
    }

    /// Counters of its links, as the events that a run ends with.
    pub fn links(&self) -> impl Iterator<Item = Event> {
        [self.frames.link()].into_iter().chain(self.seen.as_ref().map(Stream::link))
    }

    /// Reports a failure of its detector: on probation the previous one returns.
    pub fn failed(&self, shared: &SharedContext, why: &str) {
        if self.slot.broke(shared.clock.now()) {
            shared.report_swap_beside(&self.name, SwapPart::Detector, SwapStep::Reverted { why: why.into() });
        }
    }
}

impl LocatorSlot {
    /// Reports a failure of its locator: on probation the previous one returns.
    pub fn failed(&self, shared: &SharedContext, why: &str) {
        if self.slot.broke(shared.clock.now()) {
            shared.report_swap_beside(&self.sensor, SwapPart::Locator, SwapStep::Reverted { why: why.into() });
        }
    }
}
