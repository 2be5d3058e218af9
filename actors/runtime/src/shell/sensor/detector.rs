//! The detector's shell.

use super::{CameraChannel, DetectorVersion, FRAME_TIMEOUT, FrameDetections, PartMaker};
use crate::attempt::{Timed, attempt};
use crate::wiring::SharedContext;
use mobee_contract::{Detector, Event, Frame, Region, SeenPicture, SwapPart, SwapStep, limit_regions};
use ractor::{Actor, ActorProcessingErr, ActorRef, RpcReplyPort};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// The detector's actor.
pub struct DetectorActor;

/// Message to a detector.
pub enum DetectorMsg {
    /// A frame is queued.
    Frames,
    /// Start a new detector as an observer: its detections are recorded beside the active one's and not used.
    LookOn {
        /// Creates it.
        maker: PartMaker<dyn Detector>,
        /// Time limit for a frame.
        budget: Duration,
    },
    /// Replace the detector; the new one receives the state of this one unless it starts fresh. Replied to when
    /// done.
    TakeOver {
        /// Creates it.
        maker: PartMaker<dyn Detector>,
        /// True if it starts without the state.
        fresh: bool,
        /// Port for the reply.
        reply: RpcReplyPort<()>,
    },
}

/// State of a [`DetectorActor`].
pub struct DetectorState {
    shared: Arc<SharedContext>,
    channel: Arc<CameraChannel>,
    /// Absent while it processes a frame.
    detector: Option<Box<dyn Detector>>,
    /// An observing candidate, and its time limit for a frame.
    onlooker: Option<(Box<dyn Detector>, Duration)>,
    /// True if the warning about non-finite output has been logged.
    warned_unsound: bool,
}

impl DetectorState {
    /// Creates the active detector. One that rejects the stored state starts fresh.
    fn make(&mut self) -> Result<(), String> {
        let DetectorVersion { maker, state } = self.channel.slot.part();
        let mut detector = maker()?;
        if let Some(state) = state {
            let _ = detector.import(state);
        }
        self.detector = Some(detector);
        Ok(())
    }

    /// Activates another detector.
    fn take_over(&mut self, maker: PartMaker<dyn Detector>, fresh: bool) -> Result<(), String> {
        self.onlooker = None;
        let now = self.shared.clock.now();
        let state = self.channel.slot.part().state.filter(|_| !fresh);
        if !self.channel.slot.take_over(DetectorVersion { maker, state }, now) {
            return Ok(());
        }
        // Reported first: a failure of its creation is a reason to revert.
        self.shared.report_swap_beside(
            &self.channel.name,
            SwapPart::Detector,
            SwapStep::TookOver { gap: 0.0, map: None },
        );
        self.make()
    }

    /// Passes a frame to the observing candidate, if there is one. A candidate that fails is dropped, and its
    /// exchange is notified.
    async fn look_on(&mut self, frame: &Frame) {
        let Some((mut detector, budget)) = self.onlooker.take() else { return };
        let frame = frame.clone();
        let exposed = frame.exposed;
        let most = self.channel.max_regions;
        let look = move || {
            let mut regions = detector.detect(&frame);
            let failure = detector.failure();
            regions.retain(Region::is_finite);
            let omitted = detector.omitted() + limit_regions(&mut regions, most);
            // A virtual clock does not wait for an observer, but one that is too slow fails with any clock.
            let cost = if detector.takes() > budget { detector.takes() } else { Duration::ZERO };
            Timed { value: (detector, regions, omitted, failure), cost }
        };
        match attempt(&self.shared.clock, budget, look).await {
            Ok((detector, regions, omitted, None)) => {
                self.onlooker = Some((detector, budget));
                let camera = self.channel.name.clone();
                self.shared.emit(Event::Sighted { camera, exposed, regions, omitted, is_shadow: true });
            }
            Ok((.., Some(why))) | Err(why) => *self.channel.onlooker_fault.lock() = Some(why),
        }
    }

    /// Processes the newest frame. Returns `false` if no frame is queued.
    async fn look(&mut self) -> Result<bool, String> {
        let Some(frame) = self.channel.frames.pop() else { return Ok(false) };
        let shown = frame.clone();
        let mut detector = self.detector.take().ok_or("the detector is away")?;
        let exposed = frame.exposed;
        let intrinsics = frame.intrinsics;
        let most = self.channel.max_regions;
        let look = move || {
            let mut regions = detector.detect(&frame);
            let cost = detector.takes();
            let all = regions.len();
            regions.retain(Region::is_finite);
            let is_sound = regions.len() == all;
            let omitted = detector.omitted() + limit_regions(&mut regions, most);
            let extras = (detector.export(), detector.mask(), detector.complaint());
            let answer = detector.failure().map_or(Ok((regions, omitted)), Err);
            Timed { value: (detector, answer, is_sound, extras), cost }
        };
        let budget = self.channel.slot.budget().unwrap_or(FRAME_TIMEOUT);
        let seen = attempt(&self.shared.clock, budget, look).await?;
        let (detector, answer, is_sound, (state, mask, complaint)) = seen;
        let (regions, omitted) = answer?;
        self.detector = Some(detector);
        self.channel.slot.change(|version| version.state = state);
        self.channel.slot.answered(self.shared.clock.now());
        if let Some(seen) = &self.channel.seen {
            let camera = self.channel.name.as_str().into();
            seen.push(FrameDetections { camera, intrinsics, exposed, regions: regions.clone() });
        }
        if let Some(what) = complaint {
            self.shared.emit(Event::Warning { text: format!("{}: {what}", self.channel.name) });
        }
        if !is_sound && !std::mem::replace(&mut self.warned_unsound, true) {
            let text =
                format!("{}: its detector told numbers that are none: what has them is left out", self.channel.name);
            self.shared.emit(Event::Warning { text });
        }
        if omitted > 0 {
            self.warn_omitted(omitted);
        }
        let mount = self.channel.mount.lock().clone();
        let seen = SeenPicture { frame: shown.clone(), regions: regions.as_slice().into(), mask, mount };
        self.shared.taps.picture(self.shared.clock.now(), &self.channel.name, &Arc::new(seen));
        self.shared.emit(Event::Sighted {
            camera: self.channel.name.clone(),
            exposed,
            regions,
            omitted,
            is_shadow: false,
        });
        self.look_on(&shown).await;
        Ok(true)
    }
}

impl DetectorState {
    /// Warns of omitted regions, once in a run.
    fn warn_omitted(&self, omitted: u64) {
        if self.channel.warned_omitted.swap(true, Ordering::Relaxed) {
            return;
        }
        let name = &self.channel.name;
        let most = self.channel.max_regions;
        let text = format!(
            "{name}: its detector found {omitted} regions in one picture beyond the first {most} of each object; they are left out and \
             counted. If they are noise, train the detector again; else raise `max_regions`"
        );
        self.shared.emit(Event::Warning { text });
    }
}

impl Actor for DetectorActor {
    type Msg = DetectorMsg;
    type State = DetectorState;
    type Arguments = (Arc<SharedContext>, Arc<CameraChannel>);

    async fn pre_start(
        &self,
        myself: ActorRef<DetectorMsg>,
        (shared, channel): Self::Arguments,
    ) -> Result<DetectorState, ActorProcessingErr> {
        let mut state = DetectorState { shared, channel, detector: None, onlooker: None, warned_unsound: false };
        state.make()?;
        state.channel.detector.connect(myself.clone());
        state.channel.frames.attach(Box::new(move || myself.send_message(DetectorMsg::Frames).is_ok()));
        Ok(state)
    }

    async fn handle(
        &self,
        myself: ActorRef<DetectorMsg>,
        message: DetectorMsg,
        state: &mut DetectorState,
    ) -> Result<(), ActorProcessingErr> {
        match message {
            // One frame per message: other messages are handled even if a newer frame is always queued.
            DetectorMsg::Frames if state.look().await? => myself.send_message(DetectorMsg::Frames)?,
            DetectorMsg::Frames => {}
            DetectorMsg::LookOn { maker, budget } => match maker() {
                Ok(detector) => state.onlooker = Some((detector, budget)),
                Err(why) => *state.channel.onlooker_fault.lock() = Some(why),
            },
            DetectorMsg::TakeOver { maker, fresh, reply } => {
                state.take_over(maker, fresh)?;
                // The caller may have timed out.
                let _ = reply.send(());
            }
        }
        Ok(())
    }
}
