//! Whoever streamed into something is not heard before it fell silent. A stream that goes on as if nothing had happened would push
//! again and again, once per way back.

use super::SuperviseCore;
use crate::gate::Gate;
use mobee_contract::{Refusal, SILENCE, Time};
use std::sync::Arc;

/// An agent that is not heard.
#[derive(Clone, Debug)]
pub(super) struct Hush {
    agent: Arc<str>,
    /// When its last set-point came, or the filter opened after it.
    heard: Time,
}

impl SuperviseCore {
    /// The reflex has closed the filter in mid-motion: if that was a stream of an agent's, it is not heard from now on.
    pub(super) fn hush(&mut self, now: Time) {
        if self.stream.is_none() || self.forces.is_some() {
            return;
        }
        self.hushed = self.owner().map(|agent| Hush { agent, heard: now });
    }

    /// The filter opens: silence counts from now on.
    pub(super) fn begin_silence(&mut self, now: Time) {
        if let Some(hush) = &mut self.hushed {
            hush.heard = hush.heard.max(now);
        }
    }

    /// A set-point of this agent's came.
    ///
    /// # Errors
    /// If it is not heard yet.
    pub(super) fn listen(&mut self, agent: &Arc<str>, now: Time) -> Result<(), Refusal> {
        let open = Gate::opens(self.token) && self.gate.token() == self.token;
        let Some(hush) = self.hushed.as_mut().filter(|hush| hush.agent == *agent) else { return Ok(()) };
        let silent = open && now >= hush.heard + SILENCE;
        hush.heard = hush.heard.max(now);
        if !silent {
            return Err(Refusal::Pushing);
        }
        self.hushed = None;
        Ok(())
    }
}
