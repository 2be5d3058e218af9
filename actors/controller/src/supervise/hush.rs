//! Whoever streamed into something is not heard before it fell silent. A stream that goes on as if nothing had happened
//! would push again and again, once per retreat. Set-points of motors that had no part in the contact can't push, and
//! are heard: gaze goes on when an arm ran into something.

use super::{Step, SuperviseCore};
use crate::gate::Gate;
use mobee_contract::{Refusal, SILENCE, Time};
use std::collections::BTreeSet;
use std::sync::Arc;

/// An agent that is not heard.
#[derive(Clone, Debug)]
pub(super) struct Hush {
    /// Who streamed as the reflex closed.
    agent: Arc<str>,
    /// When its last set-point came, or the filter opened after it.
    heard: Time,
    /// The motors that had a part in the contact, if that is known.
    blamed: Option<BTreeSet<usize>>,
}

impl SuperviseCore {
    /// The reflex has closed the filter in mid-motion: if that was a stream of an agent's, it is not heard from now on.
    pub(super) fn hush(&mut self, blamed: Option<BTreeSet<usize>>, step: &Step) {
        // a motion under forces is a stream of the controller's own; its agent committed once, and pushes no more
        if self.motion.stream.is_none() || self.motion.forces.is_some() {
            return;
        }
        self.hushed = step.owner().map(|agent| Hush { agent, heard: step.now, blamed });
    }

    /// The filter opens: silence counts from now on. Its set-points were refused during the retreat, so that it may
    /// well have paused meanwhile without ever meaning to.
    pub(super) fn begin_silence(&mut self, now: Time) {
        if let Some(hush) = &mut self.hushed {
            hush.heard = hush.heard.max(now);
        }
    }

    /// Set-points of this agent's came, for these motors.
    ///
    /// # Errors
    /// If it is not heard yet.
    pub(super) fn listen(&mut self, agent: &Arc<str>, motors: &[usize], step: &Step) -> Result<(), Refusal> {
        let open = Gate::opens(self.token) && step.gate.token() == self.token;
        let Some(hush) = self.hushed.as_mut().filter(|hush| hush.agent == *agent) else { return Ok(()) };
        if hush.blamed.as_ref().is_some_and(|blamed| motors.iter().all(|m| !blamed.contains(m))) {
            return Ok(());
        }
        // each that comes too early begins the silence anew: who never pauses is never heard
        let silent = open && step.now >= hush.heard + SILENCE;
        hush.heard = hush.heard.max(step.now);
        if !silent {
            return Err(Refusal::Pushing);
        }
        self.hushed = None;
        Ok(())
    }
}
