//! Reflex's shell.

use crate::shell::{DriverMsg, SuperviseMsg};
use crate::wiring::{Hub, Wires};
use mobee_contract::Writer;
use mobee_controller::Rules;
use mobee_controller::reflex::{ReflexCore, ReflexIn, ReflexOut, Underway};
use ractor::{Actor, ActorProcessingErr, ActorRef};
use std::sync::Arc;

/// The reflex's actor.
pub struct ReflexActor;

/// What it hears.
#[derive(Debug)]
pub enum ReflexMsg {
    /// There are pulses.
    Pulses,
    /// Supervise closed the filter: take the robot back.
    RollBack(u64, Underway, bool),
}

/// What it keeps.
pub struct Reflex {
    hub: Arc<Hub>,
    wires: Arc<Wires>,
    core: ReflexCore,
    rules: Arc<Rules>,
}

impl Actor for ReflexActor {
    type Msg = ReflexMsg;
    type State = Reflex;
    type Arguments = (Arc<Hub>, Arc<Wires>);

    async fn pre_start(
        &self,
        myself: ActorRef<ReflexMsg>,
        (hub, wires): Self::Arguments,
    ) -> Result<Reflex, ActorProcessingErr> {
        let rules = wires.rules();
        let core = wires.share(&rules, &hub, |shared| ReflexCore::new(wires.robot, shared));
        wires.reflex.connect(myself.clone());
        wires.to_reflex.attach(Box::new(move || myself.send_message(ReflexMsg::Pulses).is_ok()));
        Ok(Reflex { hub, wires, core, rules })
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
        while let Some(mut pulse) = self.wires.to_reflex.pop() {
            self.on(ReflexIn::Pulse(&mut pulse));
            {
                let mut latest = self.wires.latest.lock();
                latest.at = pulse.sample.at;
                latest.q = pulse.sample.q.clone();
                latest.contacts = self.core.seen();
            }
            self.hub.taps.pose(pulse.sample.at, self.wires.robot, &pulse.sample.q, self.core.present());
            self.wires.to_supervise.push(pulse);
        }
    }

    fn on(&mut self, input: ReflexIn) {
        let hub = self.hub.clone();
        let names = |pair| hub.names(pair);
        let now = hub.clock.now();
        let outputs = self.wires.share(&self.rules, &hub, |shared| self.core.on(input, now, shared, &names));
        for output in outputs {
            match output {
                ReflexOut::Command(token, command) => {
                    self.wires.driver.send(DriverMsg::Command(token, Writer::Reflex, command));
                }
                ReflexOut::Closed { token, cause } => {
                    self.wires.supervise.send(SuperviseMsg::Closed(token, cause));
                }
                ReflexOut::Bring(asked) => {
                    let scene = self.hub.scene.lock().clone();
                    let who = asked.participant(self.rules.clone(), &self.wires.ledger.book().history, scene);
                    let enroll = |who| self.hub.joint_retreat.enroll(who, self.hub.clock.now());
                    self.on(ReflexIn::Brought(who.map(enroll)));
                }
                ReflexOut::ReflexReport(word) => {
                    self.wires.supervise.send(SuperviseMsg::ReflexReport(word));
                }
                ReflexOut::Event(event) => hub.tell(event),
            }
        }
    }
}
