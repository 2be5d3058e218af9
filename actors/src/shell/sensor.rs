//! A sensor's shells: its cameras, the detector behind each of them, and the locator behind these.
//!
//! ```text
//! camera ──Frame──> [ latest value ] ──> detector ──Seen──> [ latest value ] ──┐
//! camera ──Frame──> [ latest value ] ──> detector ──Seen──> [ latest value ] ──┴──> locator ──Located──> journal
//!                                           └──Sighted──> journal                      │
//!                                                              history at the exposure ┘
//! ```
//! What the locator tells goes through the world gate (`sensor/world_gate.rs`) into the model.
//! Who is slower than the one before it sees the newest, and what comes in between is dropped and counted.

mod camera;
mod detector;
mod locator;
mod world_gate;

pub use camera::CameraActor;
pub use detector::{DetectorActor, DetectorMsg};
pub use locator::{LocatorActor, LocatorMsg};
pub use world_gate::{KeptObject, WorldGate, WorldGateSettings};

use crate::runtime::stream::{Stream, StreamCounters};
use crate::wiring::{ActorLink, LatestCell, RobotContext, Seat, SharedContext};
use mobee_contract::{
    Camera, CameraMount, Detector, Event, Frame, Intrinsics, Locator, Region, Snapshot, SwapPart, SwapStep, Time,
};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64};
use std::time::Duration;

/// How long one frame may take.
const PATIENCE: Duration = Duration::from_secs(10);

/// Makes a part of a sensor, at the start and after each of its deaths.
pub type PartMaker<T> = Arc<dyn Fn() -> Result<Box<T>, String> + Send + Sync>;

/// Cameras that look at one world, and what finds and places things in their frames.
pub struct SensorSetup {
    /// Its name: unique in the setup, and no robot's.
    pub name: String,
    /// Its cameras.
    pub cameras: Vec<CameraSetup>,
    /// Whether they are simulated: the objects that it keeps are then moved by scripts in truth alone.
    pub is_simulated: bool,
    /// What places what they see; `None`: it is told and not placed.
    pub locator: Option<LocatorSetup>,
}

/// A camera, and the detector behind it.
pub struct CameraSetup {
    /// Its name, unique in its sensor.
    pub name: String,
    /// Makes the camera.
    pub camera: PartMaker<dyn Camera>,
    /// Makes the detector.
    pub detector: PartMaker<dyn Detector>,
    /// Greatest number of regions of each object in one picture.
    pub max_regions: usize,
}

/// A locator, and whose body it goes by.
pub struct LocatorSetup {
    /// The robot that carries the cameras.
    pub robot: String,
    /// Makes the locator.
    pub locator: PartMaker<dyn Locator>,
    /// What of it becomes the model's; `None`: it is told and changes nothing.
    pub gate: Option<WorldGateSettings>,
}

impl SensorSetup {
    /// The objects that it keeps.
    pub fn keeps(&self) -> &[String] {
        self.locator.iter().find_map(|l| l.gate.as_ref()).map_or(&[], |gate| &gate.objects)
    }
}

/// What outlives the actors of one sensor.
pub struct Sensor {
    /// Its name.
    pub name: String,
    /// Its cameras.
    pub eyes: Vec<Arc<Eye>>,
    /// Its locator, if it has one.
    pub placing: Option<Arc<Placing>>,
}

/// What outlives the actors of one camera and its detector.
pub struct Eye {
    /// Its name in the run: its sensor's, and its own.
    pub name: String,
    camera: PartMaker<dyn Camera>,
    /// Where the camera is on its robot, for the recording.
    mount: LatestCell<Option<CameraMount>>,
    /// Greatest number of regions of each object in one picture.
    max_regions: usize,
    /// Pictures that its camera has skipped.
    skipped: AtomicU64,
    /// Whether it was reported that regions are left out.
    told_omitted: AtomicBool,
    /// Which detector looks, and how far its exchange is.
    pub seat: Seat<Looking>,
    /// Why a new detector that looked on does so no more.
    pub onlooker_fault: LatestCell<Option<String>>,
    /// The line to its detector.
    pub detector: ActorLink<DetectorMsg>,
    frames: Stream<Frame>,
    /// None without a locator.
    seen: Option<Stream<Seen>>,
}

/// What outlives the locator's actor.
pub struct Placing {
    /// Its name in the run.
    pub name: String,
    /// Its sensor's.
    pub sensor: String,
    robot: Arc<RobotContext>,
    /// Which locator places, and how far its exchange is.
    pub seat: Seat<Remembering>,
    /// The line to it.
    pub locator: ActorLink<LocatorMsg>,
    /// What of it becomes the model's.
    pub gate: Option<LatestCell<WorldGate>>,
}

/// A detector that looks: how it is made, and what it has learned.
#[derive(Clone)]
pub struct Looking {
    /// Makes it.
    pub maker: PartMaker<dyn Detector>,
    /// What it knew after its last frame.
    pub state: Option<Snapshot>,
}

/// A locator that places: how it is made, and what it remembers.
#[derive(Clone)]
pub struct Remembering {
    /// Makes it.
    pub maker: PartMaker<dyn Locator>,
    /// What it knew after it was last asked.
    pub state: Option<Snapshot>,
}

/// What a detector saw in one frame.
struct Seen {
    camera: Arc<str>,
    intrinsics: Intrinsics,
    exposed: Time,
    regions: Vec<Region>,
}

impl Sensor {
    /// From its setup, in a run with these robots.
    ///
    /// # Errors
    /// The name of a robot that there is not.
    pub fn new(setup: SensorSetup, robots: &[Arc<RobotContext>], now: Time) -> Result<Sensor, String> {
        let SensorSetup { name, cameras, is_simulated: _, locator } = setup;
        let placed = locator.is_some();
        let eye = |setup: CameraSetup| Arc::new(Eye::new(format!("{name}/{}", setup.name), setup, placed));
        let eyes = cameras.into_iter().map(eye).collect();
        let placing = locator.map(|setup| {
            let robot = robots.iter().find(|r| r.name == setup.robot).cloned().ok_or(setup.robot)?;
            let own = format!("{name}/{}", crate::record::names::LOCATOR);
            let (sensor, locator) = (name.clone(), ActorLink::default());
            let seat = Seat::new(Remembering { maker: setup.locator, state: None });
            let gate = setup.gate.map(|settings| LatestCell::new(WorldGate::new(settings, now)));
            Ok::<_, String>(Arc::new(Placing { name: own, sensor, robot, seat, locator, gate }))
        });
        let placing = placing.transpose()?;
        Ok(Sensor { name, eyes, placing })
    }
}

impl Eye {
    fn new(name: String, setup: CameraSetup, placed: bool) -> Eye {
        Eye {
            camera: setup.camera,
            mount: LatestCell::default(),
            max_regions: setup.max_regions,
            skipped: AtomicU64::new(0),
            told_omitted: AtomicBool::new(false),
            seat: Seat::new(Looking { maker: setup.detector, state: None }),
            onlooker_fault: LatestCell::default(),
            detector: ActorLink::default(),
            frames: Stream::new(format!("{name}/camera>detector"), 1),
            seen: placed.then(|| Stream::new(format!("{name}/detector>locator"), 1)),
            name,
        }
    }

    /// The names and counters of its links.
    pub fn counters(&self) -> impl Iterator<Item = (String, StreamCounters)> {
        let frames = (self.frames.name(), self.frames.counters());
        [frames].into_iter().chain(self.seen.as_ref().map(|seen| (seen.name(), seen.counters())))
    }

    /// The counters of its links as the events that a run ends with.
    pub fn links(&self) -> impl Iterator<Item = Event> {
        [self.frames.link()].into_iter().chain(self.seen.as_ref().map(Stream::link))
    }

    /// Its detector has failed: on probation the one before is back.
    pub fn fell(&self, shared: &SharedContext, why: &str) {
        if self.seat.broke(shared.clock.now()) {
            shared.tell_beside(&self.name, SwapPart::Detector, SwapStep::Reverted { why: why.into() });
        }
    }
}

impl Placing {
    /// Its locator has failed: on probation the one before is back.
    pub fn fell(&self, shared: &SharedContext, why: &str) {
        if self.seat.broke(shared.clock.now()) {
            shared.tell_beside(&self.sensor, SwapPart::Locator, SwapStep::Reverted { why: why.into() });
        }
    }
}
