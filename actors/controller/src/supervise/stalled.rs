//! Reaction to a motor that does not follow, or that an external torque pushes: it has met an obstacle that is not in
//! the model. The filter closes, and the motion is rolled back as after a contact, so that no motor goes on pushing
//! ([`crate::stall`], [`crate::effort`]).

use super::{SuperviseCore, SuperviseOut, SuperviseStep};
use crate::effort::Pushed;
use crate::pulse::Pulse;
use crate::stall::Stalled;
use mobee_contract::{Cause, Event, Writer};
use mobee_model::JointMotion;
use std::collections::BTreeSet;

impl SuperviseCore {
    /// Records the commands of this step for the stall detection.
    pub(super) fn track_commands(&mut self, step: &SuperviseStep) {
        let Some(watch) = &self.stall else { return };
        for out in &step.out {
            if let SuperviseOut::Command(_, Writer::Agent, command) = out {
                watch.track(&mut self.motion.tracked, command, step.now, step.rules);
            }
        }
    }

    /// Checks a fresh reading for a stall. Returns whether it closes the filter. Between motions the motors track no
    /// commands.
    pub(super) fn watch_stall(&mut self, pulse: &Pulse, step: &mut SuperviseStep) -> bool {
        let moving = self.is_moving() && step.gate.token() == self.token;
        let Some(watch) = &mut self.stall else { return false };
        let stalled = watch.read(&mut self.motion.tracked, pulse, step.rules).filter(|_| moving);
        let passed = watch.passes();
        let name = |motor: usize| step.rules.axes.get(motor).map_or_else(String::new, |axis| axis.name.clone());
        if let Some(motor) = passed.map(name) {
            let robot = step.robot();
            let text = format!(
                "{robot}: {motor} passes where it stalled before: the obstacle is gone, or the stop was false and `stall_deg` is too small"
            );
            step.emit(Event::Warning { text });
        }
        let Some(Stalled { motor: index, by }) = stalled else { return false };
        let (motor, motion) = named(index, step);
        self.roll_back_for_obstacle(index, Cause::Stall { motor, by, motion }, step);
        true
    }

    /// Checks a fresh reading for an external torque. Returns whether it closes the filter. At rest it never does:
    /// there is no motion to roll back.
    pub(super) fn watch_effort(&mut self, pulse: &Pulse, step: &mut SuperviseStep) -> bool {
        let moving = self.is_moving() && step.gate.token() == self.token;
        let pushed = self.effort.read(pulse, moving, step.rules);
        let Some(Pushed { motor: index, torque }) = pushed else { return false };
        let (motor, motion) = named(index, step);
        self.roll_back_for_obstacle(index, Cause::ExternalTorque { motor, torque, motion }, step);
        true
    }

    /// Rolls back the motion because an obstacle that is not in the model holds or pushes this motor.
    fn roll_back_for_obstacle(&mut self, motor: usize, cause: Cause, step: &mut SuperviseStep) {
        // A stream that goes on would push again.
        self.start_cooldown(Some(BTreeSet::from([motor])), step);
        self.roll_back(cause, step);
    }

    /// Learns the lag of the motors from a motion that ended as it should.
    pub(super) fn learn_following(&mut self) {
        if let Some(watch) = &mut self.stall {
            watch.learn(&self.motion.tracked);
        }
    }
}

/// Name and joint kind of a motor.
fn named(motor: usize, step: &SuperviseStep) -> (String, JointMotion) {
    step.rules.axes.get(motor).map(|axis| (axis.name.clone(), axis.motion)).unwrap_or_default()
}
