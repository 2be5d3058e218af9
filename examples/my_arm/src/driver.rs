//! The driver `my_arm`: joints behind a bus that takes goal positions and returns measured ones.
//!
//! ```text
//! Command, lease ──> Plant (moves, brakes, limits) ──goals──> Bus ──measured──> Sample
//! ```
//! `Plant` turns commands into goal positions: it moves within limits of position, speed and acceleration, brakes at a stop, and moves
//! nothing without a lease. Replace [`Loopback`] by your hardware; `tests/conformance.rs` checks every promise of a driver.

use mobee_contract::{
    Axis, Board, Command, Context, ControlMode, Driver, DriverFault, Hardware, Kind, KindError, Known, Registered,
    Sample, Time, settings,
};
use mobee_sim::{Plant, path::Profile};
use schemars::JsonSchema;
use serde::Deserialize;
use serde_json::{Value, json};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// The wire to the motors.
pub trait Bus: Send {
    /// Writes the goal position of every motor and reads the measured ones, rad. Returns within a millisecond: a slower bus belongs on a
    /// thread of its own, as `examples/13_write_your_own_driver.rs` of MoBeE shows.
    ///
    /// # Errors
    /// [`DriverFault::Lost`] without an answer, [`DriverFault::Hardware`] for a fault that the motors report.
    fn exchange(&mut self, goals: &[f64]) -> Result<Vec<f64>, DriverFault>;
}

/// Motors that are where they are sent.
pub struct Loopback;

impl Bus for Loopback {
    fn exchange(&mut self, goals: &[f64]) -> Result<Vec<f64>, DriverFault> {
        Ok(goals.to_vec())
    }
}

/// Its settings in the behavior file. `kinds my_arm` prints these comments.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ArmSettings {
    /// Readings per second, 10 to 1000.
    pub rate_hz: f64,
    /// Maximum speed of every motor, deg/s.
    pub max_speed_deg_s: f64,
    /// Maximum acceleration of every motor, deg/s^2.
    pub max_acceleration_deg_s2: f64,
}

impl Default for ArmSettings {
    fn default() -> ArmSettings {
        ArmSettings { rate_hz: 100.0, max_speed_deg_s: 60.0, max_acceleration_deg_s2: 200.0 }
    }
}

/// The hardware. It outlives its drivers: after a crash of the driver actor a new driver connects to the same motors.
pub struct Arm {
    facts: Board,
    state: Arc<Mutex<State>>,
}

struct State {
    plant: Plant,
    bus: Box<dyn Bus>,
    /// Number of the next reading.
    next: u64,
}

impl Arm {
    /// An arm at rest at `start`, rad.
    pub fn new(axes: Vec<Axis>, start: &[f64], rate_hz: f64, bus: Box<dyn Bus>) -> Arm {
        let plant = Plant::new(axes.clone(), start, Profile::Trapezoidal);
        let period = Duration::from_secs_f64(1.0 / rate_hz.clamp(10.0, 1000.0));
        let facts = Board { axes, period, latency: period, position_direct: true };
        Arm { facts, state: Arc::new(Mutex::new(State { plant, bus, next: 0 })) }
    }
}

impl Hardware for Arm {
    fn connect(&self) -> Result<Box<dyn Driver>, DriverFault> {
        Ok(Box::new(ArmDriver { facts: self.facts.clone(), state: self.state.clone() }))
    }

    // true because the loopback has no clock of its own; false for real motors
    fn runs_in_virtual_time(&self) -> bool {
        true
    }

    fn known(&self) -> Known {
        Known { start: None, period: Some(self.facts.period), motors: None }
    }
}

/// A connection to the arm.
struct ArmDriver {
    facts: Board,
    state: Arc<Mutex<State>>,
}

impl ArmDriver {
    fn state(&self) -> MutexGuard<'_, State> {
        // a panic elsewhere leaves a state that is valid
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn time_of(&self, reading: u64) -> Time {
        Time((self.facts.period.as_nanos() as u64).saturating_mul(reading))
    }
}

impl Driver for ArmDriver {
    fn board(&self) -> &Board {
        &self.facts
    }

    fn command(&mut self, now: Time, command: &Command) -> Result<(), DriverFault> {
        self.state().plant.command(now, command, Duration::ZERO).map_err(DriverFault::Refused)
    }

    fn sample(&mut self, now: Time) -> Result<Option<Sample>, DriverFault> {
        let mut state = self.state();
        let State { plant, bus, next } = &mut *state;
        let seq = now.0 / (self.facts.period.as_nanos() as u64).max(1);
        plant.advance(now);
        if seq < *next {
            return Ok(None);
        }
        let goals: Vec<f64> = plant.positions().collect();
        let measured = bus.exchange(&goals)?;
        *next = seq + 1;
        Ok(Some(Sample { seq, at: now, q: measured.into(), done: plant.done(), ..Sample::default() }))
    }

    fn next_sample(&self, now: Time) -> Time {
        let next = self.state().next;
        self.time_of(next).max(now)
    }

    fn lease(&mut self, now: Time, until: Time) {
        self.state().plant.lease(now, until);
    }

    fn modes(&self) -> Vec<ControlMode> {
        self.state().plant.modes()
    }
}

fn build(value: &Value, context: &Context) -> Result<Arc<dyn Hardware>, KindError> {
    let s: ArmSettings = settings(value)?;
    if !(10.0..=1000.0).contains(&s.rate_hz) {
        return Err(KindError::new(
            "rate_hz",
            format!("{} readings per second are not possible", s.rate_hz),
            "give 10 to 1000",
        ));
    }
    let limits = [("max_speed_deg_s", s.max_speed_deg_s), ("max_acceleration_deg_s2", s.max_acceleration_deg_s2)];
    for (key, limit) in limits {
        if !(limit > 0.0 && limit.is_finite()) {
            return Err(KindError::new(key, format!("{limit} is not a limit"), "give a number above 0"));
        }
    }
    let axes = context.robot.motors.iter().map(|m| Axis {
        name: m.name.clone(),
        min: m.min,
        max: m.max,
        max_speed: m.limit_speed(s.max_speed_deg_s.to_radians()),
        max_acceleration: s.max_acceleration_deg_s2.to_radians(),
        motion: m.motion,
        ..Axis::default()
    });
    let start: Vec<f64> = context.robot.motors.iter().map(|m| m.home).collect();
    Ok(Arc::new(Arm::new(axes.collect(), &start, s.rate_hz, Box::new(Loopback))))
}

inventory::submit! {
    Registered(&Kind::<dyn Hardware> {
        name: "my_arm",
        doc: "Joints behind a bus that takes goal positions and returns measured ones.",
        schema: || schemars::schema_for!(ArmSettings),
        example: |_| Ok(json!({})),
        build,
    })
}
