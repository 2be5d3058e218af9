//! After what nothing that touches is held against a controller: deaths, swaps, stale readings, faults.

use crate::record::names::HEALED;
use mobee_contract::{Cause, Event, SwapStep, Time};
use std::time::Duration;

/// For how long.
const DISTURBED: Duration = Duration::from_secs(3);

/// When anything failed last.
#[derive(Debug, Default)]
pub(super) struct Disturbances {
    last: Option<Time>,
    /// Whether faults are being injected.
    injecting: bool,
}

impl Disturbances {
    /// Takes the next event.
    pub fn note(&mut self, at: Time, event: &Event) {
        match event {
            Event::Injected { fault } => (self.injecting, self.last) = (fault != HEALED, Some(at)),
            Event::Swap { step: SwapStep::TookOver { .. } | SwapStep::Reverted { .. }, .. }
            | Event::Died { .. }
            | Event::Restarted { .. }
            | Event::Resumed { .. }
            | Event::Displaced { .. }
            | Event::Disabled {
                cause:
                    Cause::Stale | Cause::ActorDied(_) | Cause::Crashed | Cause::BoardFault(_) | Cause::Displaced { .. },
                ..
            } => self.last = Some(at),
            _ => {}
        }
    }

    /// Whether something failed shortly before, or faults are being injected.
    pub fn excuse(&self, at: Time) -> bool {
        self.injecting || self.last.is_some_and(|last| at.since(last) <= DISTURBED)
    }
}
