//! Exchanging what runs beside the robots: a bridge, the detector of a camera, or the locator of a sensor.
//!
//! ```text
//! bridge     its motions are taken back, its life ends in order ──> the new one is served ──> TookOver
//! detector   the new one looks on for a while ──> between two frames ──> the new one is made, with what the old one has learned ──> TookOver
//! locator    ──> between two sightings ──> the new one is made, with what the old one remembers ──> TookOver
//! TookOver ──it works, and its probation is over──> Settled
//!              │ its actor dies: the one before is what is started again, Reverted
//! ```
//! Nothing of it is in the pulse: no boundary is waited for.

use super::{Exchanges, LOOK};
use crate::runtime::attempt::{Given, attempt};
use crate::runtime::clock::ClockKind;
use crate::runtime::supervision::{Between, GroupMsg};
use crate::runtime::swap::SwapPolicy;
use crate::shell::{DetectorMsg, Eye, LocatorMsg, PartMaker, Placing, Post};
use crate::system::tree::services_of;
use crate::wiring::{Seat, SharedContext};
use mobee_contract::{Detector, Locator, Service, SwapPart, SwapStep};
use ractor::{ActorRef, RpcReplyPort};
use std::sync::Arc;
use std::time::Duration;

/// How long a detector or locator may take to come to the end of what it is at.
const PATIENCE: Duration = Duration::from_secs(30);

/// A new part of what runs beside the robots.
#[derive(Clone)]
pub enum NewBeside {
    /// Another bridge.
    Bridge(Arc<dyn Service>),
    /// Another detector.
    Detector {
        /// Makes it.
        maker: PartMaker<dyn Detector>,
        /// Whether it begins anew, without what the old one has learned.
        fresh: bool,
    },
    /// Another locator.
    Locator {
        /// Makes it.
        maker: PartMaker<dyn Locator>,
        /// Whether it begins anew, without what the old one remembers.
        fresh: bool,
    },
}

impl NewBeside {
    /// Which part it is.
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

/// A new part of what runs beside the robots, as it is offered.
#[derive(Clone, Debug)]
pub struct BesideOffer {
    /// It.
    pub part: NewBeside,
    /// What it is, in words.
    pub what: String,
    /// What it must go through. Bridges and locators can't look on: their shadow is not used.
    pub terms: SwapPolicy,
}

/// What runs beside the robots.
#[derive(Default)]
pub(in crate::system) struct Beside {
    /// The group of all services, if there are any.
    pub(in crate::system) services: Option<ActorRef<GroupMsg>>,
    pub(in crate::system) posts: Vec<Arc<Post>>,
    pub(in crate::system) eyes: Vec<Arc<Eye>>,
    pub(in crate::system) placings: Vec<Arc<Placing>>,
}

impl Exchanges {
    /// Begins an exchange, if there is what it is a part of, and none of it is under way. The run goes on meanwhile.
    ///
    /// # Errors
    /// Why it is not begun.
    pub(in crate::system) fn begin_beside(&mut self, name: &str, offer: BesideOffer) -> Result<(), String> {
        while self.tasks.try_join_next().is_some() {}
        let BesideOffer { part, what, terms } = offer;
        let trial = |part| Trial { shared: self.shared.clone(), name: name.to_owned(), part, budget: terms.budget };
        match part {
            NewBeside::Bridge(new) => {
                let post = self.beside.posts.iter().find(|post| post.name() == name).cloned();
                let (Some(post), Some(services)) = (post, self.beside.services.clone()) else {
                    return Err(format!("there is no bridge {name} here"));
                };
                if self.shared.clock.kind() == ClockKind::Virtual && !new.runs_in_virtual_time() {
                    return Err(format!("the bridge {} can't run in virtual time", new.name()));
                }
                let trial = trial(SwapPart::Bridge);
                trial.announce(post.seat(), what, SwapPolicy { shadow: Duration::ZERO, ..terms })?;
                self.tasks.spawn(async move {
                    let taken = trial.bridge(&post, services, new).await;
                    trial.see_through(taken, post.seat()).await;
                });
            }
            NewBeside::Detector { maker, fresh } => {
                let eye = self.beside.eyes.iter().find(|eye| eye.name == name).cloned();
                let eye = eye.ok_or_else(|| format!("there is no camera {name} here"))?;
                let trial = trial(SwapPart::Detector);
                trial.announce(&eye.seat, what, terms)?;
                self.tasks.spawn(async move {
                    let taken = trial.detector(&eye, maker, fresh, terms.shadow).await;
                    trial.see_through(taken, &eye.seat).await;
                });
            }
            NewBeside::Locator { maker, fresh } => {
                let placing = self.beside.placings.iter().find(|placing| placing.sensor == name).cloned();
                let placing = placing.ok_or_else(|| format!("the sensor {name} has no locator in this run"))?;
                let trial = trial(SwapPart::Locator);
                trial.announce(&placing.seat, what, SwapPolicy { shadow: Duration::ZERO, ..terms })?;
                self.tasks.spawn(async move {
                    let taken = trial.locator(&placing, maker, fresh).await;
                    trial.see_through(taken, &placing.seat).await;
                });
            }
        }
        Ok(())
    }
}

/// The exchange of one part.
struct Trial {
    shared: Arc<SharedContext>,
    name: String,
    part: SwapPart,
    budget: Duration,
}

impl Trial {
    fn tell(&self, step: SwapStep) {
        self.shared.tell_beside(&self.name, self.part, step);
    }

    fn announce<P: Clone>(&self, seat: &Seat<P>, what: String, terms: SwapPolicy) -> Result<(), String> {
        if !seat.offer(SwapPolicy { shadow: Duration::ZERO, ..terms }, self.shared.clock.now()) {
            return Err(format!("another swap of this {} is under way; wait until it is settled", self.part));
        }
        let (shadow, probation) = (terms.shadow.as_secs_f64(), terms.probation.as_secs_f64());
        self.tell(SwapStep::Offered { what, shadow, probation });
        Ok(())
    }

    /// Takes the motions of the present bridge back, has it leave, and serves the new one.
    async fn bridge(
        &self,
        post: &Arc<Post>,
        services: ActorRef<GroupMsg>,
        new: Arc<dyn Service>,
    ) -> Result<(), String> {
        let begun = self.shared.clock.now();
        post.vacate("another takes its place");
        let (shared, seated) = (self.shared.clone(), post.clone());
        let between = Between(Box::new(move || {
            let now = shared.clock.now();
            shared.counts.lock().down.remove(seated.name());
            if seated.take_over(new, now) {
                let gap = now.since(begun).as_secs_f64();
                shared.tell_beside(seated.name(), SwapPart::Bridge, SwapStep::TookOver { gap, map: None });
            }
        }));
        let renewed = ractor::call!(services, GroupMsg::Renew, services_of(post.name()), between);
        renewed.map_err(|_| "it could not be started; the journal says why".into())
    }

    /// Hands the camera's frames to the new detector, once it is known that it can be made.
    async fn detector(
        &self,
        eye: &Arc<Eye>,
        maker: PartMaker<dyn Detector>,
        fresh: bool,
        shadow: Duration,
    ) -> Result<(), String> {
        let clock = &self.shared.clock;
        let made = maker.clone();
        let make = move || Given { value: made().map(drop), cost: Duration::ZERO };
        attempt(clock, self.budget, make).await??;
        if !shadow.is_zero() {
            self.look_on(eye, maker.clone(), shadow).await?;
        }
        self.hand_over(&eye.seat, |reply| {
            eye.detector.send(DetectorMsg::TakeOver { maker: maker.clone(), fresh, reply });
        })
        .await
    }

    /// Has the new locator asked from now on, once it is known that it can be made.
    async fn locator(&self, placing: &Arc<Placing>, maker: PartMaker<dyn Locator>, fresh: bool) -> Result<(), String> {
        let made = maker.clone();
        let make = move || Given { value: made().map(drop), cost: Duration::ZERO };
        attempt(&self.shared.clock, self.budget, make).await??;
        self.hand_over(&placing.seat, |reply| {
            placing.locator.send(LocatorMsg::TakeOver { maker: maker.clone(), fresh, reply });
        })
        .await
    }

    /// Asks the actor that has the seat to let the new part take over, until it has.
    async fn hand_over<P: Clone>(&self, seat: &Seat<P>, ask: impl Fn(RpcReplyPort<()>)) -> Result<(), String> {
        let clock = &self.shared.clock;
        let until = clock.now() + PATIENCE;
        while clock.now() < until {
            let (reply, done) = ractor::concurrency::oneshot();
            ask(reply.into());
            tokio::select! {
                biased;
                // an error: its actor died, of this or before
                done = done => if done.is_ok() || !seat.is_offered() { return Ok(()) },
                () = clock.sleep_until(until) => break,
            }
            clock.sleep(LOOK).await;
        }
        let (part, secs) = (self.part, PATIENCE.as_secs());
        Err(format!("the {part} in force did not come to the end of what it was at within {secs} s"))
    }

    /// Lets the new detector look on for so long.
    async fn look_on(&self, eye: &Arc<Eye>, maker: PartMaker<dyn Detector>, shadow: Duration) -> Result<(), String> {
        let clock = &self.shared.clock;
        *eye.onlooker_fault.lock() = None;
        eye.detector.send(DetectorMsg::LookOn { maker, budget: self.budget });
        let until = clock.now() + shadow;
        while clock.now() < until {
            clock.sleep(LOOK).await;
            if let Some(why) = eye.onlooker_fault.lock().take() {
                return Err(format!("it failed while it looked on: {why}"));
            }
        }
        Ok(())
    }

    /// Waits until the new part is trusted, or the one before is back, which is told where its actor died.
    async fn see_through<P: Clone>(&self, taken: Result<(), String>, seat: &Seat<P>) {
        let clock = &self.shared.clock;
        if let Err(why) = taken {
            let reverts = seat.broke(clock.now());
            seat.withdraw(clock.now());
            self.tell(if reverts { SwapStep::Reverted { why } } else { SwapStep::Refused { why } });
        }
        while seat.budget().is_some() {
            if seat.settles(clock.now()) {
                self.tell(SwapStep::Settled);
            }
            clock.sleep(LOOK).await;
        }
    }
}
