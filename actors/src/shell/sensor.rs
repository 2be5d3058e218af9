//! A sensor's shells: its camera, and the detector behind it.
//!
//! ```text
//! camera ──Frame──> [ latest value ] ──> detector ──Sighted──> journal
//! ```
//! Who is slower than the camera sees the newest frame, and the ones between are dropped and counted.

use crate::runtime::attempt::{Given, attempt};
use crate::runtime::stream::Stream;
use crate::wiring::SharedContext;
use mobee_contract::{Camera, Detector, Event, Frame};
use ractor::{Actor, ActorProcessingErr, ActorRef};
use std::sync::Arc;
use std::time::Duration;

/// How long one frame may take.
const PATIENCE: Duration = Duration::from_secs(10);

/// Makes a part of a sensor, at the start and after each of its deaths.
pub type PartMaker<T> = Arc<dyn Fn() -> Result<Box<T>, String> + Send + Sync>;

/// A camera, and the detector behind it.
pub struct SensorSetup {
    /// Its name: unique in the setup, and no robot's.
    pub name: String,
    /// Makes the camera, at the start and after each of its deaths.
    pub camera: PartMaker<dyn Camera>,
    /// Makes the detector, at the start and after each of its deaths.
    pub detector: PartMaker<dyn Detector>,
}

/// What outlives the actors of one sensor.
pub struct Sensor {
    /// Its name.
    pub name: String,
    /// Makes its camera.
    pub camera: PartMaker<dyn Camera>,
    /// Makes its detector.
    pub detector: PartMaker<dyn Detector>,
    /// From the one to the other: the newest frame.
    pub frames: Stream<Frame>,
}

impl From<SensorSetup> for Sensor {
    fn from(setup: SensorSetup) -> Sensor {
        let SensorSetup { name, camera, detector } = setup;
        let frames = Stream::new(format!("{name}/camera>detector"), 1);
        Sensor { name, camera, detector, frames }
    }
}

/// The camera's actor.
pub struct CameraActor;

/// What it hears.
#[derive(Debug)]
pub enum CameraMsg {
    /// It is time for a frame.
    Expose,
}

impl Actor for CameraActor {
    type Msg = CameraMsg;
    type State = (Arc<SharedContext>, Arc<Sensor>, Box<dyn Camera>);
    type Arguments = (Arc<SharedContext>, Arc<Sensor>);

    async fn pre_start(
        &self,
        myself: ActorRef<CameraMsg>,
        (shared, sensor): Self::Arguments,
    ) -> Result<Self::State, ActorProcessingErr> {
        let camera = (sensor.camera)()?;
        myself.send_after(camera.period(), || CameraMsg::Expose);
        Ok((shared, sensor, camera))
    }

    async fn handle(
        &self,
        myself: ActorRef<CameraMsg>,
        _: CameraMsg,
        (shared, sensor, camera): &mut Self::State,
    ) -> Result<(), ActorProcessingErr> {
        if let Some(frame) = camera.frame(shared.clock.now())? {
            sensor.frames.push(frame);
        }
        myself.send_after(camera.period(), || CameraMsg::Expose);
        Ok(())
    }
}

/// The detector's actor.
pub struct DetectorActor;

/// What it hears.
#[derive(Debug)]
pub enum DetectorMsg {
    /// There is a frame.
    Frames,
}

impl Actor for DetectorActor {
    type Msg = DetectorMsg;
    /// The detector is away while it looks at a frame.
    type State = (Arc<SharedContext>, Arc<Sensor>, Option<Box<dyn Detector>>);
    type Arguments = (Arc<SharedContext>, Arc<Sensor>);

    async fn pre_start(
        &self,
        myself: ActorRef<DetectorMsg>,
        (shared, sensor): Self::Arguments,
    ) -> Result<Self::State, ActorProcessingErr> {
        let detector = (sensor.detector)()?;
        sensor.frames.attach(Box::new(move || myself.send_message(DetectorMsg::Frames).is_ok()));
        Ok((shared, sensor, Some(detector)))
    }

    async fn handle(
        &self,
        _: ActorRef<DetectorMsg>,
        _: DetectorMsg,
        (shared, sensor, detector): &mut Self::State,
    ) -> Result<(), ActorProcessingErr> {
        while let Some(frame) = sensor.frames.pop() {
            let mut looks = detector.take().ok_or("the detector is away")?;
            let exposed = frame.exposed;
            let look = move || {
                let (regions, cost) = (looks.detect(&frame), looks.takes());
                Given { value: (looks, regions), cost }
            };
            let (looks, regions) = attempt(&shared.clock, PATIENCE, look).await?;
            *detector = Some(looks);
            shared.tell(Event::Sighted { sensor: sensor.name.clone(), exposed, regions });
        }
        Ok(())
    }
}
