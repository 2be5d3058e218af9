//! History's shell: records each pulse and passes it on.

use crate::wiring::{Hub, Wires};
use ractor::{Actor, ActorProcessingErr, ActorRef};
use std::sync::Arc;

/// History's actor.
pub struct HistoryActor;

/// What it hears.
#[derive(Debug)]
pub enum HistoryMsg {
    /// There are pulses.
    Pulses,
}

impl Actor for HistoryActor {
    type Msg = HistoryMsg;
    type State = (Arc<Hub>, Arc<Wires>);
    type Arguments = (Arc<Hub>, Arc<Wires>);

    async fn pre_start(
        &self,
        myself: ActorRef<HistoryMsg>,
        (hub, wires): Self::Arguments,
    ) -> Result<Self::State, ActorProcessingErr> {
        wires.ledger.book().history.mark_gap();
        wires.to_history.attach(Box::new(move || myself.send_message(HistoryMsg::Pulses).is_ok()));
        Ok((hub, wires))
    }

    async fn handle(
        &self,
        _myself: ActorRef<HistoryMsg>,
        _message: HistoryMsg,
        (hub, wires): &mut Self::State,
    ) -> Result<(), ActorProcessingErr> {
        while let Some(mut pulse) = wires.to_history.pop() {
            wires.ledger.book().history.push(&mut pulse, wires.rules().fresh);
            hub.to_model.push((wires.robot, pulse));
        }
        Ok(())
    }
}
