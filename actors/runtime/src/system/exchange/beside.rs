//! Exchange of parts beside the robots: a bridge, the detector of a camera, or the locator of a sensor.
//!
//! ```text
//! bridge     its motions are rolled back, its life ends in order ──> the new one starts ──> TookOver
//! detector   the new one observes for a while ──> between two frames ──> the new one is created with the old one's state ──> TookOver
//! locator    ──> between two detections ──> the new one is created with the old one's state ──> TookOver
//! TookOver ──it works, and its probation is over──> Settled
//!              │ its actor dies: the previous one is restarted, Reverted
//! ```
//! These parts are not in the path of the pulse, so no boundary is waited for.

use super::{CHECK_INTERVAL, Exchanges};
use crate::attempt::{Timed, attempt};
use crate::clock::ClockKind;
use crate::shell::{CameraChannel, DetectorMsg, LocatorMsg, LocatorSlot, PartMaker, ServiceSlot};
use crate::supervision::{Between, GroupMsg};
use crate::swap::SwapPolicy;
use crate::system::tree::services_of;
use crate::wiring::{PartSlot, SharedContext};
use mobee_contract::{Detector, Locator, Service, SwapPart, SwapStep};
use ractor::{ActorRef, RpcReplyPort};
use std::sync::Arc;
use std::time::Duration;

/// Longest time until a detector or locator has finished its current frame.
const HAND_OVER_TIMEOUT: Duration = Duration::from_secs(30);

/// A new part beside the robots.
#[derive(Clone)]
pub enum NewBeside {
    /// Another bridge.
    Bridge(Arc<dyn Service>),
    /// Another detector.
    Detector {
        /// Creates it.
        maker: PartMaker<dyn Detector>,
        /// True if it starts without the state of the old one.
        fresh: bool,
    },
    /// Another locator.
    Locator {
        /// Creates it.
        maker: PartMaker<dyn Locator>,
        /// True if it starts without the state of the old one.
        fresh: bool,
    },
}

impl NewBeside {
    /// Kind of the part.
    pub fn part(&self) -> SwapPart {
        match self {
            NewBeside::Bridge(_) => SwapPart::Bridge,
            NewBeside::Detector { .. } => SwapPart::Detector,
            NewBeside::Locator { .. } => SwapPart::Locator,
        }
    }
}

impl std::fmt::Debug for NewBeside {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "NewBeside({})", self.part())
    }
}

/// Offer of a new part beside the robots.
#[derive(Clone, Debug)]
pub struct BesideOffer {
    /// The new part.
    pub part: NewBeside,
    /// Description of the part.
    pub what: String,
    /// Requirements on the part. Bridges and locators can't observe: their shadow time is not used.
    pub terms: SwapPolicy,
}

/// The parts beside the robots.
#[derive(Default)]
pub(in crate::system) struct Beside {
    /// Group of all services, if there are any.
    pub(in crate::system) services: Option<ActorRef<GroupMsg>>,
    pub(in crate::system) service_slots: Vec<Arc<ServiceSlot>>,
    pub(in crate::system) channels: Vec<Arc<CameraChannel>>,
    pub(in crate::system) locator_slots: Vec<Arc<LocatorSlot>>,
}

impl Exchanges {
    /// Begins an exchange, if the part exists and no other exchange of it is under way. The run continues
    /// during the exchange.
    ///
    /// # Errors
    /// The reason for a refusal.
    pub(in crate::system) fn begin_beside(&mut self, name: &str, offer: BesideOffer) -> Result<(), String> {
        while self.tasks.try_join_next().is_some() {}
        let BesideOffer { part, what, terms } = offer;
        let trial =
            |part| PartExchange { shared: self.shared.clone(), name: name.to_owned(), part, budget: terms.budget };
        match part {
            NewBeside::Bridge(new) => {
                let service_slot =
                    self.beside.service_slots.iter().find(|service_slot| service_slot.name() == name).cloned();
                let (Some(service_slot), Some(services)) = (service_slot, self.beside.services.clone()) else {
                    return Err(format!("there is no bridge {name} here"));
                };
                if self.shared.clock.kind() == ClockKind::Virtual && !new.runs_in_virtual_time() {
                    return Err(format!("the bridge {} can't run in virtual time", new.name()));
                }
                let trial = trial(SwapPart::Bridge);
                trial.announce(service_slot.slot(), what, SwapPolicy { shadow: Duration::ZERO, ..terms })?;
                self.tasks.spawn(async move {
                    let taken = trial.bridge(&service_slot, services, new).await;
                    trial.see_through(taken, service_slot.slot()).await;
                });
            }
            NewBeside::Detector { maker, fresh } => {
                let channel = self.beside.channels.iter().find(|channel| channel.name == name).cloned();
                let channel = channel.ok_or_else(|| format!("there is no camera {name} here"))?;
                let trial = trial(SwapPart::Detector);
                trial.announce(&channel.slot, what, terms)?;
                self.tasks.spawn(async move {
                    let taken = trial.detector(&channel, maker, fresh, terms.shadow).await;
                    trial.see_through(taken, &channel.slot).await;
                });
            }
            NewBeside::Locator { maker, fresh } => {
                let locator_slot =
                    self.beside.locator_slots.iter().find(|locator_slot| locator_slot.sensor == name).cloned();
                let locator_slot =
                    locator_slot.ok_or_else(|| format!("the sensor {name} has no locator in this run"))?;
                let trial = trial(SwapPart::Locator);
                trial.announce(&locator_slot.slot, what, SwapPolicy { shadow: Duration::ZERO, ..terms })?;
                self.tasks.spawn(async move {
                    let taken = trial.locator(&locator_slot, maker, fresh).await;
                    trial.see_through(taken, &locator_slot.slot).await;
                });
            }
        }
        Ok(())
    }
}

/// The exchange of one part.
struct PartExchange {
    shared: Arc<SharedContext>,
    name: String,
    part: SwapPart,
    budget: Duration,
}

impl PartExchange {
    fn report(&self, step: SwapStep) {
        self.shared.report_swap_beside(&self.name, self.part, step);
    }

    fn announce<P: Clone>(&self, slot: &PartSlot<P>, what: String, terms: SwapPolicy) -> Result<(), String> {
        if !slot.offer(SwapPolicy { shadow: Duration::ZERO, ..terms }, self.shared.clock.now()) {
            return Err(format!("another swap of this {} is under way; wait until it is settled", self.part));
        }
        let shadow = terms.shadow.as_secs_f64();
        let probation = terms.probation.as_secs_f64();
        self.report(SwapStep::Offered { what, shadow, probation });
        Ok(())
    }

    /// Rolls back the motions of the present bridge, ends it, and starts the new one.
    async fn bridge(
        &self,
        service_slot: &Arc<ServiceSlot>,
        services: ActorRef<GroupMsg>,
        new: Arc<dyn Service>,
    ) -> Result<(), String> {
        let begun = self.shared.clock.now();
        service_slot.vacate("another takes its place");
        let shared = self.shared.clone();
        let slot = service_slot.clone();
        let between = Between(Box::new(move || {
            let now = shared.clock.now();
            shared.counts.lock().down.remove(slot.name());
            if slot.take_over(new, now) {
                let gap = now.since(begun).as_secs_f64();
                shared.report_swap_beside(slot.name(), SwapPart::Bridge, SwapStep::TookOver { gap, map: None });
            }
        }));
        let renewed = ractor::call!(services, GroupMsg::Renew, services_of(service_slot.name()), between);
        renewed.map_err(|_| "it could not be started; the journal says why".into())
    }

    /// Replaces the camera's detector, after a trial creation of the new one.
    async fn detector(
        &self,
        channel: &Arc<CameraChannel>,
        maker: PartMaker<dyn Detector>,
        fresh: bool,
        shadow: Duration,
    ) -> Result<(), String> {
        let clock = &self.shared.clock;
        let made = maker.clone();
        let make = move || Timed { value: made().map(drop), cost: Duration::ZERO };
        attempt(clock, self.budget, make).await??;
        if !shadow.is_zero() {
            self.look_on(channel, maker.clone(), shadow).await?;
        }
        self.hand_over(&channel.slot, |reply| {
            channel.detector.send(DetectorMsg::TakeOver { maker: maker.clone(), fresh, reply });
        })
        .await
    }

    /// Replaces the sensor's locator, after a trial creation of the new one.
    async fn locator(
        &self,
        locator_slot: &Arc<LocatorSlot>,
        maker: PartMaker<dyn Locator>,
        fresh: bool,
    ) -> Result<(), String> {
        let made = maker.clone();
        let make = move || Timed { value: made().map(drop), cost: Duration::ZERO };
        attempt(&self.shared.clock, self.budget, make).await??;
        self.hand_over(&locator_slot.slot, |reply| {
            locator_slot.locator.send(LocatorMsg::TakeOver { maker: maker.clone(), fresh, reply });
        })
        .await
    }

    /// Sends the actor of the part requests to replace it, until it has done so.
    async fn hand_over<P: Clone>(&self, slot: &PartSlot<P>, request: impl Fn(RpcReplyPort<()>)) -> Result<(), String> {
        let clock = &self.shared.clock;
        let until = clock.now() + HAND_OVER_TIMEOUT;
        while clock.now() < until {
            let (reply, done) = ractor::concurrency::oneshot();
            request(reply.into());
            tokio::select! {
                biased;
                // An error: its actor died, because of the request or before.
                done = done => if done.is_ok() || !slot.is_offered() { return Ok(()) },
                () = clock.sleep_until(until) => break,
            }
            clock.sleep(CHECK_INTERVAL).await;
        }
        let part = self.part;
        let secs = HAND_OVER_TIMEOUT.as_secs();
        Err(format!("the {part} in force did not come to the end of what it was at within {secs} s"))
    }

    /// Lets the new detector observe for the time `shadow`.
    async fn look_on(
        &self,
        channel: &Arc<CameraChannel>,
        maker: PartMaker<dyn Detector>,
        shadow: Duration,
    ) -> Result<(), String> {
        let clock = &self.shared.clock;
        *channel.onlooker_fault.lock() = None;
        channel.detector.send(DetectorMsg::LookOn { maker, budget: self.budget });
        let until = clock.now() + shadow;
        while clock.now() < until {
            clock.sleep(CHECK_INTERVAL).await;
            if let Some(why) = channel.onlooker_fault.lock().take() {
                return Err(format!("it failed while it observed: {why}"));
            }
        }
        Ok(())
    }

    /// Waits until the new part is trusted or the previous one has returned. A return after the death of the
    /// actor is reported there.
    async fn see_through<P: Clone>(&self, taken: Result<(), String>, slot: &PartSlot<P>) {
        let clock = &self.shared.clock;
        if let Err(why) = taken {
            let reverts = slot.broke(clock.now());
            slot.withdraw(clock.now());
            self.report(if reverts { SwapStep::Reverted { why } } else { SwapStep::Refused { why } });
        }
        while slot.budget().is_some() {
            if slot.settles(clock.now()) {
                self.report(SwapStep::Settled);
            }
            clock.sleep(CHECK_INTERVAL).await;
        }
    }
}
