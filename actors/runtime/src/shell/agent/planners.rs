//! The active planner, a candidate that is to replace it, and the one that it replaced.

use crate::attempt::{Timed, attempt};
use crate::clock::ClockKind;
use crate::swap::{Phase, SwapIn, SwapOut, SwapPolicy};
use crate::wiring::SwapRequest;
use crate::wiring::{RobotContext, SharedContext};
use mobee_contract::{Agent, CommitId, Event, Intent, MotionEnd, Note, Snapshot, SwapPart, SwapStep, View};
use sha2::{Digest, Sha256};
use std::sync::Arc;
use std::time::Duration;

/// End of the last motion that a planner requested.
#[derive(Clone, Copy, Debug)]
pub(super) struct MotionReport {
    /// Its commit; `None` if it was refused.
    pub id: Option<CommitId>,
    pub end: MotionEnd,
}

/// Answer of a planner, with its notes.
struct PlannerReply<T> {
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
    /// Absent only during a call.
    agent: Option<Box<dyn Agent>>,
    candidate: Option<Candidate>,
    former: Option<Box<dyn Agent>>,
}

impl PlannerHost {
    /// Creates the planner, at the start and after the actor's death. A death on probation counts against the
    /// new planner.
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
                self.report(SwapStep::Refused { why: "the robot's agent died while the new one observed".into() });
                None
            }
            _ => {
                let (maker, state) = self.context.slot.lock().former.take()?;
                self.context.slot.lock().maker = Some(maker);
                self.report(SwapStep::Reverted { why: "it died".into() });
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

    /// True if a new planner waits for the end of the open motion.
    pub(super) fn is_due(&self) -> bool {
        matches!(self.phase(), Phase::Shadow(until) if self.shared.clock.now() >= until)
    }

    fn report(&self, step: SwapStep) {
        self.shared.report_swap(&self.context, SwapPart::Agent, step);
    }

    /// Builds and checks a new planner beside the old one.
    ///
    /// # Errors
    /// The reason for a refusal; nothing is changed then.
    pub(super) async fn offer(&mut self, offer: SwapRequest) -> Result<SwapPolicy, String> {
        if self.phase() != Phase::Settled {
            return Err("another swap of this agent is under way; wait until it is settled".into());
        }
        let maker = offer.maker.clone();
        let fresh = offer.fresh;
        let state = self.agent.as_ref().map(|a| a.export());
        let built = attempt(&self.shared.clock, offer.terms.budget, move || {
            let made = (maker.0)().and_then(|mut agent| match state.filter(|_| !fresh) {
                Some(state) => agent.import(state).map(|()| agent).map_err(|e| e.to_string()),
                None => Ok(agent),
            });
            let cost = made.as_ref().map_or(Duration::ZERO, |a| a.simulated_latency());
            Timed { value: made, cost }
        });
        match built.await.and_then(|made| made) {
            Ok(agent) => {
                self.step_core(SwapIn::Offer(offer.terms));
                let SwapPolicy { shadow, probation, .. } = offer.terms;
                let shadow = shadow.as_secs_f64();
                let probation = probation.as_secs_f64();
                self.report(SwapStep::Offered { what: offer.what.clone(), shadow, probation });
                let terms = offer.terms;
                self.candidate = Some(Candidate { agent, offer });
                Ok(terms)
            }
            Err(why) => {
                self.report(SwapStep::Refused { why: why.clone() });
                Err(why)
            }
        }
    }

    /// Handles a moment with no transaction open: a new planner may observe, or take over. Returns true if it
    /// took over.
    pub(super) async fn boundary(&mut self, last: Option<MotionReport>, view: &View) -> bool {
        match self.step_core(SwapIn::Boundary) {
            Some(SwapOut::Rehearse) => self.rehearse(last, view).await,
            Some(SwapOut::HandOver) => return self.hand_over().await,
            Some(SwapOut::Settle) => self.settle(),
            _ => {}
        }
        false
    }

    /// Ends the probation if its time is over.
    pub(super) fn tick(&mut self) {
        if self.step_core(SwapIn::Tick) == Some(SwapOut::Settle) {
            self.settle();
        }
    }

    fn settle(&mut self) {
        self.former = None;
        self.context.slot.lock().former = None;
        self.report(SwapStep::Settled);
    }

    fn discard(&mut self, why: String) {
        self.candidate = None;
        self.step_core(SwapIn::Broke);
        self.report(SwapStep::Refused { why });
    }

    /// Records the intent that the new planner would have here, with the old planner's state.
    async fn rehearse(&mut self, last: Option<MotionReport>, view: &View) {
        let Some(Candidate { mut agent, offer }) = self.candidate.take() else { return };
        let state = self.agent.as_ref().map(|a| a.export()).filter(|_| !offer.fresh);
        let last = last.map(|last| last.end);
        let view = view.clone();
        let rehearsed = attempt(&self.shared.clock, offer.terms.budget, move || {
            let taken = state.map_or(Ok(()), |state| agent.import(state));
            let intent = taken.map(|()| agent.next(last, &view)).map_err(|e| e.to_string());
            agent.notes();
            let cost = agent.simulated_latency();
            Timed { value: intent.map(|intent| (agent, intent)), cost }
        });
        match rehearsed.await.and_then(|rehearsed| rehearsed) {
            Ok((agent, intent)) => {
                self.candidate = Some(Candidate { agent, offer });
                self.report_shadow(&intent);
            }
            Err(why) => self.discard(why),
        }
    }

    fn report_shadow(&self, intent: &Intent) {
        let q = match intent {
            Intent::MoveTo(target) | Intent::MoveEach(target, _) => {
                target.motors.iter().copied().zip(target.q.iter().copied()).collect()
            }
            _ => Vec::new(),
        };
        self.shared.emit(Event::Shadow { robot: self.context.name.clone(), intent: intent.kind(), q });
    }

    async fn hand_over(&mut self) -> bool {
        let Some(Candidate { mut agent, offer }) = self.candidate.take() else { return false };
        let Some(state) = self.agent.as_ref().map(|a| a.export()) else { return false };
        let begun = self.shared.clock.now();
        let given = state.clone();
        let taken = attempt(&self.shared.clock, offer.terms.budget, move || {
            let taken = if offer.fresh { Ok(()) } else { agent.import(given).map_err(|e| e.to_string()) };
            // Its notes on the imported state were reported before.
            agent.notes();
            let back = agent.export();
            let cost = agent.simulated_latency();
            Timed { value: taken.map(|()| (agent, back)), cost }
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
        self.report(SwapStep::TookOver { gap, map: hash });
        true
    }

    /// Requests the next intent while the robot is at rest. The planner's state is stored with the answer, so
    /// that a successor has the purpose of the motion. Returns `None` if the new planner failed: the old one is
    /// back and must be called. It is then notified of the end of the motion, if its state includes that
    /// motion.
    pub(super) async fn next(&mut self, last: &mut Option<MotionReport>, view: &View) -> Option<Intent> {
        let end = last.map(|last| last.end);
        let view = view.clone();
        match self.call(move |agent| (agent.next(end, &view), agent.export())).await {
            Ok((intent, state)) => {
                *self.context.snapshot.lock() = Some(state);
                if let Some(MotionReport { id, end }) = last.take() {
                    self.shared.emit(Event::Told { robot: self.context.name.clone(), id, end });
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

    /// Requests a revision after a change of the world, or because a set-point is due. `Err` if the new planner
    /// failed: the old one is back.
    pub(super) async fn revise(&mut self, view: &View) -> Result<Option<Intent>, ()> {
        let view = view.clone();
        let revised = self.call(move |agent| agent.revise(&view)).await;
        revised.map_err(|why| {
            self.revert(why);
        })
    }

    /// Calls the active planner, and emits its notes.
    async fn call<T: Send + 'static>(
        &mut self,
        method: impl FnOnce(&mut dyn Agent) -> T + Send + 'static,
    ) -> Result<T, String> {
        let mut agent = self.agent.take().ok_or("there is no agent")?;
        let call = move || {
            let answer = method(&mut *agent);
            let reply = PlannerReply { answer, notes: agent.notes() };
            let cost = agent.simulated_latency();
            Timed { value: (agent, reply), cost }
        };
        let (agent, reply) = match self.phase() {
            Phase::Probation(_) => {
                let budget = self.context.slot.lock().core.terms().budget;
                attempt(&self.shared.clock, budget, call).await?
            }
            _ => {
                // A panic ends the actor, and its supervisor starts another one.
                let timed = call();
                if self.shared.clock.kind() == ClockKind::Virtual && !timed.cost.is_zero() {
                    self.shared.clock.sleep(timed.cost).await;
                }
                timed.value
            }
        };
        self.agent = Some(agent);
        self.step_core(SwapIn::Answered);
        self.note(reply.notes);
        Ok(reply.answer)
    }

    fn note(&self, notes: Vec<Note>) {
        for note in notes {
            self.shared.emit(Event::Note { robot: self.context.name.clone(), note });
        }
    }

    /// Puts the old planner back. Returns true if its state includes what the new one did.
    fn revert(&mut self, why: String) -> bool {
        self.step_core(SwapIn::Broke);
        self.report(SwapStep::Reverted { why });
        let own = {
            let mut slot = self.context.slot.lock();
            slot.former.take().map(|(maker, state)| {
                slot.maker = Some(maker);
                state
            })
        };
        let Some(mut agent) = self.former.take() else { return false };
        let newest = self.context.snapshot.lock().clone();
        let is_current = newest.is_some_and(|newest| agent.import(newest).is_ok());
        let notes = if is_current {
            // All of these notes were reported before.
            agent.notes();
            Vec::new()
        } else {
            // The new planner's notes on the map no longer hold: an agent reports its whole map when it takes
            // one over.
            let _ = own.map(|own| agent.import(own));
            agent.notes()
        };
        *self.context.snapshot.lock() = Some(agent.export());
        self.agent = Some(agent);
        self.note(notes);
        is_current
    }
}
