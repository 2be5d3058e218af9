//! Actors whose handlers panic or stall as a simulation plans. Used only in runs with planned faults.

use super::LatestCell;
use ractor::{Actor, ActorProcessingErr, ActorRef};
use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;
use std::time::Duration;

/// Fault of a handler.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blow {
    /// It panics before it has done anything.
    Panic,
    /// It waits for this time before it does anything.
    Stall(Duration),
}

impl fmt::Display for Blow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Blow::Panic => f.write_str("a panic"),
            Blow::Stall(time) => write!(f, "a stall of {:.3} s", time.as_secs_f64()),
        }
    }
}

/// Planned faults: per actor, the number of messages before each fault.
#[derive(Clone, Debug, Default)]
pub struct Troubles(Arc<LatestCell<BTreeMap<String, Blows>>>);

/// Faults to come, each after a number of messages.
type Blows = Vec<(u64, Blow)>;

impl Troubles {
    /// Plans a fault.
    pub fn plan(&self, actor: &str, after: u64, blow: Blow) {
        self.0.lock().entry(actor.to_owned()).or_default().push((after, blow));
    }

    /// Drops the planned faults.
    pub fn clear(&self) {
        self.0.lock().clear();
    }

    /// Counts a message to this actor, and returns the fault that is due.
    fn due(&self, actor: &str) -> Option<Blow> {
        let mut all = self.0.lock();
        let planned = all.get_mut(actor)?;
        let due = planned.iter().position(|(after, _)| *after == 0).map(|i| planned.remove(i).1);
        planned.iter_mut().for_each(|(after, _)| *after = after.saturating_sub(1));
        due
    }
}

/// An actor with planned faults: a wrapper that behaves like the inner actor otherwise.
pub struct Troubled<A> {
    actor: A,
    name: String,
    troubles: Troubles,
}

impl<A> Troubled<A> {
    /// Wraps `actor`.
    pub fn new(actor: A, name: String, troubles: Troubles) -> Troubled<A> {
        Troubled { actor, name, troubles }
    }
}

impl<A: Actor> Actor for Troubled<A> {
    type Msg = A::Msg;
    type State = A::State;
    type Arguments = A::Arguments;

    async fn pre_start(
        &self,
        myself: ActorRef<A::Msg>,
        arguments: A::Arguments,
    ) -> Result<A::State, ActorProcessingErr> {
        self.actor.pre_start(myself, arguments).await
    }

    async fn handle(
        &self,
        myself: ActorRef<A::Msg>,
        message: A::Msg,
        state: &mut A::State,
    ) -> Result<(), ActorProcessingErr> {
        match self.troubles.due(&self.name) {
            // Unwinds like any panic, but prints nothing on the terminal.
            Some(Blow::Panic) => std::panic::resume_unwind(Box::new("planted")),
            Some(Blow::Stall(time)) => tokio::time::sleep(time).await,
            None => {}
        }
        self.actor.handle(myself, message, state).await
    }
}
