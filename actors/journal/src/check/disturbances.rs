//! Recent disturbances (deaths, swaps, stale readings, faults), after which contacts are not attributed to the
//! controller.

use crate::names::HEALED;
use mobee_contract::{Cause, Event, SwapStep, Time};
use std::time::Duration;

/// Time for which a disturbance excuses contacts.
const DISTURBED: Duration = Duration::from_secs(3);

/// Time of the most recent disturbance.
#[derive(Debug, Default)]
pub(super) struct Disturbances {
    last: Option<Time>,
    /// True if faults are being injected.
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

    /// True if a disturbance happened shortly before, or faults are being injected.
    pub fn excuse(&self, at: Time) -> bool {
        self.injecting || self.last.is_some_and(|last| at.since(last) <= DISTURBED)
    }
}
