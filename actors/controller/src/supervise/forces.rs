//! Motions under forces (controllers of kind `fields`): each reading advances the reference, which is written as a
//! stream.
//!
//! The force-field controller of the later MoBeE drives the robot; transactions, reflex and retreat are unchanged. So
//! a field that is too weak costs a rollback, and not a collision.
//!
//! ```text
//! Rest ──Commit──> Moving ──reference and robot rest at the target──> Rest        Committed
//!                    │ at rest elsewhere for `patience`: target missed            RolledBack
//!                    │ contact at any time: as any motion
//! ```

use super::streaming::OpenStream;
use super::{MotionState, StoredReading, SuperviseCore, SuperviseStep};
use crate::pulse::Pulse;
use crate::trajectory::ReferenceTrajectory;
use crate::{FieldRules, Rules, clamped};
use mobee_contract::{Cause, ControlMode, Hold, Pose, Status, Time, distance};

/// Motion under forces in progress.
#[derive(Clone, Debug)]
pub(super) struct Forces {
    /// Reference trajectory.
    course: ReferenceTrajectory,
    /// Time at which the target was set, by the clock.
    aimed: Time,
    /// Time at which the reference last advanced, by the clock.
    stepped: Time,
    /// Time since which the reference is at the target, by the times of the readings.
    there: Option<Time>,
    /// Time since which the robot rests, by the times of the readings.
    still: Option<Time>,
}

impl SuperviseCore {
    /// Begins the open transaction's motion: these motors move to the target, each with its greatest speed, rad/s.
    pub(super) fn begin_forces(
        &mut self,
        fields: &FieldRules,
        (target, motors): (&Pose, &[(usize, f64)]),
        here: &Pose,
        step: &mut SuperviseStep,
    ) {
        let rules = step.rules;
        let now = step.now;
        let mut stream = OpenStream::new(rules, now);
        let start = clamped(here, rules);
        let mut course = ReferenceTrajectory::new(&start);
        course.aim(fields, target, motors);
        let moving = course.motors();
        stream.request(&moving, mode(rules), &still(here, rules), (here, now), rules);
        step.book.ahead = Some(start);
        self.motion.forces = Some(Forces { course, aimed: now, stepped: now, there: None, still: None });
        self.begin_stream(stream, &moving, here, step);
    }

    /// Changes the target in mid-motion: the reference goes on from its present position, at its present speed.
    pub(super) fn aim_forces(&mut self, target: &Pose, motors: &[(usize, f64)], step: &mut SuperviseStep) {
        let rules = step.rules;
        let now = step.now;
        let Some(fields) = rules.fields.as_deref() else { return };
        let (Some(forces), Some(stream)) = (&mut self.motion.forces, &mut self.motion.stream) else { return };
        forces.course.aim(fields, target, motors);
        forces.aimed = now;
        forces.there = None;
        forces.still = None;
        let new: Vec<usize> = motors.iter().map(|(m, _)| *m).filter(|m| !stream.names(*m)).collect();
        let Some(StoredReading { q: here, .. }) = &self.newest else { return };
        stream.request(&new, mode(rules), &still(here, rules), (here, now), rules);
        self.switch_modes(&new, step);
    }

    /// Processes a reading during a motion under forces. The motion is done when the reference has arrived, enough
    /// time has passed for the robot to follow it, and the robot rests at the target: the reference alone proves
    /// nothing.
    pub(super) fn under_forces(&mut self, pulse: &Pulse, at_rest: bool, step: &mut SuperviseStep) {
        let rules = step.rules;
        let now = step.now;
        let sampled_at = pulse.sample.at;
        let q = &pulse.sample.q;
        let (Some(open), Some(fields)) = (&step.book.open, rules.fields.as_ref()) else { return };
        let target = open.target.clone();
        let due = open.motion.due();
        if self.is_stream_frozen(pulse) {
            return self.interrupt(Cause::Stale, Status::Holding(Hold::Stale), step);
        }
        let (Some(forces), Some(stream)) = (&mut self.motion.forces, &mut self.motion.stream) else { return };
        let elapsed = now.since(forces.stepped).as_secs_f64();
        let period = rules.period.as_secs_f64();
        // Readings may come more often than the period, or in a burst: the clock advances the reference.
        if elapsed >= 0.75 * period {
            forces.stepped = now;
            let push = pulse.push.as_deref().unwrap_or_default();
            forces.course.step(q, push, rules, elapsed.min(1.5 * period));
            step.book.ahead = Some(forces.course.q().into());
            step.book.history.note_setpoint(now, forces.course.q().into());
            let moving = forces.course.motors();
            let next = match mode(rules) {
                ControlMode::Velocity => forces.course.velocities(q),
                _ => forces.course.q().to_vec(),
            };
            stream.request(&moving, mode(rules), &next, (q, now), rules);
        }
        forces.there = if forces.course.is_there() { forces.there.or(Some(sampled_at)) } else { None };
        forces.still = if at_rest { forces.still.or(Some(sampled_at)) } else { None };
        // The robot follows the reference, a reaction time behind it.
        let arrived = forces.there.is_some_and(|since| sampled_at >= since + rules.reaction());
        let set_out = forces.aimed + rules.reaction();
        // Forces that balance elsewhere will go on doing so: the agent is notified after `patience`, not at the
        // motion's deadline.
        let still = forces.still.is_some_and(|since| sampled_at >= since.max(set_out) + fields.patience);
        self.write_stream(q, step);
        if arrived && at_rest && sampled_at >= set_out && distance(q, &target) <= rules.tolerance {
            let tracked = std::mem::take(&mut self.motion.tracked);
            self.motion = MotionState { tracked, ..MotionState::default() };
            self.done(pulse, step);
        } else if still || due.is_some_and(|due| sampled_at > due) {
            self.roll_back(Cause::TargetMissed, step);
        } else {
            self.advance_safe_pose(step);
        }
    }
}

/// Control mode of motors under forces: positions if the board accepts them as set-points, since their errors do not
/// accumulate.
fn mode(rules: &Rules) -> ControlMode {
    if rules.position_direct { ControlMode::PositionDirect } else { ControlMode::Velocity }
}

/// Set-points of a robot that stays at its configuration.
fn still(here: &Pose, rules: &Rules) -> Pose {
    match mode(rules) {
        ControlMode::Velocity => vec![0.0; here.len()].into(),
        _ => clamped(here, rules),
    }
}
