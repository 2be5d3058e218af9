//! The actor that represents a sink in the supervision tree: it watches the sink's thread and reopens the sink.

use super::Taps;
use crate::clock::Clock;
use mobee_contract::Event;
use ractor::{Actor, ActorProcessingErr, ActorRef};
use std::time::Duration;

/// Interval of the checks.
const PERIOD: Duration = Duration::from_millis(500);
/// Number of times that a sink is reopened in a run; the count starts again when another sink is attached.
const MAX_REOPENS: u32 = 3;

/// Watches the sink of this name. Spawn it with `(taps, clock, name)`; its death has no effect on other actors.
pub struct TapActor;

/// State of a [`TapActor`].
pub struct Watched {
    taps: Taps,
    clock: Clock,
    name: String,
    reopened: u32,
    given_up: bool,
    /// Number of the attached sink that is being watched.
    attached: u64,
    /// Number of dropped entries that the last warning reported.
    reported_dropped: u64,
}

/// Message: check the sink.
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
        Ok(Watched { taps, clock, name, reopened: 0, given_up: false, attached: 0, reported_dropped: 0 })
    }

    async fn handle(
        &self,
        _myself: ActorRef<Look>,
        _look: Look,
        state: &mut Watched,
    ) -> Result<(), ActorProcessingErr> {
        let Some(pipe) = state.taps.0.pipes.iter().find(|p| p.name() == state.name) else { return Ok(()) };
        let warn = |text: String| state.taps.event(state.clock.now(), Event::Warning { text });
        let dropped = pipe.dropped();
        let attached = pipe.attached();
        if attached != state.attached {
            // Entries that were queued for the previous sink are no loss: the new one has received the present
            // state.
            state.attached = attached;
            state.reopened = 0;
            state.given_up = false;
            state.reported_dropped = dropped;
        }
        // Warn whenever the count has doubled, so that the warnings are few.
        if dropped > 0 && dropped >= 2 * state.reported_dropped {
            warn(format!("{}: {dropped} entries dropped so far: it can't keep up", state.name));
            state.reported_dropped = dropped;
        }
        let Some(error) = pipe.error() else { return Ok(()) };
        if !pipe.is_essential() {
            pipe.drop_queued();
        }
        if state.given_up {
            return Ok(());
        }
        if state.reopened == MAX_REOPENS {
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
