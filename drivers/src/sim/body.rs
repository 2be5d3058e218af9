//! The seam between a simulated board and the arm that follows it: this crate's own dynamics, or a physics engine of another crate.

use super::dynamics::{ArmPhysics, Dynamics, Servo};
use super::path::State;
use mobee_contract::{KindError, Time};
use mobee_model::Robot;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt::Debug;
use std::sync::Arc;
use std::time::Duration;

/// The joints of an arm as bodies that follow commanded positions, in steps of a fixed length from time zero on.
///
/// Positions and speeds are those of the motors, in rad of encoder; torques are N m, forces (of motors that slide) N.
pub trait ArmBody: Debug + Send {
    /// Puts it among things: it has weight from now on, and touches them. It rests where it is.
    ///
    /// # Errors
    /// A scene or settings that the engine can't simulate.
    fn set_physics(&mut self, physics: ArmPhysics) -> Result<(), KindError>;

    /// Its steps so far.
    fn clock(&mut self) -> &mut StepClock;

    /// One step, with the board's commanded states at its end.
    fn step(&mut self, commanded: &[State]);

    /// Position of every motor, rad.
    fn positions(&self) -> Vec<f64>;

    /// Speed of every motor, rad/s.
    fn speeds(&self) -> Vec<f64>;

    /// Torque of every servo.
    fn efforts(&self) -> Vec<f64>;

    /// Torque of weight that is not compensated and of contacts on every motor.
    fn external(&self) -> Vec<f64>;

    /// How it has pushed things so far.
    fn pushes(&mut self) -> &mut Pushes;

    /// Why its state can't be computed any longer, if it can't.
    fn trouble(&self) -> Option<String> {
        None
    }
}

/// The steps of an arm: of one length, from time zero on, whoever reads the arm when.
#[derive(Clone, Debug)]
pub struct StepClock {
    length: Duration,
    steps: u64,
    /// The commanded positions of the last step.
    commanded: Vec<f64>,
    /// Whether the arm rests where it was sent, so that nothing changes until something else is commanded.
    rests: bool,
}

impl StepClock {
    /// An arm at rest at `start`, rad, at time zero, which the first step shows to rest.
    pub fn new(length: Duration, start: &[f64]) -> StepClock {
        StepClock { length, steps: 0, commanded: start.to_vec(), rests: false }
    }

    /// The time of the next step.
    pub fn next(&self) -> Time {
        Time::ZERO + self.length.saturating_mul(u32::try_from(self.steps + 1).unwrap_or(u32::MAX))
    }

    /// How many steps there were.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Whether the arm rested in the last step.
    pub fn rests(&self) -> bool {
        self.rests
    }

    /// Whether nothing changes as long as the commanded positions are these.
    pub fn is_settled(&self, commanded: &[f64]) -> bool {
        self.rests && self.commanded == commanded
    }

    /// Passes over the time up to `now`, in which nothing changed.
    pub fn skip(&mut self, now: Time) {
        self.steps = self.steps.max(now.0 / u64::try_from(self.length.as_nanos()).unwrap_or(u64::MAX));
    }

    /// Counts a step under these commanded states, in which the joints were `still`.
    pub fn step(&mut self, commanded: &[State], still: bool) {
        let as_before =
            commanded.iter().zip(&self.commanded).all(|(state, before)| state.q == *before && state.v == 0.0);
        self.rests = still && as_before;
        self.commanded.clear();
        self.commanded.extend(commanded.iter().map(|state| state.q));
        self.steps += 1;
    }

    /// Something else has changed than what is commanded.
    pub fn wake(&mut self) {
        self.rests = false;
    }
}

/// The forces with which an arm pushes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pushes {
    /// The greatest so far, N.
    pub greatest: f64,
    /// For how long it has been pushing something without a pause.
    pub pressing: Duration,
    /// The greatest since the last reading, N.
    unread: f64,
}

impl Pushes {
    /// Takes in a step of this length, in which the greatest force was this, N.
    pub fn note(&mut self, force: f64, step: Duration) {
        self.greatest = self.greatest.max(force);
        self.unread = self.unread.max(force);
        self.pressing = if force > 0.0 { self.pressing + step } else { Duration::ZERO };
    }

    /// The greatest since this was called last, N.
    pub fn read(&mut self) -> f64 {
        std::mem::take(&mut self.unread)
    }
}

/// What an engine gets to make an arm of.
#[derive(Clone, Debug)]
pub struct ArmParts {
    /// The robot.
    pub robot: Arc<Robot>,
    /// The servo of each motor.
    pub servos: Vec<Servo>,
    /// Where it rests at first, rad.
    pub start: Vec<f64>,
    /// Mass of all links that move, kg.
    pub mass: f64,
}

/// A physics engine of another crate. Register it with `inventory::submit!`.
pub struct PhysicsEngine {
    /// Its name in settings.
    pub physics: Physics,
    /// Makes an arm, which has neither weight nor contacts until [`ArmBody::set_physics`].
    /// Errors: a robot that it can't simulate.
    pub make: fn(ArmParts) -> Result<Box<dyn ArmBody>, KindError>,
    /// Keys of `servo` that it does not use, each with what it takes instead.
    pub unused: &'static [(&'static str, &'static str)],
}

inventory::collect!(PhysicsEngine);

/// The physics that moves a simulated arm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Physics {
    /// The simulation's own joints of second order: fast, without coupled inertia.
    #[default]
    Builtin,
    /// MuJoCo: rigid bodies with coupled inertia and friction in contact. Needs a program built with the feature `mujoco`.
    Mujoco,
}

impl Physics {
    /// Its engine; `None`: it needs none of another crate.
    ///
    /// # Errors
    /// If this program was built without it.
    pub fn engine(self) -> Result<Option<&'static PhysicsEngine>, KindError> {
        if self == Physics::Builtin {
            return Ok(None);
        }
        inventory::iter::<PhysicsEngine>.into_iter().find(|engine| engine.physics == self).map(Some).ok_or_else(|| {
            let what = "this program was built without MuJoCo";
            let help = "build it with --features mujoco (docs/simulation.md), or leave `physics` out";
            KindError::new("physics", what, help)
        })
    }
}

/// An arm of this engine, or of the simulation's own.
///
/// # Errors
/// A robot that the engine can't simulate.
pub fn body(engine: Option<&PhysicsEngine>, parts: ArmParts) -> Result<Box<dyn ArmBody>, KindError> {
    match engine {
        Some(engine) => (engine.make)(parts),
        None => Ok(Box::new(Dynamics::new(parts.servos, &parts.start))),
    }
}
