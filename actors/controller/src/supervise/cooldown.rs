//! Cooldown of a stream that caused a contact: its agent is rejected until it has been silent. A stream that goes on
//! regardless would push repeatedly, once per retreat. Set-points of motors that did not cause the contact cannot
//! push, and are accepted: gaze goes on when an arm has hit something.

use super::{SuperviseCore, SuperviseStep};
use crate::gate::Gate;
use mobee_contract::{Refusal, SILENCE, Time};
use std::collections::BTreeSet;
use std::sync::Arc;

/// Agent whose set-points are rejected.
#[derive(Clone, Debug)]
pub(super) struct StreamCooldown {
    /// Agent that streamed as the reflex closed the filter.
    agent: Arc<str>,
    /// Time of its last set-point, or of the opening of the filter, whichever is later.
    last: Time,
    /// Motors that caused the contact, if they are known.
    blamed: Option<BTreeSet<usize>>,
}

impl SuperviseCore {
    /// Starts the cooldown after a closing by the reflex in mid-motion, if the motion was an agent's stream.
    pub(super) fn start_cooldown(&mut self, blamed: Option<BTreeSet<usize>>, step: &SuperviseStep) {
        // A motion under forces is a stream of the controller itself; its agent has committed once, and pushes no
        // more.
        if self.motion.stream.is_none() || self.motion.forces.is_some() {
            return;
        }
        self.cooldown = step.owner().map(|agent| StreamCooldown { agent, last: step.now, blamed });
    }

    /// Restarts the cooldown when the filter opens. During the retreat the agent's set-points were refused, so its
    /// stream may have paused in that time without the agent's intention.
    pub(super) fn restart_cooldown(&mut self, now: Time) {
        if let Some(cooldown) = &mut self.cooldown {
            cooldown.last = cooldown.last.max(now);
        }
    }

    /// Checks whether set-points of this agent are accepted for these motors.
    ///
    /// # Errors
    /// If its cooldown has not ended.
    pub(super) fn admit_stream(
        &mut self,
        agent: &Arc<str>,
        motors: &[usize],
        step: &SuperviseStep,
    ) -> Result<(), Refusal> {
        let open = Gate::opens(self.token) && step.gate.token() == self.token;
        let Some(cooldown) = self.cooldown.as_mut().filter(|cooldown| cooldown.agent == *agent) else { return Ok(()) };
        if cooldown.blamed.as_ref().is_some_and(|blamed| motors.iter().all(|m| !blamed.contains(m))) {
            return Ok(());
        }
        // Each early set-point restarts the cooldown: an agent that never pauses is never accepted.
        let silent = open && step.now >= cooldown.last + SILENCE;
        cooldown.last = cooldown.last.max(step.now);
        if !silent {
            return Err(Refusal::Pushing);
        }
        self.cooldown = None;
        Ok(())
    }
}
