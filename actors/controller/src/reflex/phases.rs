//! The phases of a retreat. Each phase decides from one reading which transition follows; the reflex performs it.
//!
//! A phase checks the conditions that forbid going on before those that complete it: a robot that arrives in contact
//! has not arrived.

use super::floors::ClearanceFloors;
use super::retreat::{GroupBroken, Retreat};
use super::yielding::{RetreatYield, YieldDecision, another};
use super::{
    AfterStop, FROZEN_TIME, FROZEN_TRAVEL, FrozenEncoderWatch, Names, ReflexOut, ReflexReport, ReflexStep, RetreatJob,
};
use crate::Rules;
use crate::pulse::Pulse;
use crate::stop::Stop;
use mobee_contract::{Event, Hold, Time, distance};
use mobee_model::Contact;
use std::time::Duration;

/// Time within which the robot must come to rest, follow its set-points, or arrive at its end. Long beside the
/// braking time, so that only a robot that does not obey times out.
const PHASE_TIMEOUT: Duration = Duration::from_secs(3);

/// Time after the effect of a stop from which a robot that still creeps counts as held.
const CREEP_TIME: Duration = Duration::from_millis(200);
/// Greatest speed of creeping, rad/s.
const MAX_CREEP_SPEED: f64 = 5.0 * std::f64::consts::PI / 180.0;

/// Phase of the reflex. All phases but the first hold the token under which the filter was closed. If the gate has
/// another token, another component acts, and the reflex returns to watching.
#[derive(Clone, Debug)]
pub(super) enum ReflexPhase {
    /// The filter is open, or was closed for a reason that needs no retreat.
    Watching,
    /// The robot was stopped, and the reflex waits until it rests.
    Stopping(StoppingPhase),
    /// The robot is on its retreat path.
    Retreating(RetreatingPhase),
    /// The last set-point was written, and the robot arrives.
    Settling(SettlingPhase),
}

impl ReflexPhase {
    /// Token under which the filter was closed. `None` while watching.
    pub fn token(&self) -> Option<u64> {
        match self {
            ReflexPhase::Watching => None,
            ReflexPhase::Stopping(phase) => Some(phase.token),
            ReflexPhase::Retreating(phase) => Some(phase.token),
            ReflexPhase::Settling(phase) => Some(phase.token),
        }
    }

    /// Returns whether the robot is on its retreat path, or arrives at its end.
    pub fn is_on_path(&self) -> bool {
        matches!(self, ReflexPhase::Retreating(_) | ReflexPhase::Settling(_))
    }
}

/// Transition that follows from a reading.
#[derive(Debug)]
pub(super) enum Transition {
    /// The phase goes on.
    Stay,
    /// The robot rests, or is held by an obstacle: its retreat is requested.
    RequestRetreat,
    /// The robot rests: this report is sent to Supervise.
    Report(ReflexReport),
    /// The robot did not come to rest in time. It is stopped again before this report.
    StopAgain(ReflexReport),
    /// The last set-point was written.
    Settle(Box<SettlingPhase>),
    /// The robot rests at its safe pose.
    Arrive,
    /// The retreat group has changed: the robot stops and requests another path.
    LeaveGroup(RetreatJob),
    /// The retreat is aborted for this reason, described by the text.
    Abort(Hold, String),
}

/// A reading in a phase with a closed filter.
pub(super) struct PhaseReading<'a> {
    /// Index of the robot.
    pub robot: usize,
    /// The reading. `pulse.sample.at` dates what it shows; the time of the step spaces the commands.
    pub pulse: &'a Pulse,
    /// Pairs near the robot; those with other robots at a common instant.
    pub near: &'a [Contact],
    /// Pairs checked against the floors, at their present distances.
    pub close: &'a [Contact],
    /// Foreseen contacts that the retreat must avoid.
    pub ahead: &'a [Contact],
    /// True if the robot rests.
    pub at_rest: bool,
}

impl PhaseReading<'_> {
    /// Time of the reading.
    pub fn sampled_at(&self) -> Time {
        self.pulse.sample.at
    }
}

/// The robot was stopped, and the reflex waits until it rests.
#[derive(Clone, Debug)]
pub(super) struct StoppingPhase {
    pub token: u64,
    /// Time of the stop.
    pub since: Time,
    /// Action once the robot rests.
    pub then: AfterStop,
}

impl StoppingPhase {
    /// Waits for rest, and sends a stop again that the robot has not heeded.
    pub fn step(
        &self,
        reading: &PhaseReading,
        stop: &mut Stop,
        floors: &mut ClearanceFloors,
        step: &mut ReflexStep,
    ) -> Transition {
        let rules = step.rules;
        let sampled_at = reading.sampled_at();
        debug_assert!(self.since <= step.now, "a stop is dated by the clock");
        // The robot moves deeper into the contact while it brakes. The retreat path leads through there again, so the
        // floors include these distances.
        floors.note(reading.near);
        if stop.is_ignored(reading.pulse, rules, step.now) {
            step.stop(self.token);
        }
        // An earlier reading at rest may be from before the stop took effect.
        let effective = sampled_at >= self.since + rules.reaction();
        let rests = effective && (reading.at_rest || self.is_held(reading.pulse, rules));
        // A robot that pushes something must not brake into it: set-points at its present configuration take the load
        // off at once.
        let takes_load_off = self.pushes(rules) && sampled_at > self.since;
        if takes_load_off || rests {
            return match &self.then {
                AfterStop::Retreat(_) => Transition::RequestRetreat,
                AfterStop::Report(report) => Transition::Report(report.clone()),
            };
        }
        if sampled_at >= self.since + PHASE_TIMEOUT {
            // Nothing is reported before the robot rests (I17). A retreat that has not begun is aborted: the robot may
            // have left its recorded path long ago.
            return match &self.then {
                AfterStop::Report(report) => Transition::StopAgain(report.clone()),
                AfterStop::Retreat(_) => {
                    Transition::Abort(Hold::RetreatMissed, "the robot did not come to rest in time".into())
                }
            };
        }
        if let AfterStop::Retreat(_) = self.then {
            step.joint_retreat.announce(reading.robot, step.now);
        }
        Transition::Stay
    }

    /// Returns whether the robot pushes against something that its first retreat can leave at once.
    fn pushes(&self, rules: &Rules) -> bool {
        let AfterStop::Retreat(job) = &self.then else { return false };
        job.motion.pressed && rules.gives() && rules.position_direct && !job.again
    }

    /// Returns whether an obstacle holds the robot, whose retreat begins all the same.
    fn is_held(&self, pulse: &Pulse, rules: &Rules) -> bool {
        matches!(self.then, AfterStop::Retreat(_)) && is_held(pulse, self.since, rules)
    }
}

/// The robot is on its retreat path.
#[derive(Clone, Debug)]
pub(super) struct RetreatingPhase {
    pub token: u64,
    pub retreat: Retreat,
    pub job: RetreatJob,
    /// True if a constraint was violated as the retreat began.
    pub violated: bool,
    pub frozen_watch: FrozenEncoderWatch,
    pub yielding: RetreatYield,
}

impl RetreatingPhase {
    /// Drives the retreat by one reading: the next set-point, a wait, the end of the path, or an abort.
    pub fn step(&mut self, reading: &PhaseReading, floors: &mut ClearanceFloors, step: &mut ReflexStep) -> Transition {
        let PhaseReading { pulse, .. } = reading;
        let rules = step.rules;
        self.update_frozen_watch(pulse);
        // A robot that pushes something still brakes: as before, the floors include these distances.
        if self.retreat.brakes() {
            floors.note(reading.near);
        }
        let met = floors.broken(reading.close, rules);
        let broken = met.or_else(|| floors.broken(reading.ahead, rules)).copied();
        let foreseen = met.is_none();
        // A constraint that was violated as the retreat began is left by the retreat itself.
        let newly_violated = pulse.violated.is_some() && !self.violated;
        let rests = reading.at_rest && self.retreat.is_at_setpoint(&pulse.sample, rules);
        let state = (foreseen, rests);
        let decision = self.yielding.decide(broken.as_ref(), state, reading.robot, step.joint_retreat, step.now);
        // A board that plans between way-points goes on by itself, so waiting means stopping.
        let stops =
            decision == YieldDecision::Blocked || (decision == YieldDecision::StartWait && !self.retreat.path().direct);
        if self.encoders_are_frozen(reading.sampled_at()) {
            return Transition::Abort(Hold::Stale, "the encoders do not follow the set-points".into());
        }
        if stops || newly_violated {
            return Transition::Abort(Hold::RetreatBlocked, blocked(broken, pulse.violated.is_some(), step.names));
        }
        if self.retreat.lag_time(step.now) >= PHASE_TIMEOUT {
            return Transition::Abort(Hold::RetreatMissed, "the robot does not follow the set-points".into());
        }
        report_wait(decision, &self.yielding, reading, broken, step);
        self.write_set_point(decision, pulse, step)
    }

    /// Writes the next set-point, or halts on the path while the robot waits. The phase settles behind the last one.
    fn write_set_point(&mut self, decision: YieldDecision, pulse: &Pulse, step: &mut ReflexStep) -> Transition {
        let command = match decision {
            YieldDecision::StartWait | YieldDecision::StillWaiting => {
                self.retreat.halt(step.joint_retreat, &pulse.sample, step.now, step.rules)
            }
            _ => self.retreat.step(step.joint_retreat, &pulse.sample, step.now, step.rules),
        };
        match command {
            Ok(command) => step.out.extend(command.map(|c| ReflexOut::Command(self.token, c))),
            Err(GroupBroken) => return Transition::LeaveGroup(self.job.clone()),
        }
        if !self.retreat.is_over() {
            return Transition::Stay;
        }
        Transition::Settle(Box::new(SettlingPhase {
            token: self.token,
            since: self.retreat.arrival(step.now),
            retreat: self.retreat.clone(),
            job: self.job.clone(),
            violated: self.violated,
            yielding: self.yielding,
        }))
    }

    /// Begins the watch anew when a reading differs from the one before. On the first segment, joints that are hooked
    /// to an obstacle stand still.
    fn update_frozen_watch(&mut self, pulse: &Pulse) {
        if self.frozen_watch.unchanged != pulse.unchanged || self.retreat.takes_load_off() {
            let written = self.retreat.written().to_vec();
            self.frozen_watch = FrozenEncoderWatch { unchanged: pulse.unchanged, written, sampled_at: pulse.sample.at };
        }
    }

    /// Returns whether the readings are equal although the set-points have moved: during a recorded rest, equal
    /// readings are normal.
    fn encoders_are_frozen(&self, sampled_at: Time) -> bool {
        let long = sampled_at.since(self.frozen_watch.sampled_at) >= FROZEN_TIME;
        long && distance(self.retreat.written(), &self.frozen_watch.written) > FROZEN_TRAVEL
    }
}

/// The last set-point was written, and the robot arrives.
#[derive(Clone, Debug)]
pub(super) struct SettlingPhase {
    pub token: u64,
    /// Time at which the robot should arrive, or the end of its last wait.
    pub since: Time,
    pub retreat: Retreat,
    pub job: RetreatJob,
    /// True if a constraint was violated as the retreat began.
    pub violated: bool,
    pub yielding: RetreatYield,
}

impl SettlingPhase {
    /// Waits until the robot rests at the end of its path, and until its retreat group is there.
    pub fn step(&mut self, reading: &PhaseReading, floors: &ClearanceFloors, step: &mut ReflexStep) -> Transition {
        let PhaseReading { robot, pulse, at_rest, .. } = *reading;
        let rules = step.rules;
        let sampled_at = reading.sampled_at();
        if step.joint_retreat.must_replan(robot, step.now) {
            return Transition::LeaveGroup(self.job.clone());
        }
        let broken = floors.broken(reading.close, rules).copied();
        // The robot stays at its end. As on the path, it waits for another robot that drives into it there.
        let decision = self.yielding.decide(broken.as_ref(), (false, at_rest), robot, step.joint_retreat, step.now);
        let newly_violated = pulse.violated.is_some() && !self.violated;
        if decision == YieldDecision::Blocked || newly_violated {
            return Transition::Abort(Hold::RetreatBlocked, blocked(broken, pulse.violated.is_some(), step.names));
        }
        if decision != YieldDecision::Proceed {
            report_wait(decision, &self.yielding, reading, broken, step);
            self.since = step.now;
            return Transition::Stay;
        }
        let near_end = distance(&pulse.sample.q, &self.retreat.path().end.q) <= rules.tolerance;
        if sampled_at >= self.since + rules.reaction() && at_rest && near_end {
            return self.arrive(reading, step);
        }
        if sampled_at >= self.since + PHASE_TIMEOUT {
            return Transition::Abort(Hold::RetreatMissed, "the safe pose was not reached in time".into());
        }
        if at_rest {
            // The robot rests beside its end: the last set-point may have been lost as the lease expired.
            let command = self.retreat.resend(&pulse.sample, step.now, rules);
            step.out.extend(command.map(|c| ReflexOut::Command(self.token, c)));
        }
        Transition::Stay
    }

    /// Ends the phase of a robot that rests at the end of its path.
    fn arrive(&self, reading: &PhaseReading, step: &ReflexStep) -> Transition {
        // The retreat ended before this robot's safe pose because another robot blocks the rest of the path.
        if self.retreat.path().blocked {
            let what = "another robot blocks the path and can't retreat farther";
            return Transition::Abort(Hold::RetreatBlocked, what.into());
        }
        // Readmitted alone, the robot would soon block those that are still retreating.
        if !step.joint_retreat.is_over(reading.robot, step.now) {
            return Transition::Stay;
        }
        // The other robots were elsewhere as this retreat set out. If one of them waits for this robot now, all are
        // replanned, through the distances that they have passed.
        if !self.job.again && blocks_waiting_robot(reading, step) {
            return Transition::LeaveGroup(self.job.clone());
        }
        Transition::Arrive
    }
}

/// Returns true for an arm that presses against an obstacle and creeps along it instead of coming to rest. Its
/// retreat begins from this low speed and takes the load off.
fn is_held(pulse: &Pulse, stopped: Time, rules: &Rules) -> bool {
    rules.gives() && pulse.speed < MAX_CREEP_SPEED && pulse.sample.at >= stopped + rules.reaction() + CREEP_TIME
}

/// Publishes that a retreat starts to wait or goes on, and updates the joint retreat for the robots that this one may
/// block.
fn report_wait(
    decision: YieldDecision,
    yielding: &RetreatYield,
    reading: &PhaseReading,
    met: Option<Contact>,
    step: &mut ReflexStep,
) {
    match decision {
        YieldDecision::StartWait => {
            let what = blocked(met, false, step.names);
            step.emit(Event::RetreatWaits { robot: step.robot(), what, seen: reading.sampled_at() });
        }
        YieldDecision::Resume => step.emit(Event::RetreatGoesOn { robot: step.robot() }),
        YieldDecision::StillWaiting => {}
        YieldDecision::Proceed | YieldDecision::Blocked => return,
    }
    step.joint_retreat.set_waiting(reading.robot, yielding.waits());
}

/// Returns whether the robot touches one whose own retreat waits for it: the group is replanned then.
fn blocks_waiting_robot(reading: &PhaseReading, step: &ReflexStep) -> bool {
    let touches = reading.close.iter().filter(|c| c.distance < step.rules.margin);
    let mut others = touches.filter_map(|c| another(c, reading.robot));
    others.any(|other| step.joint_retreat.blocks_waiting_robot(reading.robot, other))
}

/// Describes the obstruction of a retreat: this contact, or without one, a constraint, or a robot that does not halt.
fn blocked(contact: Option<Contact>, violated: bool, names: &Names) -> String {
    let Some(c) = contact else {
        let what = if violated { "a constraint would be violated" } else { "the robot does not rest at its set-point" };
        return what.into();
    };
    let (a, b) = names(c.pair);
    format!("{a} and {b} are at {:.1} mm", c.distance * 1e3)
}

#[cfg(test)]
mod tests;
