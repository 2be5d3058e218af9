//! Motions under forces (controllers of kind `fields`): each reading moves the reference on, which is written as a stream.
//!
//! ```text
//! Rest ──Commit──> Moving ──reference and robot rest at the target──> Rest        Committed
//!                    │ at rest elsewhere for `patience`: target missed            RolledBack
//!                    │ contact at any time: as any motion
//! ```

use super::streaming::Streaming;
use super::{SuperviseCore, SuperviseOut};
use crate::controller::{FieldRules, Rules, clamped, distance};
use crate::course::Course;
use crate::pulse::Pulse;
use mobee_contract::{Cause, ControlMode, Hold, Pose, Status, Time};

/// A motion under way.
#[derive(Clone, Debug)]
pub(super) struct Forces {
    course: Course,
    /// When it was given its target.
    aimed: Time,
    /// When the reference last moved on.
    stepped: Time,
    /// Since when the reference is at the target.
    there: Option<Time>,
    /// Since when the robot rests.
    still: Option<Time>,
}

impl SuperviseCore {
    /// The open transaction's motion begins: these motors go to the target, none faster than its cap, rad/s.
    pub(super) fn begin_forces(
        &mut self,
        fields: &FieldRules,
        (target, motors): (&Pose, &[(usize, f64)]),
        here: &Pose,
        now: Time,
        out: &mut Vec<SuperviseOut>,
    ) {
        let rules = self.rules.clone();
        let mut stream = Streaming::new(&rules, now);
        let start = clamped(here, &rules);
        let mut course = Course::new(&start);
        course.aim(fields, target, motors);
        let moving = course.motors();
        stream.ask(&moving, mode(&rules), &still(here, &rules), (here, now), &rules);
        self.with_book(|b| b.ahead = Some(start));
        self.forces = Some(Forces { course, aimed: now, stepped: now, there: None, still: None });
        self.begin_stream(stream, &moving, here, now, out);
    }

    /// The target changed in mid-motion.
    pub(super) fn aim_forces(
        &mut self,
        target: &Pose,
        motors: &[(usize, f64)],
        now: Time,
        out: &mut Vec<SuperviseOut>,
    ) {
        let Some(fields) = self.rules.fields.clone() else { return };
        let Some(forces) = &mut self.forces else { return };
        forces.course.aim(&fields, target, motors);
        (forces.aimed, forces.there, forces.still) = (now, None, None);
        let joins = |m: &usize| self.stream.as_ref().is_some_and(|s| !s.names(*m));
        let new: Vec<usize> = motors.iter().map(|(m, _)| *m).filter(joins).collect();
        let (Some(stream), Some(newest)) = (&mut self.stream, &self.newest) else { return };
        let (here, rules) = (&newest.q, &self.rules);
        stream.ask(&new, mode(rules), &still(here, rules), (here, now), rules);
        self.switch_modes(&new, out);
    }

    /// A reading during a motion under forces.
    pub(super) fn under_forces(&mut self, pulse: &Pulse, now: Time, at_rest: bool, out: &mut Vec<SuperviseOut>) {
        let (rules, at, q) = (self.rules.clone(), pulse.sample.at, &pulse.sample.q);
        let open = self.with_book(|b| b.open.as_ref().map(|o| (o.target.clone(), o.due)));
        let (Some((target, due)), Some(fields)) = (open, rules.fields.as_ref()) else { return };
        if self.is_stream_frozen(pulse) {
            return self.interrupt(Cause::Stale, Status::Holding(Hold::Stale), now, out);
        }
        let (Some(forces), Some(stream)) = (&mut self.forces, &mut self.stream) else { return };
        let (elapsed, period) = (now.since(forces.stepped).as_secs_f64(), rules.period.as_secs_f64());
        if elapsed >= 0.75 * period {
            forces.stepped = now;
            let push = pulse.push.as_deref().unwrap_or_default();
            forces.course.step(q, push, &rules, elapsed.min(1.5 * period));
            self.ledger.book().ahead = Some(forces.course.q().into());
            let moving = forces.course.motors();
            let next = match mode(&rules) {
                ControlMode::Velocity => forces.course.velocities(q),
                _ => forces.course.q().to_vec(),
            };
            stream.ask(&moving, mode(&rules), &next, (q, now), &rules);
        }
        forces.there = if forces.course.is_there() { forces.there.or(Some(at)) } else { None };
        forces.still = if at_rest { forces.still.or(Some(at)) } else { None };
        let arrived = forces.there.is_some_and(|since| at >= since + rules.reaction());
        let set_out = forces.aimed + rules.reaction();
        let still = forces.still.is_some_and(|since| at >= since.max(set_out) + fields.patience);
        self.write_stream(q, now, out);
        if arrived && at_rest && at >= set_out && distance(q, &target) <= rules.tolerance {
            (self.stream, self.forces) = (None, None);
            self.done(pulse, out);
        } else if still || due.is_some_and(|due| at > due) {
            self.roll_back(Cause::TargetMissed, now, out);
        } else {
            self.keep_in_history(out);
        }
    }
}

/// The mode in which motors are driven under forces.
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
