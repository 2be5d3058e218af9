//! Settings of the simulated robot.

mod imitated;

pub use imitated::Imitated;

use crate::sim::body::Physics;
use crate::sim::dynamics::{ArmNumbers, ArmProfile, Servo, ServoSettings, StopRule};
use crate::sim::path::Profile;
use mobee_contract::{Axis, KindError, suggestion};
use mobee_model::{JointMotion, Object, ObjectClass, Primitive, Robot, Shape};
use nalgebra::{Isometry3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::time::Duration;

/// Acceleration of a motor whose profile states none, deg/s^2.
const ACCELERATION_DEG: f64 = 200.0;
/// Resolution of the encoders of kinematic joints, deg.
const RESOLUTION_DEG: f64 = 0.01;
/// Noise of the encoders of kinematic joints, deg.
const NOISE_DEG: f64 = 0.005;
/// Spread of the readings of a noisy encoder at rest, in standard deviations.
const NOISE_SPREAD: f64 = 4.0;

/// A box that is only in the simulated world, upright.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct UnknownBox {
    /// Name, for reports.
    pub name: String,
    /// Full edge lengths along x, y and z, m.
    pub size_m: [f64; 3],
    /// Position of its center in the world frame, m.
    pub at_m: [f64; 3],
}

impl UnknownBox {
    /// Converts to an obstacle of a scene.
    pub fn object(&self) -> Object {
        let [x, y, z] = self.at_m;
        let shape = Shape::Box { size: Vector3::from(self.size_m) };
        Object {
            name: self.name.clone(),
            class: ObjectClass::Obstacle,
            persistent: true,
            pose: Isometry3::translation(x, y, z),
            shapes: vec![Primitive { shape, pose: Isometry3::identity() }],
            color: None,
        }
    }
}

/// True if a file need not name it.
fn is_builtin(physics: &Physics) -> bool {
    *physics == Physics::Builtin
}

/// Settings of a simulated robot. All have defaults. For prismatic joints, degrees mean millimeters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SimSettings {
    /// Robot to imitate, such as `iCub_SIM`; its measured behavior replaces `move_profile` and the model's
    /// limits.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("expert" = true))]
    pub imitates: Option<Imitated>,
    /// Kind of arm: `ideal` (kinematic joints), or `arm` (generic), `icub`, `panda`, `ur5`, `so101` with
    /// servos, weight and elastic contact. Default: the profile of the robot's name, or `arm`; with `imitates`,
    /// `ideal`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub profile: Option<ArmProfile>,
    /// Physics that moves the arm: `builtin`, or `mujoco`; not with kinematic joints.
    #[serde(skip_serializing_if = "is_builtin")]
    pub physics: Physics,
    /// Deviations of servos, weight and board from the profile.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("expert" = true))]
    pub servo: Option<ServoSettings>,
    /// Boxes that the simulated arm can touch but the model does not contain; not with kinematic joints.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub unknown: Vec<UnknownBox>,
    /// Shape of position moves: `minimum_jerk`, `trapezoidal` or `gain`.
    #[schemars(extend("expert" = true))]
    pub move_profile: Profile,
    /// Maximum speed of every motor, deg/s. A lower `maxSpeed` of a motor in the robot file has priority.
    pub max_speed_deg_per_s: f64,
    /// Maximum acceleration of every motor, also in braking, deg/s^2. Default: 200, or the profile's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_acceleration_deg_per_s2: Option<f64>,
    /// Time from a command to its effect, ms.
    #[schemars(extend("expert" = true))]
    pub latency_ms: f64,
    /// Encoder readings per second.
    #[schemars(extend("expert" = true))]
    pub rate_hz: f64,
    /// Resolution of the encoders, deg; 0: unlimited. Default: 0.01, or the profile's.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("expert" = true))]
    pub resolution_deg: Option<f64>,
    /// Standard deviation of the encoder noise, deg; the error of a reading is limited to 3.5 times this.
    /// Default: 0.005, or the profile's.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("expert" = true))]
    pub noise_deg: Option<f64>,
    /// Maximum deviation of a reading's time from its period, ms.
    #[schemars(extend("expert" = true))]
    pub jitter_ms: f64,
    /// Start positions of motors by name, in encoder degrees; other motors start at home.
    pub start_deg: BTreeMap<String, f64>,
}

impl Default for SimSettings {
    fn default() -> SimSettings {
        SimSettings {
            imitates: None,
            profile: None,
            physics: Physics::Builtin,
            servo: None,
            unknown: Vec::new(),
            move_profile: Profile::default(),
            max_speed_deg_per_s: 100.0,
            max_acceleration_deg_per_s2: None,
            latency_ms: 20.0,
            rate_hz: 100.0,
            resolution_deg: None,
            noise_deg: None,
            jitter_ms: 0.2,
            start_deg: BTreeMap::new(),
        }
    }
}

impl SimSettings {
    /// Defaults with kinematic joints.
    pub fn ideal() -> SimSettings {
        SimSettings { profile: Some(ArmProfile::Ideal), ..SimSettings::default() }
    }

    /// Same settings with the profile of this robot, unless they name one.
    pub fn for_robot(&self, robot: &Robot) -> SimSettings {
        let own = || match self.imitates {
            // what is imitated has kinematic joints
            Some(_) => ArmProfile::Ideal,
            None => ArmProfile::of_robot([robot.name.as_str()]),
        };
        SimSettings { profile: Some(self.profile.unwrap_or_else(own)), ..self.clone() }
    }

    /// Same settings without noise, resolution and jitter: exact encoders.
    pub fn exact(self) -> SimSettings {
        SimSettings { resolution_deg: Some(0.0), noise_deg: Some(0.0), jitter_ms: 0.0, ..self }
    }

    /// Checks every setting.
    ///
    /// # Errors
    /// The first invalid setting, with the valid range.
    pub fn validate(&self) -> Result<(), KindError> {
        let ranges = [
            ("max_speed_deg_per_s", self.max_speed_deg_per_s, 0.1, 10_000.0),
            ("max_acceleration_deg_per_s2", self.max_acceleration_deg_per_s2.unwrap_or(1.0), 0.1, 1e6),
            ("latency_ms", self.latency_ms, 0.0, 10_000.0),
            ("rate_hz", self.rate_hz, 0.1, 10_000.0),
            ("resolution_deg", self.resolution(), 0.0, 10.0),
            ("noise_deg", self.noise(), 0.0, 10.0),
            ("jitter_ms", self.jitter_ms, 0.0, 400.0 / self.rate_hz),
        ];
        KindError::gather(ranges.map(|(name, value, least, most)| {
            // an invalid rate is reported only once
            let judged = name != "jitter_ms" || self.rate_hz > 0.0;
            // written so that NaN fails
            let usable = value >= least && value <= most;
            if judged && !usable {
                let help = match name {
                    "jitter_ms" => format!("give a number from 0 to {most} (0.4 of the time between two readings)"),
                    _ => format!("give a number from {least} to {most}"),
                };
                return Err(KindError::new(name, format!("{value} is not a usable value here"), help));
            }
            Ok(())
        }))?;
        self.validate_arm()
    }

    /// Checks the settings of the arm's servos and of the objects that it touches.
    fn validate_arm(&self) -> Result<(), KindError> {
        let kinematic = self.arm().is_none();
        let needs = |name: &str| {
            let help = "give a profile with servos, such as profile = \"panda\"";
            KindError::new(name, "kinematic joints (profile `ideal`) have no servos, no weight and touch nothing", help)
        };
        let empty = self.servo.iter().flat_map(ServoSettings::empty_lists).map(|name| {
            Err(KindError::new(
                name,
                "this list is empty",
                "give a number, or leave the key out: the profile's counts then",
            ))
        });
        let servo = self.servo.as_ref().filter(|_| kinematic).map(|_| Err(needs("servo")));
        let unknown = self.unknown.first().filter(|_| kinematic).map(|_| Err(needs("unknown")));
        let physics = (kinematic && self.physics != Physics::Builtin).then(|| Err(needs("physics")));
        let unused =
            self.physics.engine()?.into_iter().flat_map(|engine| engine.unused).filter_map(|(key, instead)| {
                let given = self.servo.as_ref().is_some_and(|servo| servo.has(key));
                let what = "the physics engine does not use this number";
                given.then(|| Err(KindError::new(format!("servo.{key}"), what, format!("leave it out: {instead}"))))
            });
        let imitates = self.imitates.filter(|_| !kinematic).map(|_| {
            let help = "leave one of the two out";
            Err(KindError::new("imitates", "what is imitated has kinematic joints, and the profile has servos", help))
        });
        let wrong = |(name, x, least, most): (String, f64, f64, f64)| match x >= least && x <= most {
            true => Ok(()),
            false => Err(KindError::new(
                name,
                format!("{x} is not a usable value here"),
                format!("give a number from {least} to {most}"),
            )),
        };
        let numbers = self.servo.iter().flat_map(ServoSettings::ranges).map(wrong);
        let sizes = self.unknown.iter().enumerate().flat_map(|(i, b)| {
            let size = b.size_m.iter().map(move |x| (format!("unknown[{i}].size_m"), *x, 1e-3, 100.0));
            size.chain(b.at_m.iter().map(move |x| (format!("unknown[{i}].at_m"), *x, -100.0, 100.0)))
        });
        KindError::gather(
            servo
                .into_iter()
                .chain(empty)
                .chain(physics)
                .chain(unused)
                .chain(unknown)
                .chain(imitates)
                .chain(numbers)
                .chain(sizes.map(wrong)),
        )?;
        Ok(())
    }

    /// The robot's axes under these settings.
    pub fn axes(&self, robot: &Robot) -> Vec<Axis> {
        let settings = self.for_robot(robot);
        let servos = settings.servos(robot);
        let axis = |(i, m): (usize, &mobee_model::Motor)| {
            let axis = Axis {
                name: m.name.clone(),
                min: m.min,
                max: m.max,
                max_speed: m.limit_speed(self.max_speed_deg_per_s.to_radians()),
                max_acceleration: settings.acceleration(robot, i),
                motion: m.motion,
                ..settings.shows(m, servos.as_ref().and_then(|servos| servos.get(i)), settings.acceleration(robot, i))
            };
            match self.imitates {
                Some(robot) => robot.axis(axis),
                None => axis,
            }
        };
        robot.motors.iter().enumerate().map(axis).collect()
    }

    /// Greatest acceleration of a motor, rad/s^2.
    fn acceleration(&self, robot: &Robot, motor: usize) -> f64 {
        let of_joint = |arm: ArmNumbers| {
            let motor_of = robot.motors.get(motor).filter(|m| m.motion.is_turn())?;
            let first = robot.parts.get(motor_of.part).map_or(0, |part| part.motors.start);
            arm.acceleration_deg(motor.saturating_sub(first))
        };
        let profile = || self.arm().and_then(of_joint).unwrap_or(ACCELERATION_DEG);
        self.max_acceleration_deg_per_s2.unwrap_or_else(profile).to_radians()
    }

    /// Servos of a robot's motors; `None` for kinematic joints.
    pub fn servos(&self, robot: &Robot) -> Option<Vec<Servo>> {
        let numbers = self.for_robot(robot).arm()?;
        Some(self.servo.clone().unwrap_or_default().servos(&numbers, robot))
    }

    /// Accuracy of the readings and of the servo of this motor, which accelerates by this, rad/s^2; defaults for
    /// kinematic joints.
    fn shows(&self, motor: &mobee_model::Motor, servo: Option<&Servo>, acceleration: f64) -> Axis {
        let (Some(numbers), Some(joint)) = (self.arm(), servo) else { return Axis::default() };
        let resolution = self.resolution().max(NOISE_SPREAD * self.noise()).to_radians();
        let turns = motor.motion == JointMotion::Turn;
        let servo = self.servo.clone().unwrap_or_default();
        let (deflection, contact_effort) = servo.contact(&numbers, joint);
        let (hold_error, deflection) = if turns { (servo.hold_error(&numbers), deflection) } else { (0.0, 0.0) };
        let overshoot = joint.overshoot(acceleration);
        let stop_sinks = hold_error > 0.0 && servo.rules(&numbers).stop == StopRule::Measured;
        Axis { resolution, hold_error, deflection, contact_effort, overshoot, stop_sinks, ..Axis::default() }
    }

    /// Start configuration of the robot, rad.
    ///
    /// # Errors
    /// A motor that the robot does not have, or a position outside its limits.
    pub fn start(&self, robot: &Robot) -> Result<Vec<f64>, KindError> {
        let mut start: Vec<f64> = robot.motors.iter().map(|m| m.home).collect();
        let names: Vec<&str> = robot.motors.iter().map(|m| m.name.as_str()).collect();
        KindError::gather(self.start_deg.iter().map(|(name, deg)| {
            let path = format!("start_deg.{name}");
            let found = robot.motors.iter().zip(&mut start).find(|(m, _)| m.name == *name);
            let Some((motor, slot)) = found else {
                let what = format!("robot {} has no motor {name}", robot.name);
                return Err(KindError::new(path, what, suggestion(name, "motor", &names)));
            };
            let (min, max) = (motor.min.to_degrees(), motor.max.to_degrees());
            if !(*deg >= min - 1e-6 && *deg <= max + 1e-6) {
                let unit = motor.motion.unit();
                let what = format!("{deg} {unit} is outside the limits of {name}");
                return Err(KindError::new(path, what, format!("give a position from {min:.3} to {max:.3} {unit}")));
            }
            *slot = deg.to_radians().clamp(motor.min, motor.max);
            Ok(())
        }))?;
        Ok(start)
    }

    /// Shape of position moves.
    pub fn move_profile(&self) -> Profile {
        if self.imitates == Some(Imitated::ICubSim) { Profile::Gain } else { self.move_profile }
    }

    /// Numbers of the arm's profile, which is that of an unnamed robot if they name none; `None` for kinematic
    /// joints.
    pub fn arm(&self) -> Option<ArmNumbers> {
        match (self.profile, self.imitates) {
            (Some(profile), _) => profile.numbers(),
            (None, Some(_)) => None,
            (None, None) => ArmProfile::Arm.numbers(),
        }
    }

    /// Resolution of the encoders, deg.
    pub fn resolution(&self) -> f64 {
        self.resolution_deg.unwrap_or_else(|| self.arm().map_or(RESOLUTION_DEG, |arm| arm.resolution_deg))
    }

    /// Standard deviation of the encoder noise, deg.
    pub fn noise(&self) -> f64 {
        self.noise_deg.unwrap_or_else(|| self.arm().map_or(NOISE_DEG, |arm| arm.noise_deg))
    }

    /// Time between two readings.
    pub fn period(&self) -> Duration {
        Duration::try_from_secs_f64(1.0 / self.rate_hz).unwrap_or(Duration::from_millis(10))
    }

    /// Time from a command to its effect.
    pub fn latency(&self) -> Duration {
        Duration::try_from_secs_f64(self.latency_ms * 1e-3).unwrap_or_default()
    }

    /// Greatest deviation of a reading's time.
    pub fn jitter(&self) -> Duration {
        Duration::try_from_secs_f64(self.jitter_ms * 1e-3).unwrap_or_default()
    }
}
