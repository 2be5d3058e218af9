//! History's shell: records each pulse and forwards it.

use crate::wiring::{RobotContext, SharedContext};
use ractor::{Actor, ActorProcessingErr, ActorRef};
use std::sync::Arc;

/// History's actor.
pub struct HistoryActor;

/// Message to history.
#[derive(Debug)]
pub enum HistoryMsg {
    /// Pulses are queued.
    Pulses,
}

impl Actor for HistoryActor {
    type Msg = HistoryMsg;
    type State = (Arc<SharedContext>, Arc<RobotContext>);
    type Arguments = (Arc<SharedContext>, Arc<RobotContext>);

    async fn pre_start(
        &self,
        myself: ActorRef<HistoryMsg>,
        (shared, context): Self::Arguments,
    ) -> Result<Self::State, ActorProcessingErr> {
        let rules = context.rules();
        let mut book = context.ledger.book();
        book.history.mark_gap();
        book.history.set_encoders(&rules.axes, rules.rest_speed);
        drop(book);
        context.to_history.attach(Box::new(move || myself.send_message(HistoryMsg::Pulses).is_ok()));
        Ok((shared, context))
    }

    async fn handle(
        &self,
        _myself: ActorRef<HistoryMsg>,
        _message: HistoryMsg,
        (shared, context): &mut Self::State,
    ) -> Result<(), ActorProcessingErr> {
        while let Some(mut pulse) = context.to_history.pop() {
            context.ledger.book().record(&mut pulse, context.rules().fresh);
            shared.to_model.push((context.robot, pulse));
        }
        Ok(())
    }
}
