//! The state of an arm of servos, and its trajectory: pure, stepped by the time it is given.
//!
//! ```text
//! command ──checked──> Plant (the trajectory) ──every 10 ms──> goals, at most `lead_deg` ahead of the readings
//! lease   ──ends─────> the trajectory brakes to a rest, and the goals stay there
//! states  ──verified─> sample, or trouble with a name and a remedy
//! ```
//! While a servo is farther behind its goal than it should be, the trajectory's time runs slower for all joints: the path stays the
//! same, and a blocked motion pushes with no more than the lead. The lead counts from the offset at which a servo rested under its load.

mod arming;
mod faults;

use crate::joint::ServoJoint;
use crate::registers::ServoState;
use mobee_contract::{Axis, Command, ControlMode, Sample, Time};
use mobee_sim::{Plant, path::Profile};
use std::collections::VecDeque;
use std::time::Duration;

/// Readings over which a joint must rest: 0.1 s.
const REST_READINGS: usize = 11;
/// Counts by which the readings of a joint at rest may differ.
const REST_COUNTS: i32 = 2;
/// A motion is done no later than this after its trajectory has ended.
const MAX_SETTLING: Duration = Duration::from_secs(1);
/// The trajectory's time runs slower from this share of the lead on.
const FREE_LEAD: f64 = 0.6;
/// The trajectory moves on by no more periods at once: a late thread must not make a step.
const MAX_PERIODS: f64 = 2.0;
/// A joint that is behind by this share of its lead...
const BLOCKED_LEAD: f64 = 0.9;
/// ... for this long is blocked, ...
const BLOCKED_FOR: Duration = Duration::from_millis(100);
/// ... which is reported as this share of the torque of a contact.
const CONTACT_SHARE: f64 = 1.2;
/// A slower trajectory stands, rad/s: it can't be held up.
const STANDING: f64 = 1e-6;
/// A trajectory is held from so much of its own time on.
const HOLDS_AFTER: Duration = Duration::from_micros(1);
/// Below this rate of its time a trajectory is held up.
const HELD_UP: f64 = 0.5;
/// By how many degrees a joint may be away from `rest_deg` when it loses its torque.
const AT_REST_DEG: f64 = 3.0;
/// A servo or bus whose last answer is older than this is silent.
pub const SILENCE: Duration = Duration::from_millis(250);
/// The lease of the trajectory itself: the arm's lease is checked by the time of the run.
const UNBOUNDED: Duration = Duration::from_secs(1 << 30);

/// Numbers of the settings.
#[derive(Clone, Copy, Debug)]
pub struct CoreNumbers {
    /// Time between two readings.
    pub period: Duration,
    /// The lead, rad.
    pub lead: f64,
    /// By how much a joint may rest beside its goal, rad.
    pub hold_error: f64,
    /// Torque at full load, N m.
    pub torque: f64,
}

/// Stage of the connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConnectionStage {
    /// It is read only.
    Looking,
    /// Its goals follow the commands.
    Driving,
}

/// The arm.
pub struct ArmCore {
    joints: Vec<ServoJoint>,
    axes: Vec<Axis>,
    numbers: CoreNumbers,
    stage: ConnectionStage,
    plant: Plant,
    /// The trajectory's time, which runs no faster than the run's.
    path_time: Time,
    /// Its rate in the last period, 0 to 1.
    rate: f64,
    /// True if something held the last motion up: the offset at its rest is a contact's, not a weight's.
    held_up: bool,
    /// Time of the last relief of an overloaded servo.
    relieved: Option<Time>,
    ticked: Option<Time>,
    lease: Option<Time>,
    states: Vec<ServoState>,
    recent: Vec<VecDeque<i32>>,
    /// Goal less position at the last rest, rad.
    offsets: Vec<f64>,
    goals: Vec<i32>,
    /// Since when each joint has been behind by its lead, and the direction of its motion.
    blocked: Vec<Option<(Time, f64)>>,
    foreign_goals: Vec<u32>,
    /// Time at which the trajectory of each motor had ended.
    ended: Vec<Option<Time>>,
    fault: Option<(Time, String)>,
    /// True from a loss of torque or connection until the arm is armed again: the fault lasts as long.
    interrupted: bool,
    seq: u64,
    read_at: Option<Time>,
    unread: Option<Sample>,
}

impl ArmCore {
    /// An arm that has not been read yet.
    pub fn new(joints: Vec<ServoJoint>, axes: Vec<Axis>, numbers: CoreNumbers) -> ArmCore {
        let n = joints.len();
        ArmCore {
            plant: Plant::new(axes.clone(), &[], Profile::MinimumJerk),
            joints,
            axes,
            numbers,
            stage: ConnectionStage::Looking,
            path_time: Time::ZERO,
            rate: 1.0,
            held_up: false,
            relieved: None,
            ticked: None,
            lease: None,
            states: Vec::new(),
            recent: vec![VecDeque::with_capacity(REST_READINGS); n],
            offsets: vec![0.0; n],
            goals: Vec::new(),
            blocked: vec![None; n],
            foreign_goals: vec![0; n],
            ended: vec![None; n],
            fault: None,
            interrupted: false,
            seq: 0,
            read_at: None,
            unread: None,
        }
    }

    /// The servos.
    pub fn joints(&self) -> &[ServoJoint] {
        &self.joints
    }

    /// The stage of the connection.
    pub fn stage(&self) -> ConnectionStage {
        self.stage
    }

    /// True once it has been read.
    pub fn is_read(&self) -> bool {
        self.read_at.is_some()
    }

    /// Time of the last reading.
    pub fn read_at(&self) -> Option<Time> {
        self.read_at
    }

    /// The fault, with its remedy.
    pub fn fault(&self) -> Option<&str> {
        self.fault.as_ref().map(|(_, what)| what.as_str())
    }

    /// Control modes.
    pub fn modes(&self) -> Vec<ControlMode> {
        self.plant.modes()
    }

    /// The newest states.
    pub fn states(&self) -> &[ServoState] {
        &self.states
    }

    /// The newest sample, unless it was taken before.
    pub fn take_sample(&mut self) -> Option<Sample> {
        self.unread.take()
    }

    /// True if there is a sample that was not taken.
    pub fn has_sample(&self) -> bool {
        self.unread.is_some()
    }

    /// Lets the arm move until then.
    pub fn lease(&mut self, now: Time, until: Time) {
        self.expire(now);
        if until > now && self.stage == ConnectionStage::Driving {
            self.lease = Some(until);
            self.plant.lease(self.path_time, self.path_time + UNBOUNDED);
        } else {
            self.lease = None;
            self.brake();
        }
    }

    /// Gives a command.
    ///
    /// # Errors
    /// The reason of a refusal; nothing is changed then.
    pub fn command(&mut self, now: Time, command: &Command) -> Result<(), String> {
        self.expire(now);
        if self.stage == ConnectionStage::Looking {
            return Err("the servos have not been given torque".into());
        }
        if let Command::Stop { motors } = command {
            return self.stop(motors, command);
        }
        self.plant.command(self.path_time, command, Duration::ZERO)?;
        self.ended.fill(None);
        if matches!(command, Command::Move(_) | Command::Direct { .. } | Command::Velocity { .. }) {
            self.held_up = false;
        }
        Ok(())
    }

    /// A trajectory that was held up stops where it is: braking from a speed that no joint has would lead farther into what blocks it.
    fn stop(&mut self, motors: &[usize], command: &Command) -> Result<(), String> {
        let held_up = self.rate < HELD_UP;
        let concerned = |m: &usize| motors.is_empty() || motors.contains(m);
        let all: Vec<usize> = (0..self.axes.len()).filter(concerned).collect();
        if held_up {
            all.iter().for_each(|m| self.plant.hold(*m));
            // it is held from the next instant on
            self.path_time = self.path_time + HOLDS_AFTER;
        }
        let stopped = self.plant.command(self.path_time, command, Duration::ZERO);
        if held_up {
            all.iter().for_each(|m| self.plant.release(*m));
        }
        stopped
    }

    /// Brakes all motors.
    pub fn brake(&mut self) {
        // a stop of all motors is never refused
        let _ = self.stop(&[], &Command::Stop { motors: Vec::new() });
        if self.lease.is_none() {
            self.plant.lease(self.path_time, Time::ZERO);
        }
    }

    fn expire(&mut self, now: Time) {
        if self.lease.is_some_and(|until| until <= now) {
            self.lease = None;
            self.brake();
        }
    }

    /// One period has passed: the goals of all servos now, counts; none while the arm is only read.
    pub fn tick(&mut self, now: Time) -> Option<Vec<(u8, i32)>> {
        self.expire(now);
        if self.fault.is_some() {
            self.brake();
        }
        let since = self.ticked.replace(now).map_or(Duration::ZERO, |before| now.since(before));
        if self.stage == ConnectionStage::Looking {
            return None;
        }
        self.rate = self.allowed_rate(now);
        self.held_up |= self.rate < HELD_UP;
        let step = since.as_secs_f64().min(MAX_PERIODS * self.numbers.period.as_secs_f64());
        self.path_time = self.path_time + Duration::from_secs_f64(self.rate * step);
        self.plant.advance(self.path_time);
        // one that brakes while it is held up would never end
        if self.rate < HELD_UP && (self.lease.is_none() || self.fault.is_some()) {
            self.brake();
        }
        for (slot, moves) in self.ended.iter_mut().zip(self.plant.done().iter().map(|done| !done)) {
            *slot = if moves { None } else { slot.or(Some(now)) };
        }
        self.goals = self.joints.iter().zip(self.plant.positions()).map(|(joint, q)| joint.count(q)).collect();
        Some(self.joints.iter().zip(&self.goals).map(|(joint, goal)| (joint.id, *goal)).collect())
    }

    /// Rate at which the trajectory may go on, 0 to 1: by the joint that is farthest behind, in the direction of its motion.
    fn allowed_rate(&mut self, now: Time) -> f64 {
        let commanded = self.plant.positions().zip(self.plant.speeds());
        let joints = self.joints.iter().zip(&self.states).zip(&self.offsets).zip(commanded).zip(&mut self.blocked);
        let mut worst = 0.0f64;
        for ((((joint, state), offset), (q, v)), blocked) in joints {
            let mut share = 0.0;
            if v.abs() >= STANDING {
                let measured = joint.angle(f64::from(state.position));
                // an offset that helps the motion takes nothing off the lead
                let against = (offset * v.signum()).max(0.0);
                share = ((q - measured) * v.signum() - against) / self.numbers.lead;
            }
            worst = worst.max(share);
            *blocked = match share >= BLOCKED_LEAD {
                true => Some(blocked.map_or((now, v.signum()), |(since, _)| (since, v.signum()))),
                false => None,
            };
        }
        ((1.0 - worst) / (1.0 - FREE_LEAD)).clamp(0.0, 1.0)
    }

    /// The states of all servos, in the order of the joints, as they were no earlier than `at`.
    pub fn take_states(&mut self, at: Time, states: Vec<ServoState>) {
        if states.len() != self.joints.len() || self.read_at.is_some_and(|before| at <= before) {
            return;
        }
        self.states = states;
        self.read_at = Some(at);
        for (recent, state) in self.recent.iter_mut().zip(&self.states) {
            if recent.len() == REST_READINGS {
                recent.pop_front();
            }
            recent.push_back(state.position);
        }
        self.judge(at);
        self.learn_offsets();
        self.seq += 1;
        let q: Vec<f64> = self.joints.iter().zip(&self.states).map(|(j, s)| j.angle(f64::from(s.position))).collect();
        self.unread = Some(Sample {
            seq: self.seq,
            at,
            q: q.into(),
            done: self.done(at),
            external: self.external(at),
            ..Sample::default()
        });
    }

    /// A reading was lost.
    pub fn lose_reading(&mut self) {
        self.seq += 1;
    }

    fn done(&self, at: Time) -> Vec<bool> {
        let rests = self.recent.iter().map(rests);
        if self.stage == ConnectionStage::Looking {
            return rests.collect();
        }
        let settled = |ended: &Option<Time>| ended.is_some_and(|ended| at.since(ended) > MAX_SETTLING);
        let each = self.plant.done().into_iter().zip(rests).zip(&self.ended);
        each.map(|((done, rests), ended)| done && (rests || settled(ended))).collect()
    }

    /// The torque with which something pushes each joint: that of its servo, reversed, weight included. A joint that is blocked reports a
    /// contact: the lead keeps its servo from pushing as hard.
    fn external(&self, at: Time) -> Vec<f64> {
        let joints = self.joints.iter().zip(&self.states).zip(&self.axes).zip(&self.blocked);
        let torques = joints.map(|(((joint, state), axis), blocked)| {
            let torque = -f64::from(state.load) * 1e-3 * self.numbers.torque;
            let torque = if joint.inverted { -torque } else { torque };
            match blocked {
                Some((since, direction)) if at.since(*since) >= BLOCKED_FOR => {
                    -direction * torque.abs().max(CONTACT_SHARE * axis.contact_effort)
                }
                _ => torque,
            }
        });
        torques.collect()
    }

    /// By how much each joint rests beside its goal.
    fn learn_offsets(&mut self) {
        if self.stage == ConnectionStage::Looking || self.plant.moves() || self.held_up {
            return;
        }
        let most = self.numbers.hold_error;
        let commanded: Vec<f64> = self.plant.positions().collect();
        let each = self.joints.iter().zip(&self.states).zip(&self.recent).zip(commanded).zip(&mut self.offsets);
        for ((((joint, state), recent), q), offset) in each {
            if recent.len() == REST_READINGS && rests(recent) {
                *offset = (q - joint.angle(f64::from(state.position))).clamp(-most, most);
            }
        }
    }

    /// A trajectory at rest there.
    fn rest_at(&mut self, q: &[f64]) {
        self.plant = Plant::new(self.axes.clone(), q, Profile::MinimumJerk);
        self.path_time = Time::ZERO;
        self.rate = 1.0;
        self.ended.fill(None);
    }

    /// True if no joint moves.
    pub fn is_at_rest(&self) -> bool {
        !self.plant.moves() && self.recent.iter().all(rests)
    }

    /// True if every joint is near this rest configuration, deg.
    pub fn is_at(&self, rest_deg: &[f64]) -> bool {
        let near = |((joint, state), rest): ((&ServoJoint, &ServoState), &f64)| {
            (joint.angle(f64::from(state.position)).to_degrees() - rest).abs() <= AT_REST_DEG
        };
        rest_deg.len() == self.states.len() && self.joints.iter().zip(&self.states).zip(rest_deg).all(near)
    }
}

/// True if these readings are those of a joint at rest.
fn rests(recent: &VecDeque<i32>) -> bool {
    let (least, most) = (recent.iter().min(), recent.iter().max());
    matches!((least, most), (Some(least), Some(most)) if most - least <= REST_COUNTS)
}

#[cfg(test)]
mod tests;
