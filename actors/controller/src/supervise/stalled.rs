//! A motor that does not follow, or that a torque from outside pushes, has met something that no model knows: the filter closes, and the
//! motion is taken back as after a contact, so that nothing is left pushing ([`crate::stall`], [`crate::effort`]).

use super::{Step, SuperviseCore, SuperviseOut};
use crate::effort::Pushed;
use crate::pulse::Pulse;
use crate::stall::Stalled;
use mobee_contract::{Cause, Event, Writer};
use mobee_model::JointMotion;
use std::collections::BTreeSet;

impl SuperviseCore {
    /// What this step lets through to the board is what the motors are measured by.
    pub(super) fn note_told(&mut self, step: &Step) {
        let Some(watch) = &self.stall else { return };
        for out in &step.out {
            if let SuperviseOut::Command(_, Writer::Agent, command) = out {
                watch.hear(&mut self.motion.told, command, step.now, step.rules);
            }
        }
    }

    /// A fresh reading: whether it closes the filter. Between motions nobody was told anything.
    pub(super) fn watch_stall(&mut self, pulse: &Pulse, step: &mut Step) -> bool {
        let moving = self.is_moving() && step.gate.token() == self.token;
        let Some(watch) = &mut self.stall else { return false };
        let stalled = watch.read(&mut self.motion.told, pulse, step.rules).filter(|_| moving);
        let passed = watch.passes();
        let name = |motor: usize| step.rules.axes.get(motor).map_or_else(String::new, |axis| axis.name.clone());
        if let Some(motor) = passed.map(name) {
            let robot = step.robot();
            let text = format!(
                "{robot}: {motor} passes where it stalled before: what held it is gone, or that was a false stop, and `stall_deg` is too small"
            );
            step.emit(Event::Warning { text });
        }
        let Some(Stalled { motor: index, by }) = stalled else { return false };
        let (motor, motion) = named(index, step);
        self.takes_back(index, Cause::Stall { motor, by, motion }, step);
        true
    }

    /// A fresh reading: whether a torque from outside closes the filter. At rest it closes nothing: there is no motion to be taken back.
    pub(super) fn watch_effort(&mut self, pulse: &Pulse, step: &mut Step) -> bool {
        let moving = self.is_moving() && step.gate.token() == self.token;
        let pushed = self.effort.read(&pulse.sample, moving, step.rules);
        let Some(Pushed { motor: index, torque }) = pushed else { return false };
        let (motor, motion) = named(index, step);
        self.takes_back(index, Cause::ExternalTorque { motor, torque, motion }, step);
        true
    }

    /// Something that no model knows holds or pushes this motor.
    fn takes_back(&mut self, motor: usize, cause: Cause, step: &mut Step) {
        // a stream that goes on would push again
        self.hush(Some(BTreeSet::from([motor])), step);
        self.roll_back(cause, step);
    }

    /// The motion has ended as it should.
    pub(super) fn learn_following(&mut self) {
        if let Some(watch) = &mut self.stall {
            watch.learn(&self.motion.told);
        }
    }
}

/// A motor's name, and what its encoder counts.
fn named(motor: usize, step: &Step) -> (String, JointMotion) {
    step.rules.axes.get(motor).map(|axis| (axis.name.clone(), axis.motion)).unwrap_or_default()
}
