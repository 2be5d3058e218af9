//! Motions under forces (controllers of kind `fields`): each reading moves the reference on, which is written as a
//! stream.
//!
//! The force-field controller of the later MoBeE drives the robot; transactions, reflex and retreat stay as they are.
//! So a field that is too weak costs a rollback, and not a collision.
//!
//! ```text
//! Rest ──Commit──> Moving ──reference and robot rest at the target──> Rest        Committed
//!                    │ at rest elsewhere for `patience`: target missed            RolledBack
//!                    │ contact at any time: as any motion
//! ```

use super::streaming::Streaming;
use super::{MotionState, Reading, Step, SuperviseCore};
use crate::pulse::Pulse;
use crate::trajectory::ReferenceTrajectory;
use crate::{FieldRules, Rules, clamped, distance};
use mobee_contract::{Cause, ControlMode, Hold, Pose, Status, Time};

/// A motion under way.
#[derive(Clone, Debug)]
pub(super) struct Forces {
    /// Where they lead.
    course: ReferenceTrajectory,
    /// When it was given its target, by the clock.
    aimed: Time,
    /// When the reference last moved on, by the clock.
    stepped: Time,
    /// Since when the reference is at the target, by the readings' time.
    there: Option<Time>,
    /// Since when the robot rests, by the readings' time.
    still: Option<Time>,
}

impl SuperviseCore {
    /// The open transaction's motion begins: these motors go to the target, none faster than its cap, rad/s.
    pub(super) fn begin_forces(
        &mut self,
        fields: &FieldRules,
        (target, motors): (&Pose, &[(usize, f64)]),
        here: &Pose,
        step: &mut Step,
    ) {
        let (rules, now) = (step.rules, step.now);
        let mut stream = Streaming::new(rules, now);
        let start = clamped(here, rules);
        let mut course = ReferenceTrajectory::new(&start);
        course.aim(fields, target, motors);
        let moving = course.motors();
        stream.ask(&moving, mode(rules), &still(here, rules), (here, now), rules);
        step.book.ahead = Some(start);
        self.motion.forces = Some(Forces { course, aimed: now, stepped: now, there: None, still: None });
        self.begin_stream(stream, &moving, here, step);
    }

    /// The target changed in mid-motion: the reference goes on from where it is, at the speed that it has.
    pub(super) fn aim_forces(&mut self, target: &Pose, motors: &[(usize, f64)], step: &mut Step) {
        let (rules, now) = (step.rules, step.now);
        let Some(fields) = rules.fields.as_deref() else { return };
        let (Some(forces), Some(stream)) = (&mut self.motion.forces, &mut self.motion.stream) else { return };
        forces.course.aim(fields, target, motors);
        (forces.aimed, forces.there, forces.still) = (now, None, None);
        let new: Vec<usize> = motors.iter().map(|(m, _)| *m).filter(|m| !stream.names(*m)).collect();
        let Some(Reading { q: here, .. }) = &self.newest else { return };
        stream.ask(&new, mode(rules), &still(here, rules), (here, now), rules);
        self.switch_modes(&new, step);
    }

    /// A reading during a motion under forces. Done when the reference has arrived, time enough has passed for the
    /// robot to follow it, and the robot rests at the target: the reference alone proves nothing.
    pub(super) fn under_forces(&mut self, pulse: &Pulse, at_rest: bool, step: &mut Step) {
        let (rules, now, sampled_at, q) = (step.rules, step.now, pulse.sample.at, &pulse.sample.q);
        let (Some(open), Some(fields)) = (&step.book.open, rules.fields.as_ref()) else { return };
        let (target, due) = (open.target.clone(), open.motion.due());
        if self.is_stream_frozen(pulse) {
            return self.interrupt(Cause::Stale, Status::Holding(Hold::Stale), step);
        }
        let (Some(forces), Some(stream)) = (&mut self.motion.forces, &mut self.motion.stream) else { return };
        let (elapsed, period) = (now.since(forces.stepped).as_secs_f64(), rules.period.as_secs_f64());
        // readings may come more often than the period, or in a bunch: the reference moves by the clock
        if elapsed >= 0.75 * period {
            forces.stepped = now;
            let push = pulse.push.as_deref().unwrap_or_default();
            forces.course.step(q, push, rules, elapsed.min(1.5 * period));
            step.book.ahead = Some(forces.course.q().into());
            let moving = forces.course.motors();
            let next = match mode(rules) {
                ControlMode::Velocity => forces.course.velocities(q),
                _ => forces.course.q().to_vec(),
            };
            stream.ask(&moving, mode(rules), &next, (q, now), rules);
        }
        forces.there = if forces.course.is_there() { forces.there.or(Some(sampled_at)) } else { None };
        forces.still = if at_rest { forces.still.or(Some(sampled_at)) } else { None };
        // the robot follows the reference, a reaction behind it
        let arrived = forces.there.is_some_and(|since| sampled_at >= since + rules.reaction());
        let set_out = forces.aimed + rules.reaction();
        // forces that balance elsewhere will go on doing so: its agent learns it after `patience`, not when the motion
        // is due
        let still = forces.still.is_some_and(|since| sampled_at >= since.max(set_out) + fields.patience);
        self.write_stream(q, step);
        if arrived && at_rest && sampled_at >= set_out && distance(q, &target) <= rules.tolerance {
            let told = std::mem::take(&mut self.motion.told);
            self.motion = MotionState { told, ..MotionState::default() };
            self.done(pulse, step);
        } else if still || due.is_some_and(|due| sampled_at > due) {
            self.roll_back(Cause::TargetMissed, step);
        } else {
            self.keep_in_history(step);
        }
    }
}

/// The mode in which motors are driven under forces: positions if the board takes them, since their errors do not add
/// up.
fn mode(rules: &Rules) -> ControlMode {
    if rules.position_direct { ControlMode::PositionDirect } else { ControlMode::Velocity }
}

/// The set-points of a robot that stays where it is.
fn still(here: &Pose, rules: &Rules) -> Pose {
    match mode(rules) {
        ControlMode::Velocity => vec![0.0; here.len()].into(),
        _ => clamped(here, rules),
    }
}
