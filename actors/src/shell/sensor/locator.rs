//! The locator's shell: pairs what was seen with the body as it was then.

use super::{Eye, KeptObject, PATIENCE, Placing, Seen};
use crate::runtime::attempt::{Given, attempt};
use crate::runtime::clock::Clock;
use crate::wiring::{ModelMsg, SharedContext};
use mobee_contract::{Admission, BodyState, Event, Locator, SeenObject, Sighting, Time};
use mobee_controller::history::Unrecorded;
use ractor::{Actor, ActorProcessingErr, ActorRef};
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
#[derive(Debug)]
pub enum LocatorMsg {
    /// Something was seen by the camera of this index.
    Seen(usize),
    /// It is time to look for what has not been seen.
    Look,
}

/// What it keeps.
pub struct Locating {
    shared: Arc<SharedContext>,
    eyes: Vec<Arc<Eye>>,
    placing: Arc<Placing>,
    /// Away while it is asked.
    locator: Option<Box<dyn Locator>>,
}

impl Placing {
    /// Tells what has not been seen for too long, by this time.
    pub fn tell_stale(&self, shared: &SharedContext, by: Time) {
        let Some(gate) = &self.gate else { return };
        let stale = gate.lock().stale(by);
        if !stale.is_empty() {
            self.show_seen(shared);
        }
        for object in stale {
            shared.tell(Event::Stale { sensor: self.sensor.clone(), object });
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
    async fn locate(&mut self, seen: Seen, body: BodyState) -> Result<(), String> {
        let mut locator = self.locator.take().ok_or("the locator is away")?;
        let Seen { camera, intrinsics, exposed, regions } = seen;
        let sighting = |region| Sighting { camera: camera.clone(), intrinsics, region, at: exposed };
        let sightings: Vec<Sighting> = regions.into_iter().map(sighting).collect();
        let locate = move || {
            let (objects, cost) = (locator.locate(&sightings, &body), locator.takes());
            let state = locator.export();
            Given { value: (locator, objects, state), cost }
        };
        let (locator, objects, state) = attempt(&self.shared.clock, PATIENCE, locate).await?;
        self.locator = Some(locator);
        *self.placing.state.lock() = state;
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
        let mut locator = (placing.locator)()?;
        if let Some(state) = placing.state.lock().clone() {
            // one that does not take it begins anew
            let _ = locator.import(state);
        }
        for (i, eye) in eyes.iter().enumerate() {
            let bell = myself.clone();
            let doorbell = Box::new(move || bell.send_message(LocatorMsg::Seen(i)).is_ok());
            eye.seen.iter().for_each(|stream| stream.attach(doorbell.clone()));
        }
        if placing.gate.is_some() {
            myself.send_interval(LOOK, || LocatorMsg::Look);
        }
        Ok(Locating { shared, eyes, placing, locator: Some(locator) })
    }

    async fn handle(
        &self,
        myself: ActorRef<LocatorMsg>,
        message: LocatorMsg,
        locating: &mut Locating,
    ) -> Result<(), ActorProcessingErr> {
        let LocatorMsg::Seen(i) = message else {
            let now = locating.shared.clock.now();
            locating.placing.tell_stale(&locating.shared, now);
            return Ok(());
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
