//! The simulated board and its motors: a state machine that advances with the times passed in.
//!
//! ```text
//! command ──checked──> in flight ──latency──> takes effect ──> a new path per motor
//! lease ───────────────────────────────────────ends──────────> every motor brakes
//! ```
//! Between such events every motor follows a path in closed form, so a plant without commands costs nothing,
//! and an hour passes in one step.

mod check;
mod motor;

use super::dynamics::{BoardRules, StopRule};
use crate::sim::path::{Bounds, Profile, State};
use check::PlantCommand;
use mobee_contract::{Axis, Command, ControlMode, Time};
use motor::PlantMotor;
use std::collections::VecDeque;
use std::time::Duration;

/// Largest number of commands in flight; more are refused.
const MOST_IN_FLIGHT: usize = 1024;

/// A simulated board with its motors. Pure: time comes in with every call and never runs backwards.
#[derive(Clone, Debug)]
pub struct Plant {
    axes: Vec<Axis>,
    motors: Vec<PlantMotor>,
    profile: Profile,
    now: Time,
    /// Lease, until it has expired.
    lease: Option<Time>,
    /// Accepted commands with the times at which they take effect, in that order.
    in_flight: VecDeque<(Time, PlantCommand)>,
    /// Differences from a kinematic board.
    rules: BoardRules,
    /// Measured positions of the joints that follow the commanded positions, rad; empty for kinematic joints.
    measured: Vec<f64>,
}

impl Plant {
    /// Creates a plant at rest at `start` (rad, one per axis; axes without one start at the middle of their
    /// range).
    ///
    /// The initial reference speed is a tenth of the greatest, the initial reference acceleration the
    /// greatest. All motors start in [`ControlMode::Position`] and without a lease.
    pub fn new(axes: Vec<Axis>, start: &[f64], profile: Profile) -> Plant {
        let starts = start.iter().copied().map(Some).chain(std::iter::repeat(None));
        let motors = axes
            .iter()
            .zip(starts)
            .map(|(axis, q)| {
                PlantMotor::at_rest(q.unwrap_or(0.5 * (axis.min + axis.max)).clamp(axis.min, axis.max), axis)
            })
            .collect();
        Plant {
            axes,
            motors,
            profile,
            now: Time::ZERO,
            lease: None,
            in_flight: VecDeque::new(),
            rules: BoardRules::default(),
            measured: Vec::new(),
        }
    }

    /// Replaces the rules of the board.
    pub(super) fn with_rules(self, rules: BoardRules) -> Plant {
        Plant { rules, ..self }
    }

    /// True if a stop makes the measured position the commanded one.
    pub(super) fn stop_holds_measured(&self) -> bool {
        self.rules.stop == StopRule::Measured
    }

    /// Sets the measured positions of the joints, rad.
    pub(super) fn measure(&mut self, q: impl Iterator<Item = f64>) {
        self.measured.clear();
        self.measured.extend(q);
    }

    /// True if its commanded positions stay constant until the next command.
    pub(super) fn is_idle(&self) -> bool {
        self.in_flight.is_empty() && !self.moves()
    }

    /// Commanded position and speed of every motor.
    pub(super) fn states(&self) -> impl Iterator<Item = State> + '_ {
        self.motors.iter().map(|m| m.state(self.now))
    }

    /// Newest time passed in.
    pub fn now(&self) -> Time {
        self.now
    }

    /// Limits of its motors.
    pub fn axes(&self) -> &[Axis] {
        &self.axes
    }

    /// Advances to `now`. An earlier time changes nothing.
    pub fn advance(&mut self, now: Time) {
        let now = now.max(self.now);
        loop {
            let effect = self.in_flight.front().map(|(at, _)| *at).filter(|at| *at <= now);
            let expiry = self.lease.filter(|until| *until <= now);
            match (effect, expiry) {
                // a command that takes effect at the very end of the lease is too late
                (effect, Some(until)) if effect.is_none_or(|at| until <= at) => {
                    self.lease = None;
                    self.brake(until);
                }
                (Some(at), _) => {
                    if let Some((_, command)) = self.in_flight.pop_front() {
                        self.take_effect(at, command);
                    }
                }
                (None, _) => break,
            }
        }
        self.now = now;
    }

    /// Sets the lease, which replaces any earlier one, even if that lasted longer.
    pub fn lease(&mut self, now: Time, until: Time) {
        self.advance(now);
        if until > self.now {
            self.lease = Some(until);
        } else {
            self.lease = None;
            self.brake(self.now);
        }
    }

    /// True if it may move now.
    pub fn is_leased(&self) -> bool {
        self.lease.is_some()
    }

    /// Accepts a command that takes effect `latency` later, and not before earlier commands.
    ///
    /// # Errors
    /// The part that does not fit, naming the motor; nothing is changed then.
    pub fn command(&mut self, now: Time, command: &Command, latency: Duration) -> Result<(), String> {
        self.advance(now);
        if self.in_flight.len() >= MOST_IN_FLIGHT {
            return Err(format!("{MOST_IN_FLIGHT} commands are on their way already"));
        }
        let checked = check::check(self, command)?;
        if checked.moves() && !self.is_leased() {
            return Err("there is no lease to move under".into());
        }
        let after = self.in_flight.back().map_or(Time::ZERO, |(at, _)| *at);
        self.in_flight.push_back(((self.now + latency).max(after), checked));
        // without latency it takes effect at once
        self.advance(now);
        Ok(())
    }

    /// Brakes all motors now; commands in flight are not affected.
    pub fn brake_all(&mut self) {
        self.brake(self.now);
    }

    /// Displaces a motor at rest, within its limits; no-op while any motor moves.
    pub fn push(&mut self, motor: usize, by: f64) {
        if !self.moves()
            && let (Some(motor), Some(axis)) = (self.motors.get_mut(motor), self.axes.get(motor))
        {
            motor.push(self.now, by, axis);
        }
    }

    /// Blocks a moving motor at its position, in its direction of motion. No-op for a motor at rest.
    pub fn hold(&mut self, motor: usize) {
        if let Some(motor) = self.motors.get_mut(motor).filter(|m| m.state(self.now).v != 0.0) {
            motor.hold(self.now);
        }
    }

    /// Unblocks a motor.
    pub fn release(&mut self, motor: usize) {
        if let (Some(motor), Some(axis)) = (self.motors.get_mut(motor), self.axes.get(motor)) {
            motor.release(self.now, self.profile, greatest(axis));
        }
    }

    /// Per motor, if it is blocked: the time since when, and the distance to the position that its board
    /// commands, rad.
    pub fn held(&self) -> Vec<Option<(Time, f64)>> {
        self.motors.iter().map(|m| m.held(self.now)).collect()
    }

    /// True if any motor moves.
    pub fn moves(&self) -> bool {
        self.motors.iter().any(|m| !m.rests(self.now))
    }

    /// Position of every motor, rad.
    pub fn positions(&self) -> impl Iterator<Item = f64> + '_ {
        self.motors.iter().map(|m| m.state(self.now).q)
    }

    /// Speed of every motor, rad/s.
    pub fn speeds(&self) -> impl Iterator<Item = f64> + '_ {
        self.motors.iter().map(|m| m.state(self.now).v)
    }

    /// True per motor that reports done, unless a command in flight will move it.
    pub fn done(&self) -> Vec<bool> {
        let mut done: Vec<bool> = self.motors.iter().map(|m| m.is_done(self.now)).collect();
        for (_, command) in &self.in_flight {
            for m in command.disturbs() {
                if let Some(d) = done.get_mut(m) {
                    *d = false;
                }
            }
        }
        done
    }

    /// Control mode of every motor.
    pub fn modes(&self) -> Vec<ControlMode> {
        self.motors.iter().map(|m| m.mode).collect()
    }

    fn brake(&mut self, at: Time) {
        for (m, axis) in self.motors.iter_mut().zip(&self.axes) {
            m.brake(at, greatest(axis));
        }
    }

    fn take_effect(&mut self, at: Time, command: PlantCommand) {
        let leased = self.is_leased();
        let profile = self.profile;
        let rules = self.rules;
        // for a stop that holds the measured positions
        let held: Vec<f64> =
            if rules.stop == StopRule::Measured { std::mem::take(&mut self.measured) } else { Vec::new() };
        let mut with = |m: usize, act: &mut dyn FnMut(&mut PlantMotor, &Axis)| {
            if let (Some(motor), Some(axis)) = (self.motors.get_mut(m), self.axes.get(m)) {
                act(motor, axis);
            }
        };
        match command {
            PlantCommand::Move(ways) => {
                for way in ways {
                    with(way.motor, &mut |motor, axis| {
                        motor.refer(way.speed, way.acceleration.filter(|_| !rules.ignores_acceleration), axis);
                        if leased {
                            motor.go(at, way.to, profile, greatest(axis));
                        }
                    });
                }
            }
            PlantCommand::Direct(each) if leased => {
                for (m, to) in each {
                    with(m, &mut |motor, axis| motor.set_point(at, to, axis));
                }
            }
            PlantCommand::Velocity(speeds) if leased => {
                for (m, v) in speeds {
                    with(m, &mut |motor, axis| motor.run(at, v, axis));
                }
            }
            PlantCommand::Direct(_) | PlantCommand::Velocity(_) => {}
            PlantCommand::Stop(motors) => {
                for m in motors {
                    with(m, &mut |motor, axis| match held.get(m) {
                        Some(q) => motor.hold_at(at, *q),
                        None => motor.brake(at, greatest(axis)),
                    });
                }
            }
            PlantCommand::Reference(references) => {
                for (m, speed, acceleration) in references {
                    let acceleration = Some(acceleration).filter(|_| !rules.ignores_acceleration);
                    with(m, &mut |motor, axis| motor.refer(Some(speed), acceleration, axis));
                }
            }
            PlantCommand::Mode(motors, mode) => {
                for m in motors {
                    with(m, &mut |motor, axis| motor.switch(at, mode, greatest(axis)));
                }
            }
        }
        if !held.is_empty() {
            self.measured = held;
        }
    }
}

/// Bounds of an axis.
fn greatest(axis: &Axis) -> Bounds {
    Bounds { speed: axis.max_speed, acceleration: axis.max_acceleration }
}
