//! Hardware of a simulated robot, shared by all its drivers: board, arm and encoders, and their present
//! faults.

use super::body::ArmBody;
use super::dynamics::{DoneRule, EffortReport};
use super::encoders::Encoders;
use super::faults::{Active, Fault, Garbage};
use super::plant::Plant;
use mobee_contract::{Command, DriverFault, Sample, Time};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Distance within which a board with the rule `arrived` counts a joint as arrived, rad.
const ARRIVED: f64 = 0.5 * std::f64::consts::PI / 180.0;

/// Speed above which a joint moves, rad/s.
const MOVES: f64 = 1.0 * std::f64::consts::PI / 180.0;

/// Hardware of one simulated robot, shared by all its drivers.
#[derive(Debug)]
pub struct SharedPlant {
    /// Board, which shapes the commanded positions.
    pub plant: Plant,
    /// Arm that follows them; `None` for kinematic joints.
    pub arm: Option<Box<dyn ArmBody>>,
    pub done: DoneRule,
    /// Kind of torque that its board reports.
    pub reports: Option<EffortReport>,
    pub encoders: Encoders,
    pub latency: Duration,
    /// Newest reading, until it is fetched.
    pub unread: Option<Sample>,
    /// Reading fetched last.
    pub fetched: Option<Sample>,
    pub faults: Vec<Active>,
    pub faults_made: u64,
}

/// Locks the hardware. A poisoned lock is used anyway, because hardware is intact when a program
/// crashed while holding it.
pub fn lock(board: &Mutex<SharedPlant>) -> MutexGuard<'_, SharedPlant> {
    board.lock().unwrap_or_else(PoisonError::into_inner)
}

impl SharedPlant {
    /// Advances to `now`, reading the encoders when due.
    pub fn advance(&mut self, now: Time) {
        if let Some((seq, at)) = self.encoders.take(now) {
            self.pass(at);
            let q = match &self.arm {
                Some(arm) => self.encoders.read(arm.positions().into_iter()),
                None => self.encoders.read(self.plant.positions()),
            };
            let contact_n = self.arm.as_mut().map_or(0.0, |arm| arm.pushes().read());
            let at = self.plant.now();
            let done = self.done();
            let external = self.external();
            let mut sample = Sample { seq, at, q, done, external, contact_n };
            self.falsify(&mut sample);
            self.unread = Some(sample);
        }
        let since = self.plant.now();
        self.pass(now);
        self.sag(since, now);
        self.hold(now);
        if self.on(now).any(|f| matches!(f.fault, Fault::Hardware { .. })) && self.plant.moves() {
            self.plant.brake_all();
        }
    }

    /// Advances board and arm to `to`.
    fn pass(&mut self, to: Time) {
        if let Some(arm) = &mut self.arm {
            while arm.clock().next() <= to {
                if self.plant.is_idle() && arm.clock().is_settled(&self.plant.positions().collect::<Vec<_>>()) {
                    arm.clock().skip(to);
                    break;
                }
                self.plant.advance(arm.clock().next());
                arm.step(&self.plant.states().collect::<Vec<_>>());
                self.plant.measure(arm.positions().into_iter());
            }
        }
        self.plant.advance(to);
    }

    /// Positions of the joints, rad.
    pub fn positions(&self) -> Vec<f64> {
        match &self.arm {
            Some(arm) => arm.positions(),
            None => self.plant.positions().collect(),
        }
    }

    /// True per motor that its board reports as done.
    pub fn done(&self) -> Vec<bool> {
        let mut done = self.plant.done();
        if let (Some(arm), DoneRule::Arrived) = (&self.arm, self.done) {
            let off = arm.positions().into_iter().zip(self.plant.positions()).map(|(q, c)| (q - c).abs());
            done.iter_mut().zip(off).for_each(|(done, off)| *done &= off < ARRIVED);
        }
        done
    }

    /// External torque per motor as its board reports it, N m (N for prismatic joints); empty for kinematic
    /// joints.
    fn external(&self) -> Vec<f64> {
        match (&self.arm, self.reports) {
            (Some(arm), Some(EffortReport::External)) => arm.external(),
            // the servo opposes a push
            (Some(arm), Some(EffortReport::Load)) => arm.efforts().into_iter().map(|effort| -effort).collect(),
            _ => Vec::new(),
        }
    }

    /// Motors that a stop is sent to, if a stop holds the measured position: those that move, or are
    /// commanded to. A motor that rests under its weight would sink with each stop. `None` passes the command
    /// on unchanged.
    pub fn motors_to_stop(&self, command: &Command) -> Option<Vec<usize>> {
        let (Command::Stop { motors }, Some(arm), true) = (command, &self.arm, self.plant.stop_holds_measured()) else {
            return None;
        };
        let moves = |(m, (done, speed)): (usize, (bool, f64))| {
            let named = motors.is_empty() || motors.contains(&m);
            (named && (!done || speed.abs() > MOVES)).then_some(m)
        };
        Some(self.plant.done().into_iter().zip(arm.speeds()).enumerate().filter_map(moves).collect())
    }

    fn sag(&mut self, since: Time, now: Time) {
        let secs = now.since(since).as_secs_f64();
        for f in self.faults.iter().filter(|f| f.is_on(now)) {
            if let Fault::Sag { motor, speed } = f.fault {
                self.plant.push(motor, speed * secs);
            }
        }
    }

    /// Blocks motors with a fault once they have moved for long enough, and unblocks them at its end.
    fn hold(&mut self, now: Time) {
        let mut wanted = Vec::new();
        for f in self.faults.iter_mut().filter(|f| f.is_on(now)) {
            if let Fault::Blocked { motor, after } = f.fault {
                wanted.push(motor);
                let moves = self.plant.speeds().nth(motor).is_some_and(|v| v != 0.0);
                f.moving = f.moving.filter(|_| moves).or(moves.then_some(now));
                if f.moving.is_some_and(|since| now.since(since) >= after) {
                    self.plant.hold(motor);
                }
            }
        }
        let over = |(m, held): (usize, Option<(Time, f64)>)| held.filter(|_| !wanted.contains(&m)).map(|_| m);
        let over: Vec<usize> = self.plant.held().into_iter().enumerate().filter_map(over).collect();
        over.into_iter().for_each(|m| self.plant.release(m));
    }

    /// Faults active now.
    pub fn on(&self, now: Time) -> impl Iterator<Item = &Active> {
        self.faults.iter().filter(move |f| f.is_on(now))
    }

    /// Fails if a fault prevents the board from answering.
    pub fn trouble(&self, now: Time) -> Result<(), DriverFault> {
        if self.on(now).any(|f| f.fault == Fault::Lost) {
            return Err(DriverFault::Lost);
        }
        if let Some(report) = self.arm.as_ref().and_then(|arm| arm.trouble()) {
            return Err(DriverFault::Hardware(report));
        }
        let report = |f: &Active| if let Fault::Hardware { report } = &f.fault { Some(report.clone()) } else { None };
        self.on(now).find_map(report).map_or(Ok(()), |r| Err(DriverFault::Hardware(r)))
    }

    /// Applies encoder faults to a reading.
    fn falsify(&mut self, sample: &mut Sample) {
        if self.faults.is_empty() {
            return;
        }
        let truth = sample.q.clone();
        let mut q = truth.to_vec();
        let moves = self.plant.moves();
        for f in self.faults.iter_mut().filter(|f| f.is_on(sample.at)) {
            match &f.fault {
                Fault::Frozen { motor } => {
                    let held = f.held.get_or_insert_with(|| truth.clone());
                    for (m, (slot, old)) in q.iter_mut().zip(held.iter()).enumerate() {
                        if motor.is_none_or(|only| only == m) {
                            *slot = *old;
                        }
                    }
                }
                Fault::FrozenInMotion { after } => {
                    f.moving = f.moving.filter(|_| moves).or(moves.then_some(sample.at));
                    if f.held.is_none() && f.moving.is_some_and(|since| sample.at.since(since) >= *after) {
                        f.held = Some(truth.clone());
                    }
                    if let Some(held) = &f.held {
                        q.clone_from_slice(held);
                    }
                }
                Fault::Offset { motor, by } => {
                    if let Some(slot) = q.get_mut(*motor) {
                        *slot += by;
                    }
                }
                Fault::Noise { sigma } => {
                    for slot in &mut q {
                        *slot = self.encoders.disturb(*slot, *sigma);
                    }
                }
                Fault::Garbage(Garbage::NotANumber) => q.iter_mut().take(1).for_each(|slot| *slot = f64::NAN),
                Fault::Garbage(Garbage::Infinite) => q.iter_mut().take(1).for_each(|slot| *slot = f64::INFINITY),
                Fault::Garbage(Garbage::Short) => drop(q.pop()),
                Fault::Garbage(Garbage::Long) => q.push(0.0),
                Fault::Lost
                | Fault::Silent
                | Fault::Slow { .. }
                | Fault::Gappy { .. }
                | Fault::Repeated
                | Fault::Sag { .. }
                | Fault::Blocked { .. }
                | Fault::Hardware { .. } => {}
            }
        }
        sample.q = q.into();
    }
}
