//! The simulated robot as hardware: one board that outlives its drivers, and the drivers themselves.

mod body;
mod braking;
mod dynamics;
mod encoders;
mod faults;
pub mod path;
mod plant;
mod settings;
mod shared;

pub use body::{ArmBody, ArmParts, Physics, PhysicsEngine, Pushes, StepClock};
pub use braking::{StoppingPath, stopping_path};
pub use dynamics::{ArmPhysics, ArmProfile, DoneRule, Servo, ServoSettings, StopRule};
pub use faults::{Fault, FaultId, Garbage, SimFaults};
pub use plant::Plant;
pub use settings::{Imitated, SimSettings, UnknownBox};

use encoders::Encoders;
use mobee_contract as contract;
use mobee_contract::{
    Axis, Command, Context, ControlMode, Driver, DriverFault, Hardware, Kind, KindError, Known, Registered, Sample,
    SetPose, Time,
};
use mobee_model::{Object, Scene, SceneError};
use serde_json::Value;
use shared::{SharedPlant, lock};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// The name of this kind in configuration files.
pub const SIM: &str = "sim";

inventory::submit! {
    Registered(&Kind::<dyn Hardware> {
        name: SIM,
        doc: "A simulated robot inside the program. It behaves like a YARP control board: position moves of one, some or all motors with \
              reference speeds and accelerations, relative moves, stop, motion-done, limits, control modes and position-direct set-points. Motions keep to \
              speed and acceleration limits, braking takes time, commands arrive late, and the encoders have a rate, a resolution, noise and jitter. \
              It stops by itself when its lease expires.",
        schema: || schemars::schema_for!(SimSettings),
        example: |_| Ok(serde_json::json!({})),
        build: |settings, context| Ok(Arc::new(SimHardware::build(settings, context)?)),
    })
}

/// Damping of a contact over its stiffness, s.
const CONTACT_DAMPING_S: f64 = 0.01;

/// A simulated robot, which outlives its drivers; see [`Hardware`].
#[derive(Clone, Debug)]
pub struct SimHardware {
    board: Arc<Mutex<SharedPlant>>,
    facts: contract::Board,
    start: Option<Vec<f64>>,
    imitates: Option<Imitated>,
    settings: Arc<SimSettings>,
}

impl SimHardware {
    /// Builds the hardware from the settings in a config file.
    ///
    /// # Errors
    /// The first setting that can't be used.
    pub fn build(settings: &Value, context: &Context) -> Result<SimHardware, KindError> {
        let settings: SimSettings = contract::settings(settings)?;
        SimHardware::new(&settings, context)
    }

    /// Builds a simulation of the context's robot, at rest at the start configuration of the settings.
    ///
    /// # Errors
    /// The first setting that can't be used.
    pub fn new(settings: &SimSettings, context: &Context) -> Result<SimHardware, KindError> {
        settings.validate()?;
        let settings = &settings.for_robot(&context.robot);
        let start = settings.start(&context.robot)?;
        let hardware = SimHardware::with_axes(settings.axes(&context.robot), &start, settings, context.seed);
        if let Some(numbers) = settings.arm() {
            let servo = settings.servo.clone().unwrap_or_default();
            servo.fits(&context.robot)?;
            let rules = servo.rules(&numbers);
            let mut board = lock(&hardware.board);
            let plant = Plant::new(settings.axes(&context.robot), &start, settings.move_profile());
            board.plant = plant.with_rules(rules);
            let servos = servo.servos(&numbers, &context.robot);
            let [mass, ..] = servo.body(&numbers);
            let parts = ArmParts { robot: context.robot.clone(), servos, start: start.clone(), mass };
            board.arm = Some(body::body(settings.physics.engine()?, parts)?);
            board.reports = Some(numbers.reports);
            board.done = rules.done;
        }
        Ok(SimHardware { start: Some(start).filter(|_| !settings.start_deg.is_empty()), ..hardware })
    }

    /// Builds a simulation of motors without a robot model, whose joints are kinematic. The limits of `axes`
    /// apply, not those of the settings, which are not validated.
    pub fn with_axes(axes: Vec<Axis>, start: &[f64], settings: &SimSettings, seed: u64) -> SimHardware {
        // a profile in the settings determines the accuracy of the encoders only
        let profile = settings.profile.or(Some(ArmProfile::Ideal));
        let settings = &SimSettings { profile, ..settings.clone() };
        let facts = contract::Board {
            axes: axes.clone(),
            period: settings.period(),
            latency: settings.latency(),
            position_direct: true,
        };
        let board = SharedPlant {
            plant: Plant::new(axes, start, settings.move_profile()),
            arm: None,
            done: DoneRule::Trajectory,
            reports: None,
            encoders: Encoders::new(settings, seed),
            latency: settings.latency(),
            unread: None,
            fetched: None,
            faults: Vec::new(),
            faults_made: 0,
        };
        SimHardware {
            board: Arc::new(Mutex::new(board)),
            facts,
            start: None,
            imitates: settings.imitates,
            settings: Arc::new(settings.clone()),
        }
    }

    /// Real robot that it imitates.
    pub fn imitates(&self) -> Option<Imitated> {
        self.imitates
    }

    /// Its motors, with their limits.
    pub fn axes(&self) -> &[Axis] {
        &self.facts.axes
    }

    /// Handle for planning faults.
    pub fn faults(&self) -> SimFaults {
        SimFaults { board: self.board.clone() }
    }

    /// True positions of the motors, independent of the encoders, rad; for tests that compare.
    pub fn positions(&self, now: Time) -> Vec<f64> {
        let mut board = lock(&self.board);
        board.advance(now);
        board.positions()
    }

    /// True speeds of the motors, rad/s.
    pub fn speeds(&self, now: Time) -> Vec<f64> {
        let mut board = lock(&self.board);
        board.advance(now);
        match &board.arm {
            Some(arm) => arm.speeds(),
            None => board.plant.speeds().collect(),
        }
    }

    /// Torques of the servos, N m (N for prismatic joints); `None` for kinematic joints.
    pub fn efforts(&self, now: Time) -> Option<Vec<f64>> {
        let mut board = lock(&self.board);
        board.advance(now);
        board.arm.as_ref().map(|arm| arm.efforts())
    }

    /// Greatest force with which the arm has pushed anything so far, N, and the duration of the present push.
    pub fn pushed(&self, now: Time) -> (f64, Duration) {
        let mut board = lock(&self.board);
        board.advance(now);
        board.arm.as_mut().map_or((0.0, Duration::ZERO), |arm| {
            let pushes = arm.pushes();
            (pushes.greatest, pushes.pressing)
        })
    }

    /// Per motor, if something blocks it ([`Fault::Blocked`]): the time since when, and the distance to the
    /// position that its board commands, rad.
    pub fn held(&self, now: Time) -> Vec<Option<(Time, f64)>> {
        let mut board = lock(&self.board);
        board.advance(now);
        board.plant.held()
    }

    /// True per motor that reports done (because it rests, or imitates a robot that reports this earlier) if
    /// no command in transit will move it.
    pub fn done(&self, now: Time) -> Vec<bool> {
        let mut board = lock(&self.board);
        board.advance(now);
        board.done()
    }
}

impl Hardware for SimHardware {
    fn connect(&self) -> Result<Box<dyn Driver>, DriverFault> {
        let board = lock(&self.board);
        // a planned loss ends by the passing of time, of which connecting knows nothing: the driver reports
        // it
        if board.faults.iter().any(|f| f.fault == Fault::Lost && f.is_open()) {
            return Err(DriverFault::Lost);
        }
        Ok(Box::new(SimDriver { board: self.board.clone(), facts: self.facts.clone() }))
    }

    fn runs_in_virtual_time(&self) -> bool {
        true
    }

    fn place(&self, scene: &Scene, robot: usize) -> Result<(), KindError> {
        let Some(numbers) = self.settings.arm() else { return Ok(()) };
        let unknown: Vec<Object> = self.settings.unknown.iter().map(UnknownBox::object).collect();
        let wrong = |e: SceneError| KindError::new("unknown", e.to_string(), "give it a name of its own");
        let Some(scene) = ArmPhysics::scene_of(scene, robot, &unknown).map_err(wrong)? else { return Ok(()) };
        let [mass, felt, stiffness] = self.settings.servo.clone().unwrap_or_default().body(&numbers);
        // contacts dissipate most of their energy in one cycle
        let damping = CONTACT_DAMPING_S * stiffness;
        if let Some(arm) = &mut lock(&self.board).arm {
            arm.set_physics(ArmPhysics { scene, mass, felt, stiffness, damping })?;
        }
        Ok(())
    }

    fn known(&self) -> Known {
        let start = |q: &Vec<f64>| SetPose { path: "start_deg".into(), q: q.clone(), optional: false };
        Known { start: self.start.as_ref().map(start), period: Some(self.facts.period), motors: None }
    }
}

/// Connection to a simulated robot.
#[derive(Debug)]
pub struct SimDriver {
    board: Arc<Mutex<SharedPlant>>,
    facts: contract::Board,
}

impl Driver for SimDriver {
    fn board(&self) -> &contract::Board {
        &self.facts
    }

    fn command(&mut self, now: Time, command: &Command) -> Result<(), DriverFault> {
        let mut board = lock(&self.board);
        board.advance(now);
        board.trouble(now)?;
        let extra: Duration =
            board.on(now).filter_map(|f| if let Fault::Slow { extra } = f.fault { Some(extra) } else { None }).sum();
        let latency = board.latency + extra;
        let moving = board.motors_to_stop(command);
        let command = match &moving {
            Some(motors) if motors.is_empty() => return Ok(()),
            Some(motors) => &Command::Stop { motors: motors.clone() },
            None => command,
        };
        board.plant.command(now, command, latency).map_err(DriverFault::Refused)
    }

    fn sample(&mut self, now: Time) -> Result<Option<Sample>, DriverFault> {
        let mut board = lock(&self.board);
        board.advance(now);
        board.trouble(now)?;
        if board.on(now).any(|f| f.fault == Fault::Silent) {
            return Ok(None);
        }
        let gaps = board.on(now).find_map(|f| if let Fault::Gappy { of } = f.fault { Some(of) } else { None });
        let repeated = board.on(now).any(|f| f.fault == Fault::Repeated);
        let fresh = board.unread.take().filter(|s| gaps.is_none_or(|of| s.seq % of.max(1) == 0));
        let second = std::mem::replace(&mut board.fetched, fresh.clone()).filter(|_| repeated);
        Ok(fresh.or(second))
    }

    fn next_sample(&self, now: Time) -> Time {
        let board = lock(&self.board);
        // an unread reading is available at once, unless a fault withholds it
        let withheld = board.on(now).any(|f| f.withholds());
        let due = board.encoders.due();
        if board.unread.is_some() && !withheld { now } else { due.max(now) }
    }

    fn lease(&mut self, now: Time, until: Time) {
        let mut board = lock(&self.board);
        board.advance(now);
        if board.trouble(now).is_ok() {
            board.plant.lease(now, until);
        }
    }

    fn modes(&self) -> Vec<ControlMode> {
        lock(&self.board).plant.modes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_at_the_board_leaves_it_alive() {
        let axis =
            Axis { name: "a".into(), min: -1.0, max: 1.0, max_speed: 1.0, max_acceleration: 1.0, ..Default::default() };
        let hardware = SimHardware::with_axes(vec![axis], &[0.5], &SimSettings::default(), 1);
        let board = hardware.board.clone();
        let crash = std::thread::spawn(move || {
            let _held = lock(&board);
            panic!("planted");
        });
        assert!(crash.join().is_err() && hardware.board.is_poisoned());
        let sample = hardware.connect().unwrap().sample(Time::ZERO).unwrap().unwrap();
        assert!((sample.q[0] - 0.5).abs() < 0.001);
    }
}
