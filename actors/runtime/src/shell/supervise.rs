//! The shell of Supervise.

use crate::wiring::{AgentMsg, DriverMsg, ModelMsg, ReflexMsg, RobotContext, SharedContext, SuperviseMsg};
use mobee_contract::{Cause, Event, Status, Verdict};
use mobee_controller::Rules;
use mobee_controller::pulse::Pulse;
use mobee_controller::supervise::{SuperviseCore, SuperviseIn, SuperviseOut};
use ractor::{Actor, ActorProcessingErr, ActorRef, RpcReplyPort};
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// Supervise's actor.
pub struct SuperviseActor;

/// State of a [`SuperviseActor`].
pub struct Supervise {
    shared: Arc<SharedContext>,
    context: Arc<RobotContext>,
    core: SuperviseCore,
    rules: Arc<Rules>,
    reply: Option<RpcReplyPort<Verdict>>,
    yielding: Option<RpcReplyPort<()>>,
}

impl Actor for SuperviseActor {
    type Msg = SuperviseMsg;
    type State = Supervise;
    type Arguments = (Arc<SharedContext>, Arc<RobotContext>);

    async fn pre_start(
        &self,
        myself: ActorRef<SuperviseMsg>,
        (shared, context): Self::Arguments,
    ) -> Result<Supervise, ActorProcessingErr> {
        let now = shared.clock.now();
        let rules = context.rules();
        let (core, first) = context.share(&rules, &shared, |shared| SuperviseCore::new(shared, now));
        context.supervise.connect(myself.clone());
        myself.send_interval(rules.fresh, || SuperviseMsg::Tick);
        context.to_supervise.attach(Box::new(move || myself.send_message(SuperviseMsg::Pulses).is_ok()));
        let mut supervise = Supervise { shared, context, core, rules, reply: None, yielding: None };
        supervise.act(first);
        Ok(supervise)
    }

    async fn handle(
        &self,
        _myself: ActorRef<SuperviseMsg>,
        message: SuperviseMsg,
        supervise: &mut Supervise,
    ) -> Result<(), ActorProcessingErr> {
        match message {
            SuperviseMsg::Pulses => {
                while let Some(pulse) = supervise.context.to_supervise.pop() {
                    supervise.on(SuperviseIn::Pulse(&pulse));
                    supervise.cue_pose(&pulse);
                }
            }
            SuperviseMsg::Commit(commit, reply) => {
                supervise.reply = Some(reply);
                supervise.on(SuperviseIn::Commit(commit));
            }
            SuperviseMsg::Stream(agent, setpoints, reply) => {
                supervise.reply = Some(reply);
                supervise.on(SuperviseIn::Stream(agent, setpoints));
            }
            SuperviseMsg::Revise(id, revision, reply) => {
                supervise.reply = Some(reply);
                supervise.on(SuperviseIn::Revise(id, revision));
            }
            SuperviseMsg::Stop(agent) => supervise.on(SuperviseIn::Stop(agent)),
            SuperviseMsg::AgentDied(agent) => supervise.on(SuperviseIn::AgentDied(agent)),
            SuperviseMsg::Tick => supervise.on(SuperviseIn::Tick),
            SuperviseMsg::Fault(what) => supervise.on(SuperviseIn::Fault(what)),
            SuperviseMsg::TooFast(what) => supervise.on(SuperviseIn::TooFast(what)),
            SuperviseMsg::Closed(token, cause) => {
                let blamed = match &cause {
                    Cause::Contact(contacts) | Cause::Foreseen(contacts) => {
                        Some(supervise.shared.movers(contacts, supervise.context.robot))
                    }
                    _ => None,
                };
                supervise.on(SuperviseIn::Closed(token, cause, blamed));
            }
            SuperviseMsg::ReflexReport(report) => supervise.on(SuperviseIn::ReflexReport(report)),
            SuperviseMsg::Recover => supervise.on(SuperviseIn::Recover),
            SuperviseMsg::Halt => supervise.on(SuperviseIn::Halt),
            SuperviseMsg::Release => supervise.on(SuperviseIn::Release),
            SuperviseMsg::Yield(reply) => {
                supervise.yielding = Some(reply);
                supervise.on(SuperviseIn::Yield);
            }
            SuperviseMsg::Resume => supervise.on(SuperviseIn::Resume),
            SuperviseMsg::Shutdown => supervise.on(SuperviseIn::Shutdown),
            SuperviseMsg::Abandon(reply) => {
                supervise.on(SuperviseIn::Abandon);
                let _ = reply.send(());
            }
        }
        Ok(())
    }
}

impl Supervise {
    fn on(&mut self, input: SuperviseIn) {
        let now = self.shared.clock.now();
        let outputs = self.context.share(&self.rules, &self.shared, |shared| self.core.on(input, now, shared));
        if !outputs.is_empty() {
            self.act(outputs);
        }
        // A halted robot comes to rest without an output.
        let mut latest = self.context.latest.lock();
        latest.status = self.core.status();
        latest.ready = self.core.is_settled();
    }

    fn act(&mut self, outputs: Vec<SuperviseOut>) {
        for output in outputs {
            match output {
                SuperviseOut::Verdict(verdict) => {
                    if let Some(reply) = self.reply.take() {
                        let _ = reply.send(verdict);
                    }
                }
                SuperviseOut::Command(token, writer, command) => {
                    self.context.driver.send(DriverMsg::Command(token, writer, command));
                }
                SuperviseOut::Lease(until) => self.context.lease.store(until.0, Ordering::SeqCst),
                SuperviseOut::RollBack { token, motion, again } => {
                    self.context.reflex.send(ReflexMsg::RollBack(token, motion, again));
                }
                SuperviseOut::Yielded => {
                    if let Some(reply) = self.yielding.take() {
                        let _ = reply.send(());
                    }
                }
                SuperviseOut::Ended(agent, id, end) => {
                    if agent == self.context.agent_name {
                        self.context.agent.send(AgentMsg::Ended(id, end));
                    }
                }
                SuperviseOut::Event(event) => {
                    let ended = matches!(event, Event::Outcome { .. });
                    self.shared.emit(event);
                    if ended {
                        self.cue_outcome();
                    }
                }
            }
        }
        self.context.can_recover.store(self.core.can_recover(), Ordering::SeqCst);
    }

    /// Applies the edits that wait for this robot's next outcome, before its agent is notified.
    fn cue_outcome(&self) {
        let due = self.shared.cues.lock().outcome(&self.context.name);
        for edit in due {
            self.shared.model.send(ModelMsg::Edit(edit, None));
        }
    }

    /// Applies the edits that wait for this robot to rest at a configuration.
    fn cue_pose(&self, pulse: &Pulse) {
        let mut cues = self.shared.cues.lock();
        if cues.wants_poses() && self.core.status() == Status::Rest && pulse.speed < self.rules.rest_speed {
            for edit in cues.pose(&self.context.name, &pulse.sample.q) {
                self.shared.model.send(ModelMsg::Edit(edit, None));
            }
        }
    }
}
