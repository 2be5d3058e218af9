//! The locator's shell: pairs what was seen with the body as it was then.

use super::{Eye, KeptObject, PATIENCE, PartMaker, Placing, Remembering, Seen};
use crate::runtime::attempt::{Given, attempt};
use crate::runtime::clock::Clock;
use crate::wiring::{AgentMsg, ModelMsg, SharedContext};
use mobee_contract::{Admission, BodyState, Event, Located, Locator, SeenObject, Sighting, SwapPart, SwapStep, Time};
use mobee_controller::history::Unrecorded;
use ractor::{Actor, ActorProcessingErr, ActorRef, RpcReplyPort};
use std::sync::Arc;
use std::time::Duration;

/// How soon to look again for a reading that is not there yet, and how often at most: readings may come late by a second.
const AGAIN: Duration = Duration::from_millis(10);
const TIMES: u32 = 100;

/// How often to look for what has not been seen.
const LOOK: Duration = Duration::from_millis(200);

/// The locator's actor.
pub struct LocatorActor;

/// What it hears.
pub enum LocatorMsg {
    /// Something was seen by the camera of this index.
    Seen(usize),
    /// It is time to look for what has not been seen.
    Look,
    /// Another locator takes over, with what this one remembers unless it is to begin anew; answered when it has.
    TakeOver {
        /// Makes it.
        maker: PartMaker<dyn Locator>,
        /// Whether it begins anew.
        fresh: bool,
        /// Who waits.
        reply: RpcReplyPort<()>,
    },
}

/// What it keeps.
pub struct Locating {
    shared: Arc<SharedContext>,
    eyes: Vec<Arc<Eye>>,
    placing: Arc<Placing>,
    /// Away while it is asked.
    locator: Option<Box<dyn Locator>>,
    /// Whether it was said that it tells numbers that are none.
    told_unsound: bool,
}

impl Placing {
    /// Tells what has not been seen for too long, by this time.
    pub fn tell_stale(&self, shared: &SharedContext, by: Time) {
        let Some(gate) = &self.gate else { return };
        let stale = gate.lock().stale(by);
        if stale.is_empty() {
            return;
        }
        self.show_seen(shared);
        for object in stale {
            shared.tell(Event::Stale { sensor: self.sensor.clone(), object });
        }
        // who is on the way to it may want to look again
        for context in &shared.robots {
            context.agent.send(AgentMsg::Revise);
        }
    }

    /// Lets agents know how the gate's objects were seen.
    pub fn show_seen(&self, shared: &SharedContext) {
        let Some(gate) = &self.gate else { return };
        let seen = |kept: KeptObject| SeenObject {
            at: kept.place.map(|_| kept.seen),
            place: kept.place,
            object: kept.object,
            is_stale: kept.is_stale,
        };
        let seen = gate.lock().kept().into_iter().map(seen).collect();
        shared.seen.lock().insert(self.sensor.clone(), seen);
    }

    /// The body at this instant, by the robot's recorded poses; none if they don't tell.
    async fn body(&self, clock: &Clock, at: Time) -> Option<BodyState> {
        for _ in 0..TIMES {
            let pose = self.robot.ledger.book().history.at(at);
            match pose {
                Ok(q) => return Some(BodyState { at, q }),
                Err(Unrecorded::NotYet) => clock.sleep(AGAIN).await,
                Err(Unrecorded::NoMore) => return None,
            }
        }
        None
    }
}

impl Locating {
    /// Makes the locator in force. One that does not take what was remembered begins anew.
    fn make(&mut self) -> Result<(), String> {
        let Remembering { maker, state } = self.placing.seat.part();
        let mut locator = maker()?;
        if let Some(state) = state {
            let _ = locator.import(state);
        }
        self.locator = Some(locator);
        Ok(())
    }

    /// Makes another locator the one in force.
    fn take_over(&mut self, maker: PartMaker<dyn Locator>, fresh: bool) -> Result<(), String> {
        let seat = &self.placing.seat;
        let state = seat.part().state.filter(|_| !fresh);
        if !seat.take_over(Remembering { maker, state }, self.shared.clock.now()) {
            return Ok(());
        }
        // told first: what its making breaks is a reason to revert
        let took_over = SwapStep::TookOver { gap: 0.0, map: None };
        self.shared.tell_beside(&self.placing.sensor, SwapPart::Locator, took_over);
        self.make()
    }

    async fn locate(&mut self, seen: Seen, body: BodyState) -> Result<(), String> {
        let mut locator = self.locator.take().ok_or("the locator is away")?;
        let Seen { camera, intrinsics, exposed, regions } = seen;
        let sighting = |region| Sighting { camera: camera.clone(), intrinsics, region, at: exposed };
        let sightings: Vec<Sighting> = regions.into_iter().map(sighting).collect();
        let locate = move || {
            let (mut objects, cost) = (locator.locate(&sightings, &body), locator.takes());
            let all = objects.len();
            objects.retain(Located::is_finite);
            let is_sound = objects.len() == all;
            let state = locator.export();
            Given { value: (locator, objects, is_sound, state), cost }
        };
        let budget = self.placing.seat.budget().unwrap_or(PATIENCE);
        let (locator, objects, is_sound, state) = attempt(&self.shared.clock, budget, locate).await?;
        self.locator = Some(locator);
        self.placing.seat.change(|remembering| remembering.state = state);
        self.placing.seat.answered(self.shared.clock.now());
        if !is_sound && !std::mem::replace(&mut self.told_unsound, true) {
            let text = format!("{}: it told numbers that are none: what has them is left out", self.placing.name);
            self.shared.tell(Event::Warning { text });
        }
        let gate = self.placing.gate.as_ref();
        let admissions = gate.map(|gate| gate.lock().admit(exposed, &objects)).unwrap_or_default();
        self.placing.show_seen(&self.shared);
        for (object, admission) in objects.iter().zip(&admissions) {
            if *admission == Admission::Moved {
                self.shared.model.send(ModelMsg::Seen(object.object.clone(), object.position));
            }
        }
        // what one eye saw alone, say, tells nothing yet
        if !objects.is_empty() {
            self.shared.tell(Event::Located { sensor: self.placing.sensor.clone(), exposed, objects, admissions });
        }
        Ok(())
    }
}

impl Actor for LocatorActor {
    type Msg = LocatorMsg;
    type State = Locating;
    type Arguments = (Arc<SharedContext>, Vec<Arc<Eye>>, Arc<Placing>);

    async fn pre_start(
        &self,
        myself: ActorRef<LocatorMsg>,
        (shared, eyes, placing): Self::Arguments,
    ) -> Result<Locating, ActorProcessingErr> {
        let mut locating = Locating { shared, eyes, placing, locator: None, told_unsound: false };
        locating.make()?;
        locating.placing.locator.connect(myself.clone());
        for (i, eye) in locating.eyes.iter().enumerate() {
            let bell = myself.clone();
            let doorbell = Box::new(move || bell.send_message(LocatorMsg::Seen(i)).is_ok());
            eye.seen.iter().for_each(|stream| stream.attach(doorbell.clone()));
        }
        if locating.placing.gate.is_some() {
            myself.send_interval(LOOK, || LocatorMsg::Look);
        }
        Ok(locating)
    }

    async fn handle(
        &self,
        myself: ActorRef<LocatorMsg>,
        message: LocatorMsg,
        locating: &mut Locating,
    ) -> Result<(), ActorProcessingErr> {
        let i = match message {
            LocatorMsg::Seen(i) => i,
            LocatorMsg::Look => {
                let now = locating.shared.clock.now();
                locating.placing.tell_stale(&locating.shared, now);
                return Ok(());
            }
            LocatorMsg::TakeOver { maker, fresh, reply } => {
                locating.take_over(maker, fresh)?;
                // who asked may have gone
                let _ = reply.send(());
                return Ok(());
            }
        };
        let Some(eye) = locating.eyes.get(i).cloned() else { return Ok(()) };
        let Some(stream) = &eye.seen else { return Ok(()) };
        let (placing, clock) = (locating.placing.clone(), locating.shared.clock.clone());
        let Some(seen) = stream.pop() else { return Ok(()) };
        match placing.body(&clock, seen.exposed).await {
            Some(body) if !seen.regions.is_empty() => locating.locate(seen, body).await?,
            Some(_) => {}
            None => stream.discard(),
        }
        // one at a time: the other cameras have their turn
        myself.send_message(LocatorMsg::Seen(i))?;
        Ok(())
    }
}
