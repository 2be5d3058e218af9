//! The agent's shell: asks a planner what it wants, commits it, and tells it how its motions ended.

mod planners;

use crate::runtime::swap::Phase;
use crate::wiring::{AgentMsg, RobotContext, SharedContext, SuperviseMsg};
use mobee_contract::{
    Commit, CommitId, Event, Hold, Intent, MotionEnd, Refusal, SILENCE, Setpoints, Status, Target, Verdict, View,
};
use mobee_controller::supervise::Revision;
use planners::{Last, PlannerHost};
use ractor::{Actor, ActorProcessingErr, ActorRef};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// How long to wait before asking again whether the filter takes commits.
const PAUSE: Duration = Duration::from_millis(100);

/// The agent's actor.
pub struct AgentActor;

/// What it keeps.
pub struct Planning {
    shared: Arc<SharedContext>,
    context: Arc<RobotContext>,
    planners: PlannerHost,
    /// The motion under way.
    moving: Option<CommitId>,
    /// Whether the motion under way was one of a planner that broke: its end is told to nobody.
    orphan: bool,
    /// How the last one ended, until the planner was told.
    last: Option<Last>,
    asked: u64,
    /// Whether the planner has nothing more to do.
    done: bool,
    /// Whether the run ends.
    rests: bool,
    /// Whether the motion under way is a stream.
    streams: bool,
}

impl Actor for AgentActor {
    type Msg = AgentMsg;
    type State = Planning;
    type Arguments = (Arc<SharedContext>, Arc<RobotContext>);

    async fn pre_start(
        &self,
        myself: ActorRef<AgentMsg>,
        (shared, context): Self::Arguments,
    ) -> Result<Planning, ActorProcessingErr> {
        let planners = PlannerHost::start(shared.clone(), context.clone())?;
        context.agent.connect(myself.clone());
        let planning = Planning {
            shared,
            context,
            planners,
            moving: None,
            orphan: false,
            last: None,
            asked: 0,
            done: false,
            rests: false,
            streams: false,
        };
        planning.ask_after(&myself, Duration::ZERO);
        Ok(planning)
    }

    async fn handle(
        &self,
        myself: ActorRef<AgentMsg>,
        message: AgentMsg,
        planning: &mut Planning,
    ) -> Result<(), ActorProcessingErr> {
        match message {
            AgentMsg::Ask(n) if n == planning.asked && planning.moving.is_none() && !planning.done => {
                planning.ask(&myself).await;
            }
            AgentMsg::Ended(id, end) if planning.moving == Some(id) => {
                planning.moving = None;
                planning.streams = false;
                planning.last = (!std::mem::take(&mut planning.orphan)).then_some(Last { id: Some(id), end });
                if !planning.done {
                    planning.ask(&myself).await;
                } else {
                    planning.tick(&myself).await;
                }
            }
            // of a motion that is being taken back there is nothing to be revised; how it ended will be told
            AgentMsg::Revise if planning.moving.is_some() && planning.context.gate.is_open() => {
                planning.revise(&myself).await;
            }
            AgentMsg::SetPoint(id) if planning.moving == Some(id) && !planning.done => {
                // an agent that makes way, for now or for good, lets its stream go quiet
                if planning.context.agent_acts.load(Ordering::SeqCst) && !planning.planners.is_due() {
                    planning.revise(&myself).await;
                }
                planning.set_point_after(&myself, id);
            }
            AgentMsg::Rest => (planning.done, planning.rests) = (true, true),
            AgentMsg::Swap(offer, reply) => {
                let offered = planning.planners.offer(offer).await;
                if let Ok(terms) = &offered {
                    myself.send_after(terms.shadow, || AgentMsg::Tick);
                }
                let _ = reply.send(offered.map(drop));
            }
            AgentMsg::Tick => planning.tick(&myself).await,
            _ => {}
        }
        Ok(())
    }
}

impl Planning {
    fn view(&self) -> View {
        self.shared.view(&self.context)
    }

    fn ask_after(&self, myself: &ActorRef<AgentMsg>, pause: Duration) {
        let n = self.asked;
        if pause.is_zero() {
            let _ = myself.send_message(AgentMsg::Ask(n));
        } else {
            myself.send_after(pause, move || AgentMsg::Ask(n));
        }
    }

    /// Time for a new planner to take over, if the old one does not come to a boundary by itself, or for its probation to end.
    async fn tick(&mut self, myself: &ActorRef<AgentMsg>) {
        self.planners.tick();
        if self.moving.is_some() || self.rests || !self.planners.is_due() {
            return;
        }
        if self.boundary(myself).await {
            self.ask(myself).await;
        } else if self.planners.is_due() {
            myself.send_after(PAUSE, || AgentMsg::Tick);
        }
    }

    /// No transaction is open, if the robot is ready: whether a new planner took over.
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

    async fn ask(&mut self, myself: &ActorRef<AgentMsg>) {
        self.asked += 1;
        self.boundary(myself).await;
        let ready = {
            let latest = self.context.latest.lock();
            // a halted robot takes no commit: what its planner wants is asked for once it is released
            latest.ready && latest.status != Status::Holding(Hold::Halted)
        };
        if !(self.context.agent_acts.load(Ordering::SeqCst) && ready) {
            return self.ask_after(myself, PAUSE);
        }
        let view = self.view();
        let Some(intent) = self.planners.next(&mut self.last, &view).await else {
            return self.ask_after(myself, Duration::ZERO);
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
            Intent::Stop => self.ask_after(myself, PAUSE),
            Intent::Wait(time) => self.ask_after(myself, time.max(Duration::from_millis(1))),
            Intent::Done(summary) => {
                self.done = true;
                self.shared.tell(Event::Done { robot: self.context.name.clone(), summary });
            }
        }
    }

    /// A motion was asked for: it is under way, or the planner is asked again.
    fn begin(&mut self, verdict: Option<Verdict>, myself: &ActorRef<AgentMsg>) {
        match verdict {
            Some(Ok(id)) => {
                self.moving = Some(id);
                return;
            }
            // not the target's fault: the robot or the filter is not ready for it
            Some(Err(Refusal::Closed | Refusal::Busy | Refusal::NotReady { .. } | Refusal::Holding { .. })) | None => {}
            Some(Err(Refusal::Pushing)) => return self.ask_after(myself, SILENCE + PAUSE),
            Some(Err(_)) => self.last = Some(Last { id: None, end: MotionEnd::Failed }),
        }
        self.ask_after(myself, PAUSE);
    }

    async fn revise(&mut self, myself: &ActorRef<AgentMsg>) {
        let view = self.view();
        let Ok(intent) = self.planners.revise(&view).await else {
            // nobody plans this motion any more: it is stopped and taken back, as after an agent's death (I18)
            self.orphan = true;
            self.context.agent_died(self.context.agent_name.clone());
            return;
        };
        match intent {
            // refused: the motion goes on as it was, and its end will be told
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
        let verdict = self.ask_for(Revision::Stream(self.context.agent_name.clone(), setpoints)).await;
        if let (Some(Ok(id)), false) = (&verdict, self.streams) {
            self.streams = true;
            self.set_point_after(myself, *id);
        }
        verdict
    }

    /// Asks for the next set-point after a control period.
    fn set_point_after(&self, myself: &ActorRef<AgentMsg>, id: CommitId) {
        myself.send_after(self.context.rules().period, move || AgentMsg::SetPoint(id));
    }

    async fn commit(&mut self, target: Target, speeds: Option<Vec<f64>>) -> Option<Verdict> {
        let agent = self.context.agent_name.clone();
        self.ask_for(Revision::Commit(Commit { agent, target, speeds })).await
    }

    /// Asks for a motion. While one is under way as far as is known here, only that may be changed: it may have ended, and its
    /// end wait to be heard.
    async fn ask_for(&mut self, revision: Revision) -> Option<Verdict> {
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
