//! The locator's shell: pairs detections with the robot's configuration at the exposure.

use super::{CameraChannel, FRAME_TIMEOUT, FrameDetections, KeptObject, LocatorSlot, LocatorVersion, PartMaker};
use crate::attempt::{Timed, attempt};
use crate::clock::Clock;
use crate::wiring::{AgentMsg, ModelMsg, SharedContext};
use mobee_contract::{Admission, BodyState, Event, Located, Locator, SeenObject, Sighting, SwapPart, SwapStep, Time};
use mobee_controller::history::Unrecorded;
use ractor::{Actor, ActorProcessingErr, ActorRef, RpcReplyPort};
use std::sync::Arc;
use std::time::Duration;

/// Time between two checks for a reading that is not recorded yet: readings may be late by a second.
const READING_RETRY: Duration = Duration::from_millis(10);
/// Most checks for such a reading.
const READING_RETRIES: u32 = 100;

/// Interval of the checks for stale objects.
const STALE_CHECK: Duration = Duration::from_millis(200);

/// The locator's actor.
pub struct LocatorActor;

/// Message to a locator.
pub enum LocatorMsg {
    /// Detections of the camera with this index are queued.
    Seen(usize),
    /// A check for stale objects is due.
    Look,
    /// Replace the locator; the new one receives the state of this one unless it starts fresh. Replied to when
    /// done.
    TakeOver {
        /// Creates it.
        maker: PartMaker<dyn Locator>,
        /// True if it starts without the state.
        fresh: bool,
        /// Port for the reply.
        reply: RpcReplyPort<()>,
    },
}

/// State of a [`LocatorActor`].
pub struct LocatorState {
    shared: Arc<SharedContext>,
    channels: Vec<Arc<CameraChannel>>,
    locator_slot: Arc<LocatorSlot>,
    /// Absent during a call.
    locator: Option<Box<dyn Locator>>,
    /// True if the warning about non-finite output has been logged.
    warned_unsound: bool,
}

impl LocatorSlot {
    /// Reports the objects that have not been seen for too long at this time.
    pub fn report_stale(&self, shared: &SharedContext, by: Time) {
        let Some(gate) = &self.gate else { return };
        let stale = gate.lock().stale(by);
        if stale.is_empty() {
            return;
        }
        self.publish_seen(shared);
        for object in stale {
            shared.emit(Event::Stale { sensor: self.sensor.clone(), object });
        }
        // An agent on its way to the object may revise its motion.
        for context in &shared.robots {
            context.agent.send(AgentMsg::Revise);
        }
    }

    /// Publishes the state of the gate's objects to the agents.
    pub fn publish_seen(&self, shared: &SharedContext) {
        let Some(gate) = &self.gate else { return };
        let seen = |kept: KeptObject| SeenObject {
            at: kept.place.map(|_| kept.seen),
            place: kept.place,
            object: kept.object,
            is_stale: kept.is_stale,
        };
        let seen = gate.lock().objects().into_iter().map(seen).collect();
        shared.seen.lock().insert(self.sensor.clone(), seen);
    }

    /// The robot's recorded configuration at this time; `None` if it is not recorded.
    async fn body(&self, clock: &Clock, at: Time) -> Option<BodyState> {
        for _ in 0..READING_RETRIES {
            let pose = self.robot.ledger.book().history.at(at);
            match pose {
                Ok(q) => return Some(BodyState { at, q }),
                Err(Unrecorded::NotYet) => clock.sleep(READING_RETRY).await,
                Err(Unrecorded::NoMore) => return None,
            }
        }
        None
    }
}

impl LocatorState {
    /// Creates the active locator. One that rejects the stored state starts fresh.
    fn make(&mut self) -> Result<(), String> {
        let LocatorVersion { maker, state } = self.locator_slot.slot.part();
        let mut locator = maker()?;
        if let Some(state) = state {
            let _ = locator.import(state);
        }
        self.locator = Some(locator);
        Ok(())
    }

    /// Activates another locator.
    fn take_over(&mut self, maker: PartMaker<dyn Locator>, fresh: bool) -> Result<(), String> {
        let slot = &self.locator_slot.slot;
        let state = slot.part().state.filter(|_| !fresh);
        if !slot.take_over(LocatorVersion { maker, state }, self.shared.clock.now()) {
            return Ok(());
        }
        // Reported first: a failure of its creation is a reason to revert.
        let took_over = SwapStep::TookOver { gap: 0.0, map: None };
        self.shared.report_swap_beside(&self.locator_slot.sensor, SwapPart::Locator, took_over);
        self.make()
    }

    async fn locate(&mut self, seen: FrameDetections, body: BodyState) -> Result<(), String> {
        let mut locator = self.locator.take().ok_or("the locator is away")?;
        let FrameDetections { camera, intrinsics, exposed, regions } = seen;
        let sighting = |region| Sighting { camera: camera.clone(), intrinsics, region, at: exposed };
        let sightings: Vec<Sighting> = regions.into_iter().map(sighting).collect();
        let locate = move || {
            let mut objects = locator.locate(&sightings, &body);
            let cost = locator.takes();
            let all = objects.len();
            objects.retain(Located::is_finite);
            let is_sound = objects.len() == all;
            let state = locator.export();
            Timed { value: (locator, objects, is_sound, state), cost }
        };
        let budget = self.locator_slot.slot.budget().unwrap_or(FRAME_TIMEOUT);
        let (locator, objects, is_sound, state) = attempt(&self.shared.clock, budget, locate).await?;
        self.locator = Some(locator);
        self.locator_slot.slot.change(|version| version.state = state);
        self.locator_slot.slot.answered(self.shared.clock.now());
        if !is_sound && !std::mem::replace(&mut self.warned_unsound, true) {
            let text = format!("{}: it told numbers that are none: what has them is left out", self.locator_slot.name);
            self.shared.emit(Event::Warning { text });
        }
        let gate = self.locator_slot.gate.as_ref();
        let admissions = gate.map(|gate| gate.lock().admit(exposed, &objects)).unwrap_or_default();
        self.locator_slot.publish_seen(&self.shared);
        for (object, admission) in objects.iter().zip(&admissions) {
            if *admission == Admission::Moved {
                self.shared.model.send(ModelMsg::Seen(object.object.clone(), object.position));
            }
        }
        // Detections by a single camera, for example, locate nothing yet.
        if !objects.is_empty() {
            self.shared.emit(Event::Located { sensor: self.locator_slot.sensor.clone(), exposed, objects, admissions });
        }
        Ok(())
    }
}

impl Actor for LocatorActor {
    type Msg = LocatorMsg;
    type State = LocatorState;
    type Arguments = (Arc<SharedContext>, Vec<Arc<CameraChannel>>, Arc<LocatorSlot>);

    async fn pre_start(
        &self,
        myself: ActorRef<LocatorMsg>,
        (shared, channels, locator_slot): Self::Arguments,
    ) -> Result<LocatorState, ActorProcessingErr> {
        let mut state = LocatorState { shared, channels, locator_slot, locator: None, warned_unsound: false };
        state.make()?;
        state.locator_slot.locator.connect(myself.clone());
        for (i, channel) in state.channels.iter().enumerate() {
            let bell = myself.clone();
            let doorbell = Box::new(move || bell.send_message(LocatorMsg::Seen(i)).is_ok());
            channel.seen.iter().for_each(|stream| stream.attach(doorbell.clone()));
        }
        if state.locator_slot.gate.is_some() {
            myself.send_interval(STALE_CHECK, || LocatorMsg::Look);
        }
        Ok(state)
    }

    async fn handle(
        &self,
        myself: ActorRef<LocatorMsg>,
        message: LocatorMsg,
        state: &mut LocatorState,
    ) -> Result<(), ActorProcessingErr> {
        let i = match message {
            LocatorMsg::Seen(i) => i,
            LocatorMsg::Look => {
                let now = state.shared.clock.now();
                state.locator_slot.report_stale(&state.shared, now);
                return Ok(());
            }
            LocatorMsg::TakeOver { maker, fresh, reply } => {
                state.take_over(maker, fresh)?;
                // The caller may have timed out.
                let _ = reply.send(());
                return Ok(());
            }
        };
        let Some(channel) = state.channels.get(i).cloned() else { return Ok(()) };
        let Some(stream) = &channel.seen else { return Ok(()) };
        let locator_slot = state.locator_slot.clone();
        let clock = state.shared.clock.clone();
        let Some(seen) = stream.pop() else { return Ok(()) };
        match locator_slot.body(&clock, seen.exposed).await {
            Some(body) if !seen.regions.is_empty() => state.locate(seen, body).await?,
            Some(_) => {}
            None => stream.discard(),
        }
        // One frame per message, so that the other cameras are handled in turn.
        myself.send_message(LocatorMsg::Seen(i))?;
        Ok(())
    }
}
