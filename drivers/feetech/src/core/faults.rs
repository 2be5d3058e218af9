//! Faults of the servos and of the bus, from their states: found, reported, relieved.

use super::{ArmCore, ConnectionStage};
use crate::registers::{OVERLOADED, status_text};
use mobee_contract::Time;
use std::time::Duration;

/// Each reading with a goal that the driver did not write counts so much, each other takes one away...
const FOREIGN_GOAL: u32 = 4;
/// ... and from here on another program writes goals.
const FOREIGN_GOALS: u32 = 10;
/// A fault that has ended is reported for this long after.
const FAULT_TAIL: Duration = Duration::from_millis(300);
/// An overloaded servo gets a new goal no sooner than this after the one before.
const RELIEF: Duration = Duration::from_millis(500);

impl ArmCore {
    /// Looks for faults in the newest states.
    pub(super) fn judge(&mut self, at: Time) {
        let mut found = None;
        let mut relieved = Vec::new();
        for (m, (joint, state)) in self.joints.iter().zip(&self.states).enumerate() {
            let id = joint.id;
            if let Some((text, remedy)) = status_text(state.status) {
                found.get_or_insert(format!("motor {} (id {id}) {text}: {remedy}", joint.name));
            }
            if self.stage == ConnectionStage::Looking {
                continue;
            }
            if !state.torque {
                found = Some(format!(
                    "motor {} (id {id}) has lost its torque: the servo has reset, as its supply broke down, or another program switched \
                     it off; check the power supply (5 A), then recover",
                    joint.name
                ));
                self.stage = ConnectionStage::Looking;
                self.interrupted = true;
                continue;
            }
            if state.status & OVERLOADED != 0 {
                relieved.push((m, joint.angle(f64::from(state.position))));
            }
            let Some(seen) = self.foreign_goals.get_mut(m) else { continue };
            let written = self.goals.get(m).copied();
            *seen = match written.is_none_or(|goal| goal == state.goal) {
                true => seen.saturating_sub(1),
                false => (*seen + FOREIGN_GOAL).min(3 * FOREIGN_GOALS),
            };
            if *seen >= FOREIGN_GOALS {
                let (goal, written) = (state.goal, written.unwrap_or_default());
                found.get_or_insert(format!(
                    "motor {} (id {id}) follows goal {goal} and not {written}: another program writes to the bus; end it, then recover",
                    joint.name
                ));
            }
        }
        self.relieve(at, &relieved);
        match found {
            Some(what) => self.set_fault(at, what),
            None => {
                let is_over = self.fault.as_ref().is_some_and(|(since, _)| at.since(*since) > FAULT_TAIL);
                if is_over && !self.interrupted {
                    self.fault = None;
                }
            }
        }
    }

    /// Reports a fault from now on, until it has not been set for a while; everything brakes.
    pub fn set_fault(&mut self, at: Time, what: String) {
        if self.fault.is_none() {
            self.fault = Some((at, what));
            self.brake();
        } else {
            self.fault = Some((at, what));
        }
    }

    /// Servos that have lowered their torque hold where they are, which relieves them. Not with each reading: a goal that follows a sinking
    /// joint leaves it no torque at all.
    fn relieve(&mut self, at: Time, overloaded: &[(usize, f64)]) {
        if overloaded.is_empty() || self.relieved.is_some_and(|before| at.since(before) < RELIEF) {
            return;
        }
        self.relieved = Some(at);
        let mut start: Vec<f64> = self.plant.positions().collect();
        for (m, q) in overloaded {
            if let Some(slot) = start.get_mut(*m) {
                *slot = *q;
            }
        }
        self.rest_at(&start);
    }
}
