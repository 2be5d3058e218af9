//! Interface between a simulated board and the arm that follows it: this crate's own dynamics, or a physics
//! engine of another crate.

use super::dynamics::{ArmPhysics, Dynamics, Servo};
use super::path::State;
use mobee_contract::{KindError, Time};
use mobee_model::Robot;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt::Debug;
use std::sync::Arc;
use std::time::Duration;

/// The joints of an arm as bodies that follow commanded positions, in steps of a fixed length from time zero
/// on.
///
/// Positions and speeds are those of the motors, in rad of encoder; torques are N m, forces (of motors that slide) N.
pub trait ArmBody: Debug + Send {
    /// Places the arm in a scene: from now on it has weight and touches objects. It rests where it is.
    ///
    /// # Errors
    /// A scene or settings that the engine can't simulate.
    fn set_physics(&mut self, physics: ArmPhysics) -> Result<(), KindError>;

    /// Step counter.
    fn clock(&mut self) -> &mut StepClock;

    /// Performs one step, given the board's commanded states at its end.
    fn step(&mut self, commanded: &[State]);

    /// Position of every motor, rad.
    fn positions(&self) -> Vec<f64>;

    /// Speed of every motor, rad/s.
    fn speeds(&self) -> Vec<f64>;

    /// Torque of every servo.
    fn efforts(&self) -> Vec<f64>;

    /// Torque on every motor by uncompensated weight and by contacts.
    fn external(&self) -> Vec<f64>;

    /// Forces exerted on objects so far.
    fn pushes(&mut self) -> &mut Pushes;

    /// Reason why its state can't be computed any longer, if any.
    fn trouble(&self) -> Option<String> {
        None
    }
}

/// Step counter of an arm. Steps have one length and start at time zero, independent of when the arm is read.
#[derive(Clone, Debug)]
pub struct StepClock {
    length: Duration,
    steps: u64,
    /// Commanded positions of the last step.
    commanded: Vec<f64>,
    /// True if the arm rests at its commanded position, so that nothing changes until the command changes.
    rests: bool,
}

impl StepClock {
    /// Creates the clock of an arm at rest at `start`, rad, at time zero; the first step confirms the rest.
    pub fn new(length: Duration, start: &[f64]) -> StepClock {
        StepClock { length, steps: 0, commanded: start.to_vec(), rests: false }
    }

    /// Time of the next step.
    pub fn next(&self) -> Time {
        Time::ZERO + self.length.saturating_mul(u32::try_from(self.steps + 1).unwrap_or(u32::MAX))
    }

    /// Number of steps so far.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// True if the arm rested in the last step.
    pub fn rests(&self) -> bool {
        self.rests
    }

    /// True if nothing changes as long as these positions are commanded.
    pub fn is_settled(&self, commanded: &[f64]) -> bool {
        self.rests && self.commanded == commanded
    }

    /// Skips the time up to `now`, in which nothing changed.
    pub fn skip(&mut self, now: Time) {
        self.steps = self.steps.max(now.0 / u64::try_from(self.length.as_nanos()).unwrap_or(u64::MAX));
    }

    /// Counts a step under these commanded states. `still` is true if the joints did not move.
    pub fn step(&mut self, commanded: &[State], still: bool) {
        let as_before =
            commanded.iter().zip(&self.commanded).all(|(state, before)| state.q == *before && state.v == 0.0);
        self.rests = still && as_before;
        self.commanded.clear();
        self.commanded.extend(commanded.iter().map(|state| state.q));
        self.steps += 1;
    }

    /// Ends the rest because something other than the command has changed.
    pub fn wake(&mut self) {
        self.rests = false;
    }
}

/// Forces that an arm exerts.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pushes {
    /// Greatest force so far, N.
    pub greatest: f64,
    /// Duration of the present uninterrupted push.
    pub pressing: Duration,
    /// Greatest force since the last reading, N.
    unread: f64,
}

impl Pushes {
    /// Adds a step of this length, with its greatest force, N.
    pub fn note(&mut self, force: f64, step: Duration) {
        self.greatest = self.greatest.max(force);
        self.unread = self.unread.max(force);
        self.pressing = if force > 0.0 { self.pressing + step } else { Duration::ZERO };
    }

    /// Greatest force since the last call, N.
    pub fn read(&mut self) -> f64 {
        std::mem::take(&mut self.unread)
    }
}

/// Input of an engine that builds an arm.
#[derive(Clone, Debug)]
pub struct ArmParts {
    /// The robot.
    pub robot: Arc<Robot>,
    /// Servo of each motor.
    pub servos: Vec<Servo>,
    /// Initial configuration, rad.
    pub start: Vec<f64>,
    /// Mass of all moving links, kg.
    pub mass: f64,
}

/// A physics engine of another crate. Register it with `inventory::submit!`.
pub struct PhysicsEngine {
    /// Its name in settings.
    pub physics: Physics,
    /// Builds an arm, which has neither weight nor contacts until [`ArmBody::set_physics`]. Fails for a robot
    /// that it can't simulate.
    pub make: fn(ArmParts) -> Result<Box<dyn ArmBody>, KindError>,
    /// Keys of `servo` that it does not use, each with the quantity it uses instead.
    pub unused: &'static [(&'static str, &'static str)],
}

inventory::collect!(PhysicsEngine);

/// Physics that moves a simulated arm.
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
    /// Its engine; `None` for the built-in physics.
    ///
    /// # Errors
    /// This program was built without the engine.
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

/// Builds an arm with this engine, or with the built-in physics.
///
/// # Errors
/// A robot that the engine can't simulate.
pub fn body(engine: Option<&PhysicsEngine>, parts: ArmParts) -> Result<Box<dyn ArmBody>, KindError> {
    match engine {
        Some(engine) => (engine.make)(parts),
        None => Ok(Box::new(Dynamics::new(parts.servos, &parts.start))),
    }
}
