//! The planner in force, one that looks on and is to replace it, and the one that it replaced.

use crate::runtime::attempt::{Given, attempt};
use crate::runtime::clock::ClockKind;
use crate::runtime::swap::{Phase, SwapIn, SwapOut, SwapPolicy};
use crate::wiring::SwapRequest;
use crate::wiring::{RobotContext, SharedContext};
use mobee_contract::{Agent, CommitId, Event, Intent, MotionEnd, Note, Snapshot, SwapPart, SwapStep, View};
use sha2::{Digest, Sha256};
use std::sync::Arc;
use std::time::Duration;

/// How the last motion that a planner asked for ended.
#[derive(Clone, Copy, Debug)]
pub(super) struct Last {
    /// Its commit; none if it was refused.
    pub id: Option<CommitId>,
    pub end: MotionEnd,
}

/// What a planner said when it was asked.
struct Said<T> {
    answer: T,
    notes: Vec<Note>,
}

struct Candidate {
    agent: Box<dyn Agent>,
    offer: SwapRequest,
}

pub(super) struct PlannerHost {
    shared: Arc<SharedContext>,
    context: Arc<RobotContext>,
    /// Absent only while it is being asked.
    agent: Option<Box<dyn Agent>>,
    candidate: Option<Candidate>,
    former: Option<Box<dyn Agent>>,
}

impl PlannerHost {
    /// Makes the planner, at the start and after the actor's death: on probation, that counts against the new one.
    pub(super) fn start(shared: Arc<SharedContext>, context: Arc<RobotContext>) -> Result<PlannerHost, String> {
        let mut host = PlannerHost { shared, context, agent: None, candidate: None, former: None };
        let newest = host.context.snapshot.lock().clone();
        let fallback = host.after_death();
        let maker = host.context.slot.lock().maker.clone().ok_or("the robot has no agent")?;
        let mut agent = (maker.0)()?;
        match newest {
            None => agent.recall(&host.context.notes),
            Some(newest) => match (agent.import(newest), fallback) {
                (Ok(()), _) => {}
                (Err(_), Some(own)) => agent.import(own).map_err(|e| e.to_string())?,
                (Err(e), None) => return Err(e.to_string()),
            },
        }
        host.agent = Some(agent);
        Ok(host)
    }

    fn after_death(&self) -> Option<Snapshot> {
        match self.step_core(SwapIn::Broke)? {
            SwapOut::Discard => {
                self.tell(SwapStep::Refused { why: "the robot's agent died while it looked on".into() });
                None
            }
            _ => {
                let (maker, state) = self.context.slot.lock().former.take()?;
                self.context.slot.lock().maker = Some(maker);
                self.tell(SwapStep::Reverted { why: "it died".into() });
                Some(state)
            }
        }
    }

    fn step_core(&self, input: SwapIn) -> Option<SwapOut> {
        self.context.slot.lock().core.on(input, self.shared.clock.now())
    }

    pub(super) fn phase(&self) -> Phase {
        self.context.slot.lock().core.phase()
    }

    /// Whether a new planner waits for the end of what is under way.
    pub(super) fn is_due(&self) -> bool {
        matches!(self.phase(), Phase::Shadow(until) if self.shared.clock.now() >= until)
    }

    fn tell(&self, step: SwapStep) {
        self.shared.tell_swap(&self.context, SwapPart::Agent, step);
    }

    /// Builds and checks a new planner beside the old one.
    ///
    /// # Errors
    /// Why not; everything is then as before.
    pub(super) async fn offer(&mut self, offer: SwapRequest) -> Result<SwapPolicy, String> {
        if self.phase() != Phase::Settled {
            return Err("another swap of this agent is under way; wait until it is settled".into());
        }
        let (maker, fresh) = (offer.maker.clone(), offer.fresh);
        let state = self.agent.as_ref().map(|a| a.export());
        let built = attempt(&self.shared.clock, offer.terms.budget, move || {
            let made = (maker.0)().and_then(|mut agent| match state.filter(|_| !fresh) {
                Some(state) => agent.import(state).map(|()| agent).map_err(|e| e.to_string()),
                None => Ok(agent),
            });
            let cost = made.as_ref().map_or(Duration::ZERO, |a| a.simulated_latency());
            Given { value: made, cost }
        });
        match built.await.and_then(|made| made) {
            Ok(agent) => {
                self.step_core(SwapIn::Offer(offer.terms));
                let SwapPolicy { shadow, probation, .. } = offer.terms;
                let (shadow, probation) = (shadow.as_secs_f64(), probation.as_secs_f64());
                self.tell(SwapStep::Offered { what: offer.what.clone(), shadow, probation });
                let terms = offer.terms;
                self.candidate = Some(Candidate { agent, offer });
                Ok(terms)
            }
            Err(why) => {
                self.tell(SwapStep::Refused { why: why.clone() });
                Err(why)
            }
        }
    }

    /// No transaction is open: a new planner may look on, or take over. Says whether it did.
    pub(super) async fn boundary(&mut self, last: Option<Last>, view: &View) -> bool {
        match self.step_core(SwapIn::Boundary) {
            Some(SwapOut::Rehearse) => self.rehearse(last, view).await,
            Some(SwapOut::HandOver) => return self.hand_over().await,
            Some(SwapOut::Settle) => self.settle(),
            _ => {}
        }
        false
    }

    /// Time passed.
    pub(super) fn tick(&mut self) {
        if self.step_core(SwapIn::Tick) == Some(SwapOut::Settle) {
            self.settle();
        }
    }

    fn settle(&mut self) {
        self.former = None;
        self.context.slot.lock().former = None;
        self.tell(SwapStep::Settled);
    }

    fn discard(&mut self, why: String) {
        self.candidate = None;
        self.step_core(SwapIn::Broke);
        self.tell(SwapStep::Refused { why });
    }

    /// What would the new one do here, with all that the old one knows?
    async fn rehearse(&mut self, last: Option<Last>, view: &View) {
        let Some(Candidate { mut agent, offer }) = self.candidate.take() else { return };
        let state = self.agent.as_ref().map(|a| a.export()).filter(|_| !offer.fresh);
        let (last, view) = (last.map(|last| last.end), view.clone());
        let asked = attempt(&self.shared.clock, offer.terms.budget, move || {
            let taken = state.map_or(Ok(()), |state| agent.import(state));
            let intent = taken.map(|()| agent.next(last, &view)).map_err(|e| e.to_string());
            agent.notes();
            let cost = agent.simulated_latency();
            Given { value: intent.map(|intent| (agent, intent)), cost }
        });
        match asked.await.and_then(|asked| asked) {
            Ok((agent, intent)) => {
                self.candidate = Some(Candidate { agent, offer });
                self.tell_shadow(&intent);
            }
            Err(why) => self.discard(why),
        }
    }

    fn tell_shadow(&self, intent: &Intent) {
        let q = match intent {
            Intent::MoveTo(target) | Intent::MoveEach(target, _) => {
                target.motors.iter().copied().zip(target.q.iter().copied()).collect()
            }
            _ => Vec::new(),
        };
        self.shared.tell(Event::Shadow { robot: self.context.name.clone(), intent: intent.kind(), q });
    }

    async fn hand_over(&mut self) -> bool {
        let Some(Candidate { mut agent, offer }) = self.candidate.take() else { return false };
        let Some(state) = self.agent.as_ref().map(|a| a.export()) else { return false };
        let begun = self.shared.clock.now();
        let given = state.clone();
        let taken = attempt(&self.shared.clock, offer.terms.budget, move || {
            let taken = if offer.fresh { Ok(()) } else { agent.import(given).map_err(|e| e.to_string()) };
            // what it says now was said before
            agent.notes();
            let (back, cost) = (agent.export(), agent.simulated_latency());
            Given { value: taken.map(|()| (agent, back)), cost }
        });
        let (agent, back) = match taken.await.and_then(|taken| taken) {
            Ok(taken) => taken,
            Err(why) => {
                self.discard(why);
                return false;
            }
        };
        let map = state.state.get("map").filter(|_| !offer.fresh);
        if map.is_some() && map != back.state.get("map") {
            self.discard("the roadmap that it gives back is not the one that it was given".into());
            return false;
        }
        let hash = map.map(|m| Sha256::digest(m.to_string()).iter().take(8).map(|b| format!("{b:02x}")).collect());
        *self.context.snapshot.lock() = Some(back);
        self.former = self.agent.replace(agent);
        {
            let mut slot = self.context.slot.lock();
            slot.former = slot.maker.replace(offer.maker).map(|maker| (maker, state));
        }
        let gap = self.shared.clock.now().since(begun).as_secs_f64();
        self.step_core(SwapIn::TookOver);
        self.tell(SwapStep::TookOver { gap, map: hash });
        true
    }

    /// The robot rests: what next? Its state is kept with the answer, so that a successor knows what the motion is for.
    /// `None`: the new planner broke, and the old one is back and to be asked. It then gets the
    /// motion's end, if it knows of the motion.
    pub(super) async fn next(&mut self, last: &mut Option<Last>, view: &View) -> Option<Intent> {
        let (end, seen) = (last.map(|last| last.end), view.clone());
        match self.ask(move |agent| (agent.next(end, &seen), agent.export())).await {
            Ok((intent, state)) => {
                *self.context.snapshot.lock() = Some(state);
                if let Some(Last { id, end }) = last.take() {
                    self.shared.tell(Event::Told { robot: self.context.name.clone(), id, end });
                }
                Some(intent)
            }
            Err(why) => {
                if !self.revert(why) {
                    *last = None;
                }
                None
            }
        }
    }

    /// The world has changed, or a set-point is due. `Err`: the new planner broke, and the old one is back.
    pub(super) async fn revise(&mut self, view: &View) -> Result<Option<Intent>, ()> {
        let seen = view.clone();
        let revised = self.ask(move |agent| agent.revise(&seen)).await;
        revised.map_err(|why| {
            self.revert(why);
        })
    }

    /// Asks the planner in force, and tells its notes.
    async fn ask<T: Send + 'static>(
        &mut self,
        question: impl FnOnce(&mut dyn Agent) -> T + Send + 'static,
    ) -> Result<T, String> {
        let mut agent = self.agent.take().ok_or("there is no agent")?;
        let call = move || {
            let answer = question(&mut *agent);
            let said = Said { answer, notes: agent.notes() };
            let cost = agent.simulated_latency();
            Given { value: (agent, said), cost }
        };
        let (agent, said) = match self.phase() {
            Phase::Probation(_) => {
                let budget = self.context.slot.lock().core.terms().budget;
                attempt(&self.shared.clock, budget, call).await?
            }
            _ => {
                // a panic ends the actor, and its supervisor starts another
                let given = call();
                if self.shared.clock.kind() == ClockKind::Virtual && !given.cost.is_zero() {
                    self.shared.clock.sleep(given.cost).await;
                }
                given.value
            }
        };
        self.agent = Some(agent);
        self.step_core(SwapIn::Answered);
        self.note(said.notes);
        Ok(said.answer)
    }

    fn note(&self, notes: Vec<Note>) {
        for note in notes {
            self.shared.tell(Event::Note { robot: self.context.name.clone(), note });
        }
    }

    /// The old planner returns. Says whether it knows what the new one did until then.
    fn revert(&mut self, why: String) -> bool {
        self.step_core(SwapIn::Broke);
        self.tell(SwapStep::Reverted { why });
        let own = {
            let mut slot = self.context.slot.lock();
            slot.former.take().map(|(maker, state)| {
                slot.maker = Some(maker);
                state
            })
        };
        let Some(mut agent) = self.former.take() else { return false };
        let newest = self.context.snapshot.lock().clone();
        let knows = newest.is_some_and(|newest| agent.import(newest).is_ok());
        let notes = if knows {
            // all of it was said before
            agent.notes();
            Vec::new()
        } else {
            // what the new one said of the map is no longer so: an agent tells its whole map when it takes one over
            let _ = own.map(|own| agent.import(own));
            agent.notes()
        };
        *self.context.snapshot.lock() = Some(agent.export());
        self.agent = Some(agent);
        self.note(notes);
        knows
    }
}
