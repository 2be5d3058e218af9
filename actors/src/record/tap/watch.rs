//! The actor that stands for a sink in the supervision tree: it watches the sink's thread and opens the sink anew.

use super::Taps;
use crate::runtime::clock::Clock;
use mobee_contract::Event;
use ractor::{Actor, ActorProcessingErr, ActorRef};
use std::time::Duration;

/// How often a sink is looked at.
const PERIOD: Duration = Duration::from_millis(500);
/// How often in a run a sink is opened anew; one that is attached later, as often again.
const BUDGET: u32 = 3;

/// Watches the sink of this name. Spawn it with `(taps, clock, name)`; its death harms nobody.
pub struct TapActor;

/// What a [`TapActor`] keeps.
pub struct Watched {
    taps: Taps,
    clock: Clock,
    name: String,
    reopened: u32,
    given_up: bool,
    /// Which of those that were attached it is.
    attached: u64,
    /// Dropped entries that were told of.
    told: u64,
}

/// Time to look at the sink.
#[derive(Debug)]
pub struct Look;

impl Actor for TapActor {
    type Msg = Look;
    type State = Watched;
    type Arguments = (Taps, Clock, String);

    async fn pre_start(
        &self,
        myself: ActorRef<Look>,
        (taps, clock, name): Self::Arguments,
    ) -> Result<Watched, ActorProcessingErr> {
        myself.send_interval(PERIOD, || Look);
        Ok(Watched { taps, clock, name, reopened: 0, given_up: false, attached: 0, told: 0 })
    }

    async fn handle(
        &self,
        _myself: ActorRef<Look>,
        _look: Look,
        state: &mut Watched,
    ) -> Result<(), ActorProcessingErr> {
        let Some(pipe) = state.taps.0.pipes.iter().find(|p| p.name() == state.name) else { return Ok(()) };
        let warn = |text: String| state.taps.event(state.clock.now(), Event::Warning { text });
        let (dropped, attached) = (pipe.dropped(), pipe.attached());
        if attached != state.attached {
            // what waited for the one before is no loss: the new one was told how all is
            (state.attached, state.reopened, state.given_up, state.told) = (attached, 0, false, dropped);
        }
        // told whenever they have doubled, so that the warnings are few
        if dropped > 0 && dropped >= 2 * state.told {
            warn(format!("{}: {dropped} entries dropped so far: it can't keep up", state.name));
            state.told = dropped;
        }
        let Some(error) = pipe.error() else { return Ok(()) };
        if !pipe.is_essential() {
            pipe.drop_queued();
        }
        if state.given_up {
            return Ok(());
        }
        if state.reopened == BUDGET {
            state.given_up = true;
            warn(format!("{}: {error}; it stays closed", state.name));
            return Ok(());
        }
        state.reopened += 1;
        let again = pipe.open();
        warn(match again {
            Ok(()) => format!("{}: {error}; opened anew", state.name),
            Err(e) => format!("{}: {error}; it could not be opened anew: {e}", state.name),
        });
        Ok(())
    }
}
