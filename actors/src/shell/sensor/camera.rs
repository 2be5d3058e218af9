//! The camera's shell.

use super::{Eye, PATIENCE};
use crate::runtime::attempt::{Given, attempt};
use crate::wiring::SharedContext;
use mobee_contract::{Camera, Event, SkippedPictures};
use ractor::{Actor, ActorProcessingErr, ActorRef};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// The camera's actor.
pub struct CameraActor;

/// What it hears.
#[derive(Debug)]
pub enum CameraMsg {
    /// It is time for a frame.
    Expose,
}

/// What it keeps.
pub struct Exposing {
    shared: Arc<SharedContext>,
    eye: Arc<Eye>,
    /// Away while it makes a frame.
    camera: Option<Box<dyn Camera>>,
}

impl Exposing {
    /// Makes the frame of now, if there is a new one, and says when to ask for the next.
    async fn expose(&mut self) -> Result<Duration, String> {
        let mut camera = self.camera.take().ok_or("the camera is away")?;
        let now = self.shared.clock.now();
        let expose = move || Given { value: (camera.frame(now), camera.skipped(), camera), cost: Duration::ZERO };
        let (frame, skipped, camera) = attempt(&self.shared.clock, PATIENCE, expose).await?;
        if let Some(skipped) = skipped {
            self.skip(skipped);
        }
        if let Some(frame) = frame? {
            self.eye.frames.push(frame);
        }
        let next = now + camera.period();
        self.camera = Some(camera);
        Ok(next.since(self.shared.clock.now()))
    }
}

impl Exposing {
    /// Counts pictures that the camera could not use, and warns of the first one of a run.
    fn skip(&self, SkippedPictures { count, why }: SkippedPictures) {
        self.shared.counts.lock().pictures_skipped += count;
        if self.eye.skipped.fetch_add(count, Ordering::Relaxed) == 0 {
            let text = format!("{}: {why}; such pictures are skipped and counted", self.eye.name);
            self.shared.tell(Event::Warning { text });
        }
    }
}

impl Actor for CameraActor {
    type Msg = CameraMsg;
    type State = Exposing;
    type Arguments = (Arc<SharedContext>, Arc<Eye>);

    async fn pre_start(
        &self,
        myself: ActorRef<CameraMsg>,
        (shared, eye): Self::Arguments,
    ) -> Result<Exposing, ActorProcessingErr> {
        let camera = (eye.camera)()?;
        *eye.mount.lock() = camera.mount();
        myself.send_after(camera.period(), || CameraMsg::Expose);
        Ok(Exposing { shared, eye, camera: Some(camera) })
    }

    async fn handle(
        &self,
        myself: ActorRef<CameraMsg>,
        _: CameraMsg,
        exposing: &mut Exposing,
    ) -> Result<(), ActorProcessingErr> {
        let wait = exposing.expose().await?;
        myself.send_after(wait, || CameraMsg::Expose);
        Ok(())
    }
}
