//! The way from a connected arm to a driven one: registers that make it hold where it is.

use super::{ArmCore, ConnectionStage};
use mobee_contract::Time;
use std::collections::VecDeque;

/// Greatest distance of a joint outside its limits at which it gets torque, rad: 0.5 degrees.
const MAX_OUTSIDE: f64 = 0.5 * std::f64::consts::PI / 180.0;

/// Registers of one servo that make it hold where it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Arming {
    /// The servo.
    pub id: u8,
    /// Its goal, counts.
    pub goal: i32,
    /// True if it has no torque yet.
    pub torque_off: bool,
}

impl ArmCore {
    /// The connection is new: what was written before may not hold any more.
    pub fn look_again(&mut self) {
        self.interrupted |= self.stage == ConnectionStage::Driving;
        self.stage = ConnectionStage::Looking;
        self.lease = None;
        self.recent.iter_mut().for_each(VecDeque::clear);
    }

    /// Registers that make the arm hold where it is.
    ///
    /// # Errors
    /// A joint that is outside its limits: torque would move it.
    pub fn arming(&self) -> Result<Vec<Arming>, String> {
        let each = self.joints.iter().zip(&self.axes).zip(&self.states).map(|((joint, axis), state)| {
            let q = joint.angle(f64::from(state.position));
            if q < axis.min - MAX_OUTSIDE || q > axis.max + MAX_OUTSIDE {
                let [q, min, max] = [q, axis.min, axis.max].map(f64::to_degrees);
                return Err(format!(
                    "motor {} (id {}) is at {q:.1} deg, outside its limits {min:.1} to {max:.1} deg: move it there by hand, or calibrate the arm",
                    joint.name, joint.id
                ));
            }
            // a loaded servo retains its goal: with its position as the goal it would sag
            let held = joint.angle(f64::from(state.goal));
            let holds = state.torque && (held - q).abs() <= self.numbers.hold_error.max(self.numbers.lead);
            let goal = joint.count((if holds { held } else { q }).clamp(axis.min, axis.max));
            Ok(Arming { id: joint.id, goal, torque_off: !state.torque })
        });
        each.collect()
    }

    /// The arm has been armed like this.
    pub fn armed(&mut self, now: Time, arming: &[Arming]) {
        self.goals = arming.iter().map(|a| a.goal).collect();
        let start: Vec<f64> = self.joints.iter().zip(&self.goals).map(|(j, goal)| j.angle(f64::from(*goal))).collect();
        self.rest_at(&start);
        self.foreign_goals.fill(0);
        self.stage = ConnectionStage::Driving;
        self.interrupted = false;
        self.ticked = Some(now);
        self.lease = None;
        self.unread = None;
        // until it is read, its states are those that it will have
        for (state, arming) in self.states.iter_mut().zip(arming) {
            (state.torque, state.goal) = (true, arming.goal);
        }
    }
}
