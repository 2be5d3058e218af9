//! The agent's shell: requests intents from a planner, commits them, and notifies it of the ends of its
//! motions.

mod planners;

use crate::swap::Phase;
use crate::wiring::{AgentMsg, RobotContext, SharedContext, SuperviseMsg};
use mobee_contract::{
    Commit, CommitId, Event, Hold, Intent, MotionEnd, Refusal, SILENCE, Setpoints, Status, Target, Verdict, View,
};
use mobee_controller::supervise::Revision;
use planners::{MotionReport, PlannerHost};
use ractor::{Actor, ActorProcessingErr, ActorRef};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Time between two requests while the filter takes no commits.
const RETRY_PAUSE: Duration = Duration::from_millis(100);

/// The agent's actor.
pub struct AgentActor;

/// State of an [`AgentActor`].
pub struct AgentState {
    shared: Arc<SharedContext>,
    context: Arc<RobotContext>,
    planners: PlannerHost,
    /// The open motion.
    moving: Option<CommitId>,
    /// True if the open motion belongs to a planner that failed: no planner is notified of its end.
    orphan: bool,
    /// End of the last motion, until the planner was notified.
    last: Option<MotionReport>,
    /// Number of the newest request for an intent: older messages are ignored.
    request: u64,
    /// True if the planner has reported its end.
    done: bool,
    /// True if the run is ending.
    ending: bool,
    /// True if the open motion is a stream.
    streams: bool,
}

impl Actor for AgentActor {
    type Msg = AgentMsg;
    type State = AgentState;
    type Arguments = (Arc<SharedContext>, Arc<RobotContext>);

    async fn pre_start(
        &self,
        myself: ActorRef<AgentMsg>,
        (shared, context): Self::Arguments,
    ) -> Result<AgentState, ActorProcessingErr> {
        let planners = PlannerHost::start(shared.clone(), context.clone())?;
        context.agent.connect(myself.clone());
        let state = AgentState {
            shared,
            context,
            planners,
            moving: None,
            orphan: false,
            last: None,
            request: 0,
            done: false,
            ending: false,
            streams: false,
        };
        state.request_after(&myself, Duration::ZERO);
        Ok(state)
    }

    async fn handle(
        &self,
        myself: ActorRef<AgentMsg>,
        message: AgentMsg,
        state: &mut AgentState,
    ) -> Result<(), ActorProcessingErr> {
        match message {
            AgentMsg::Ask(n) if n == state.request && state.moving.is_none() && !state.done => {
                state.request_intent(&myself).await;
            }
            AgentMsg::Ended(id, end) if state.moving == Some(id) => {
                state.moving = None;
                state.streams = false;
                state.last = (!std::mem::take(&mut state.orphan)).then_some(MotionReport { id: Some(id), end });
                if !state.done {
                    state.request_intent(&myself).await;
                } else {
                    state.tick(&myself).await;
                }
            }
            // A motion that is being rolled back can't be revised; the planner is notified of its end.
            AgentMsg::Revise if state.moving.is_some() && state.context.gate.is_open() => {
                state.revise(&myself).await;
            }
            AgentMsg::SetPoint(id) if state.moving == Some(id) && !state.done => {
                // An agent that yields, for now or for good, lets its stream end by silence.
                if state.context.agent_acts.load(Ordering::SeqCst) && !state.planners.is_due() {
                    state.revise(&myself).await;
                }
                state.set_point_after(&myself, id);
            }
            AgentMsg::Rest => (state.done, state.ending) = (true, true),
            AgentMsg::Swap(offer, reply) => {
                let offered = state.planners.offer(offer).await;
                if let Ok(terms) = &offered {
                    myself.send_after(terms.shadow, || AgentMsg::Tick);
                }
                let _ = reply.send(offered.map(drop));
            }
            AgentMsg::Tick => state.tick(&myself).await,
            _ => {}
        }
        Ok(())
    }
}

impl AgentState {
    fn view(&self) -> View {
        self.shared.view(&self.context)
    }

    fn request_after(&self, myself: &ActorRef<AgentMsg>, pause: Duration) {
        let n = self.request;
        if pause.is_zero() {
            let _ = myself.send_message(AgentMsg::Ask(n));
        } else {
            myself.send_after(pause, move || AgentMsg::Ask(n));
        }
    }

    /// Lets a new planner take over if the old one does not reach a boundary by itself, or ends its probation.
    async fn tick(&mut self, myself: &ActorRef<AgentMsg>) {
        self.planners.tick();
        if self.moving.is_some() || self.ending || !self.planners.is_due() {
            return;
        }
        if self.boundary(myself).await {
            self.request_intent(myself).await;
        } else if self.planners.is_due() {
            myself.send_after(RETRY_PAUSE, || AgentMsg::Tick);
        }
    }

    /// Handles a moment with no transaction open, if the robot is ready. Returns true if a new planner took
    /// over.
    async fn boundary(&mut self, myself: &ActorRef<AgentMsg>) -> bool {
        if self.planners.phase() == Phase::Settled || !self.context.latest.lock().ready {
            return false;
        }
        let took_over = self.planners.boundary(self.last, &self.view()).await;
        if took_over {
            self.done = false;
            let probation = self.context.slot.lock().core.terms().probation;
            myself.send_after(probation, || AgentMsg::Tick);
        }
        took_over
    }

    async fn request_intent(&mut self, myself: &ActorRef<AgentMsg>) {
        self.request += 1;
        self.boundary(myself).await;
        let ready = {
            let latest = self.context.latest.lock();
            // A halted robot takes no commit: its planner is called again after the release.
            latest.ready && latest.status != Status::Holding(Hold::Halted)
        };
        if !(self.context.agent_acts.load(Ordering::SeqCst) && ready) {
            return self.request_after(myself, RETRY_PAUSE);
        }
        let view = self.view();
        let Some(intent) = self.planners.next(&mut self.last, &view).await else {
            return self.request_after(myself, Duration::ZERO);
        };
        match intent {
            Intent::MoveTo(target) => {
                let verdict = self.commit(target, None).await;
                self.begin(verdict, myself);
            }
            Intent::MoveEach(target, speeds) => {
                let verdict = self.commit(target, Some(speeds)).await;
                self.begin(verdict, myself);
            }
            Intent::Stream(setpoints) => {
                let verdict = self.stream(setpoints, myself).await;
                self.begin(verdict, myself);
            }
            Intent::Stop => self.request_after(myself, RETRY_PAUSE),
            Intent::Wait(time) => self.request_after(myself, time.max(Duration::from_millis(1))),
            Intent::Done(summary) => {
                self.done = true;
                self.shared.emit(Event::Done { robot: self.context.name.clone(), summary });
            }
        }
    }

    /// Handles the verdict on a motion: it is under way, or the planner is called again.
    fn begin(&mut self, verdict: Option<Verdict>, myself: &ActorRef<AgentMsg>) {
        match verdict {
            Some(Ok(id)) => {
                self.moving = Some(id);
                return;
            }
            // The robot or the filter is not ready; the target is not at fault.
            Some(Err(Refusal::Closed | Refusal::Busy | Refusal::NotReady { .. } | Refusal::Holding { .. })) | None => {}
            Some(Err(Refusal::Pushing)) => return self.request_after(myself, SILENCE + RETRY_PAUSE),
            Some(Err(_)) => self.last = Some(MotionReport { id: None, end: MotionEnd::Failed }),
        }
        self.request_after(myself, RETRY_PAUSE);
    }

    async fn revise(&mut self, myself: &ActorRef<AgentMsg>) {
        let view = self.view();
        let Ok(intent) = self.planners.revise(&view).await else {
            // No planner is left for this motion: it is stopped and rolled back, as after an agent's death
            // (I18).
            self.orphan = true;
            self.context.agent_died(self.context.agent_name.clone());
            return;
        };
        match intent {
            // A refused revision leaves the motion as it was; the planner is notified of its end.
            Some(Intent::MoveTo(target)) => drop(self.commit(target, None).await),
            Some(Intent::MoveEach(target, speeds)) => drop(self.commit(target, Some(speeds)).await),
            Some(Intent::Stream(setpoints)) => {
                let _ = self.stream(setpoints, myself).await;
            }
            Some(Intent::Stop) => {
                self.context.supervise.send(SuperviseMsg::Stop(self.context.agent_name.clone()));
            }
            Some(Intent::Wait(_) | Intent::Done(_)) | None => {}
        }
    }

    async fn stream(&mut self, setpoints: Setpoints, myself: &ActorRef<AgentMsg>) -> Option<Verdict> {
        let verdict = self.request_motion(Revision::Stream(self.context.agent_name.clone(), setpoints)).await;
        if let (Some(Ok(id)), false) = (&verdict, self.streams) {
            self.streams = true;
            self.set_point_after(myself, *id);
        }
        verdict
    }

    /// Schedules the next set-point after a control period.
    fn set_point_after(&self, myself: &ActorRef<AgentMsg>, id: CommitId) {
        myself.send_after(self.context.rules().period, move || AgentMsg::SetPoint(id));
    }

    async fn commit(&mut self, target: Target, speeds: Option<Vec<f64>>) -> Option<Verdict> {
        let agent = self.context.agent_name.clone();
        self.request_motion(Revision::Commit(Commit { agent, target, speeds })).await
    }

    /// Requests a motion from supervise. While a motion is open as far as this actor has been notified, the
    /// request may only change that motion: it may have ended already, with the notification still queued.
    async fn request_motion(&mut self, revision: Revision) -> Option<Verdict> {
        let (reply, verdict) = ractor::concurrency::oneshot();
        let reply = reply.into();
        self.context.supervise.send(match (self.moving, revision) {
            (Some(id), revision) => SuperviseMsg::Revise(id, revision, reply),
            (None, Revision::Commit(commit)) => SuperviseMsg::Commit(commit, reply),
            (None, Revision::Stream(agent, setpoints)) => SuperviseMsg::Stream(agent, setpoints, reply),
        });
        verdict.await.ok()
    }
}
