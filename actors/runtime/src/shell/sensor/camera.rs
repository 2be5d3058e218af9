//! The camera's shell.

use super::{CameraChannel, FRAME_TIMEOUT};
use crate::attempt::{Timed, attempt};
use crate::wiring::SharedContext;
use mobee_contract::{Camera, Event, SkippedPictures};
use ractor::{Actor, ActorProcessingErr, ActorRef};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// The camera's actor.
pub struct CameraActor;

/// Message to a camera.
#[derive(Debug)]
pub enum CameraMsg {
    /// A frame is due.
    Expose,
}

/// State of a [`CameraActor`].
pub struct CameraState {
    shared: Arc<SharedContext>,
    channel: Arc<CameraChannel>,
    /// Absent while it takes a frame.
    camera: Option<Box<dyn Camera>>,
}

impl CameraState {
    /// Takes a frame, if there is a new one, and returns the time until the next call.
    async fn expose(&mut self) -> Result<Duration, String> {
        let mut camera = self.camera.take().ok_or("the camera is away")?;
        let now = self.shared.clock.now();
        let expose = move || Timed { value: (camera.frame(now), camera.skipped(), camera), cost: Duration::ZERO };
        let (frame, skipped, camera) = attempt(&self.shared.clock, FRAME_TIMEOUT, expose).await?;
        if let Some(skipped) = skipped {
            self.skip(skipped);
        }
        if let Some(frame) = frame? {
            self.channel.frames.push(frame);
        }
        let next = now + camera.period();
        self.camera = Some(camera);
        Ok(next.since(self.shared.clock.now()))
    }
}

impl CameraState {
    /// Counts images that the camera could not use, and warns of the first one of a run.
    fn skip(&self, SkippedPictures { count, why }: SkippedPictures) {
        self.shared.counts.lock().pictures_skipped += count;
        if self.channel.skipped.fetch_add(count, Ordering::Relaxed) == 0 {
            let text = format!("{}: {why}; such pictures are skipped and counted", self.channel.name);
            self.shared.emit(Event::Warning { text });
        }
    }
}

impl Actor for CameraActor {
    type Msg = CameraMsg;
    type State = CameraState;
    type Arguments = (Arc<SharedContext>, Arc<CameraChannel>);

    async fn pre_start(
        &self,
        myself: ActorRef<CameraMsg>,
        (shared, channel): Self::Arguments,
    ) -> Result<CameraState, ActorProcessingErr> {
        let camera = (channel.camera)()?;
        *channel.mount.lock() = camera.mount();
        myself.send_after(camera.period(), || CameraMsg::Expose);
        Ok(CameraState { shared, channel, camera: Some(camera) })
    }

    async fn handle(
        &self,
        myself: ActorRef<CameraMsg>,
        _: CameraMsg,
        state: &mut CameraState,
    ) -> Result<(), ActorProcessingErr> {
        let wait = state.expose().await?;
        myself.send_after(wait, || CameraMsg::Expose);
        Ok(())
    }
}
