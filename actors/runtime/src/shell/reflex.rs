//! The reflex's shell.

use crate::wiring::{DriverMsg, ReflexMsg, RobotContext, SharedContext, SuperviseMsg};
use mobee_contract::Writer;
use mobee_controller::Rules;
use mobee_controller::reflex::{ReflexCore, ReflexIn, ReflexOut};
use ractor::{Actor, ActorProcessingErr, ActorRef};
use std::sync::Arc;

/// The reflex's actor.
pub struct ReflexActor;

/// State of a [`ReflexActor`].
pub struct Reflex {
    shared: Arc<SharedContext>,
    context: Arc<RobotContext>,
    core: ReflexCore,
    rules: Arc<Rules>,
}

impl Actor for ReflexActor {
    type Msg = ReflexMsg;
    type State = Reflex;
    type Arguments = (Arc<SharedContext>, Arc<RobotContext>);

    async fn pre_start(
        &self,
        myself: ActorRef<ReflexMsg>,
        (shared, context): Self::Arguments,
    ) -> Result<Reflex, ActorProcessingErr> {
        let rules = context.rules();
        let core = context.share(&rules, &shared, |shared| ReflexCore::new(context.robot, shared));
        context.reflex.connect(myself.clone());
        context.to_reflex.attach(Box::new(move || myself.send_message(ReflexMsg::Pulses).is_ok()));
        Ok(Reflex { shared, context, core, rules })
    }

    async fn handle(
        &self,
        _myself: ActorRef<ReflexMsg>,
        message: ReflexMsg,
        reflex: &mut Reflex,
    ) -> Result<(), ActorProcessingErr> {
        match message {
            ReflexMsg::Pulses => reflex.pulses(),
            ReflexMsg::RollBack(token, motion, again) => reflex.on(ReflexIn::RollBack { token, motion, again }),
        }
        Ok(())
    }
}

impl Reflex {
    fn pulses(&mut self) {
        while let Some(mut pulse) = self.context.to_reflex.pop() {
            self.on(ReflexIn::Pulse(&mut pulse));
            {
                let mut latest = self.context.latest.lock();
                latest.at = pulse.sample.at;
                latest.q = pulse.sample.q.clone();
                latest.contacts = self.core.seen();
            }
            self.shared.taps.pose(pulse.sample.at, self.context.robot, &pulse.sample.q, self.core.present());
            self.context.to_supervise.push(pulse);
        }
    }

    fn on(&mut self, input: ReflexIn) {
        let shared = self.shared.clone();
        let names = |pair| shared.names(pair);
        let now = shared.clock.now();
        let outputs = self.context.share(&self.rules, &shared, |shared| self.core.on(input, now, shared, &names));
        for output in outputs {
            match output {
                ReflexOut::Command(token, command) => {
                    self.context.driver.send(DriverMsg::Command(token, Writer::Reflex, command));
                }
                ReflexOut::Closed { token, cause } => {
                    self.context.supervise.send(SuperviseMsg::Closed(token, cause));
                }
                ReflexOut::Bring(request) => {
                    let scene = self.shared.scene.lock().clone();
                    let poses = self.shared.robots.iter().map(|robot| robot.latest.lock().q.clone()).collect();
                    let participant =
                        request.participant(self.rules.clone(), &self.context.ledger.book().history, scene, poses);
                    let enroll = |participant| self.shared.joint_retreat.enroll(participant, self.shared.clock.now());
                    self.on(ReflexIn::Brought(participant.map(enroll)));
                }
                ReflexOut::ReflexReport(report) => {
                    self.context.supervise.send(SuperviseMsg::ReflexReport(report));
                }
                ReflexOut::Event(event) => shared.emit(event),
            }
        }
    }
}
