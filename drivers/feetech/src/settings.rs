//! The settings of an arm of Feetech servos.

use crate::calibration::ArmCalibration;
use crate::joint::{RAD_PER_COUNT, ServoJoint};
use crate::packet::MAX_ID;
use crate::registers::TURN_COUNTS;
use mobee_contract::{Axis, KindError};
use mobee_model::{JointMotion, Robot};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::time::Duration;

/// Time between two readings.
pub const PERIOD: Duration = Duration::from_millis(10);
/// The baud rates of an STS3215.
const BAUDS: [u32; 8] = [1_000_000, 500_000, 250_000, 128_000, 115_200, 76_800, 57_600, 38_400];
/// The stiffness of an STS3215 at its default gain, N m/rad: from the MuJoCo model of the SO-101.
const STIFFNESS: f64 = 17.8;

/// Settings of an arm of Feetech STS3215 servos, such as an SO-100 or SO-101, on one serial bus. The driver writes nothing that a servo
/// stores, and no servo loses its torque unless `release_torque` is set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FeetechSettings {
    /// The serial port, such as `/dev/ttyACM0`.
    pub port: String,
    /// Baud rate of the bus.
    #[serde(default = "baud")]
    #[schemars(extend("expert" = true))]
    pub baud: u32,
    /// The calibration that LeRobot made for this arm, a JSON file, relative to the configuration file: ids, ranges and middles of all
    /// motors.
    #[serde(default)]
    #[schemars(extend("format" = "path"))]
    pub calibration: Option<PathBuf>,
    /// The motors. With a calibration file: only what differs from it or is not in it.
    #[serde(default)]
    pub motors: Vec<BusMotorSettings>,
    /// Longest time for the answers to one request, ms.
    #[serde(default = "timeout_ms")]
    #[schemars(extend("expert" = true))]
    pub timeout_ms: f64,
    /// Maximum known time from a command to its effect, ms.
    #[serde(default = "latency_ms")]
    #[schemars(extend("expert" = true))]
    pub latency_ms: f64,
    /// Longest wait for the arm at the start, s.
    #[serde(default = "connect_s")]
    #[schemars(extend("expert" = true))]
    pub connect_s: f64,
    /// Maximum speed of every motor, deg/s.
    #[serde(default = "max_speed")]
    pub max_speed_deg_per_s: f64,
    /// Maximum acceleration of every motor, also in braking, deg/s^2.
    #[serde(default = "max_acceleration")]
    pub max_acceleration_deg_per_s2: f64,
    /// By how much a goal may be ahead of the measured position, deg: a motion that something blocks pushes no harder than this.
    #[serde(default = "lead")]
    #[schemars(extend("expert" = true))]
    pub lead_deg: f64,
    /// By how much a joint may rest beside its goal under weight, deg.
    #[serde(default = "hold_error")]
    #[schemars(extend("expert" = true))]
    pub hold_error_deg: f64,
    /// Torque of a servo at full load, N m: 1.9 at 7.4 V, 2.9 at 12 V.
    #[serde(default = "torque")]
    #[schemars(extend("expert" = true))]
    pub torque_nm: f64,
    /// The share of full load from which on something pushes the arm.
    #[serde(default = "contact_load")]
    #[schemars(extend("expert" = true))]
    pub contact_load: f64,
    /// Releases the torque at the end of a run if the arm rests at `rest_deg`; otherwise the servos hold.
    #[serde(default)]
    pub release_torque: bool,
    /// The configuration, deg per motor in the robot's order, at which an arm without torque does not fall. Needed by `release_torque`.
    #[serde(default)]
    pub rest_deg: Vec<f64>,
}

/// One servo.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BusMotorSettings {
    /// The motor's name in the robot model, such as `shoulder_pan`.
    pub joint: String,
    /// The servo's id. Not with a calibration file that has this motor.
    #[serde(default)]
    pub id: Option<u8>,
    /// Least and greatest position, counts. Not with a calibration file that has this motor.
    #[serde(default)]
    pub range: Option<[i32; 2]>,
    /// The count at `offset_deg`; default: the middle of the range.
    #[serde(default)]
    pub middle: Option<f64>,
    /// The model's angle at the middle, deg.
    #[serde(default)]
    pub offset_deg: f64,
    /// True if greater counts are smaller angles.
    #[serde(default)]
    pub inverted: bool,
}

fn baud() -> u32 {
    1_000_000
}
fn timeout_ms() -> f64 {
    20.0
}
fn latency_ms() -> f64 {
    40.0
}
fn connect_s() -> f64 {
    5.0
}
fn max_speed() -> f64 {
    60.0
}
fn max_acceleration() -> f64 {
    400.0
}
fn lead() -> f64 {
    3.0
}
fn hold_error() -> f64 {
    6.0
}
fn torque() -> f64 {
    2.9
}
fn contact_load() -> f64 {
    0.6
}

impl FeetechSettings {
    /// The default settings at this port, without motors.
    pub fn at(port: impl Into<String>) -> FeetechSettings {
        FeetechSettings {
            port: port.into(),
            baud: baud(),
            calibration: None,
            motors: Vec::new(),
            timeout_ms: timeout_ms(),
            latency_ms: latency_ms(),
            connect_s: connect_s(),
            max_speed_deg_per_s: max_speed(),
            max_acceleration_deg_per_s2: max_acceleration(),
            lead_deg: lead(),
            hold_error_deg: hold_error(),
            torque_nm: torque(),
            contact_load: contact_load(),
            release_torque: false,
            rest_deg: Vec::new(),
        }
    }

    /// Checks every setting that needs no robot.
    ///
    /// # Errors
    /// All that can't be used.
    pub fn validate(&self) -> Result<(), KindError> {
        let ranges = [
            ("timeout_ms", self.timeout_ms, 2.0, 1000.0),
            ("latency_ms", self.latency_ms, 0.0, 10_000.0),
            ("connect_s", self.connect_s, 0.0, 600.0),
            ("max_speed_deg_per_s", self.max_speed_deg_per_s, 0.1, 360.0),
            ("max_acceleration_deg_per_s2", self.max_acceleration_deg_per_s2, 1.0, 1e5),
            ("lead_deg", self.lead_deg, 0.5, 30.0),
            ("hold_error_deg", self.hold_error_deg, 0.0, 30.0),
            ("torque_nm", self.torque_nm, 0.1, 20.0),
            ("contact_load", self.contact_load, 0.05, 1.0),
        ];
        let number = |(name, value, least, most): (&str, f64, f64, f64)| {
            // written so that NaN is refused
            if value >= least && value <= most {
                return Ok(());
            }
            let what = format!("{value} is not a usable value here");
            Err(KindError::new(name, what, format!("give a number from {least} to {most}")))
        };
        let port = match self.port.trim() {
            "" => Err(KindError::new("port", "there is no serial port", "give its name, such as /dev/ttyACM0")),
            _ => Ok(()),
        };
        let baud = match BAUDS.contains(&self.baud) {
            true => Ok(()),
            false => {
                Err(KindError::new("baud", format!("no servo has {} baud", self.baud), format!("one of {BAUDS:?}")))
            }
        };
        KindError::gather(ranges.into_iter().map(number).chain([port, baud]))?;
        Ok(())
    }

    /// The servo of each motor, in the robot's order.
    ///
    /// # Errors
    /// A setting that does not fit the robot or the calibration.
    pub fn joints(&self, robot: &Robot) -> Result<Vec<ServoJoint>, KindError> {
        let calibration = self.calibration.as_deref().map(ArmCalibration::read).transpose()?.unwrap_or_default();
        self.are_of(robot, &calibration)?;
        let joints = KindError::gather(robot.motors.iter().map(|motor| {
            let at = self.motors.iter().position(|m| m.joint == motor.name);
            let own = at.and_then(|at| self.motors.get(at)).cloned().unwrap_or_default();
            let path = at.map_or("motors".into(), |at| format!("motors[{at}]"));
            if motor.motion != JointMotion::Turn {
                return Err(KindError::new(path, format!("motor `{}` slides", motor.name), "servos turn"));
            }
            joint(&motor.name, &own, &path, &calibration)
        }))?;
        for (i, joint) in joints.iter().enumerate() {
            if let Some(other) = joints.iter().take(i).find(|other| other.id == joint.id) {
                let what = format!("motors `{}` and `{}` have the same id {}", other.name, joint.name, joint.id);
                return Err(KindError::new("motors", what, "give each servo its own id"));
            }
        }
        self.rests(robot)?;
        Ok(joints)
    }

    /// Checks that every name is that of a motor of the robot.
    fn are_of(&self, robot: &Robot, calibration: &ArmCalibration) -> Result<(), KindError> {
        let names: Vec<&str> = robot.motors.iter().map(|m| m.name.as_str()).collect();
        let known = |path: String, name: &str| match names.contains(&name) {
            true => Ok(()),
            false => Err(KindError::new(
                path,
                format!("robot {} has no motor `{name}`", robot.name),
                format!("its motors are {}", names.join(", ")),
            )),
        };
        let own = self.motors.iter().enumerate().map(|(i, m)| known(format!("motors[{i}].joint"), &m.joint));
        let filed = calibration.0.keys().map(|name| known("calibration".into(), name));
        let twice = self.motors.iter().enumerate().map(|(i, m)| {
            let first = self.motors.iter().take(i).any(|other| other.joint == m.joint);
            match first {
                true => Err(KindError::new(
                    format!("motors[{i}].joint"),
                    format!("motor `{}` stands here twice", m.joint),
                    "state each motor once",
                )),
                false => Ok(()),
            }
        });
        KindError::gather(own.chain(filed).chain(twice))?;
        Ok(())
    }

    fn rests(&self, robot: &Robot) -> Result<(), KindError> {
        let (wanted, given) = (robot.motors.len(), self.rest_deg.len());
        match (self.release_torque, given) {
            (false, 0) => Ok(()),
            (false, _) => Err(KindError::new("rest_deg", "without `release_torque` it has no effect", "leave it out")),
            (true, _) if given == wanted && self.rest_deg.iter().all(|q| q.is_finite()) => Ok(()),
            (true, _) => Err(KindError::new(
                "rest_deg",
                format!("{given} angles for {wanted} motors"),
                "give the configuration, deg per motor, at which the arm does not fall without torque",
            )),
        }
    }

    /// The axes of these joints: the narrower of the model's and the calibration's limits.
    ///
    /// # Errors
    /// A joint without room.
    pub fn axes(&self, robot: &Robot, joints: &[ServoJoint]) -> Result<Vec<Axis>, KindError> {
        let speed = self.max_speed_deg_per_s.to_radians();
        let each = robot.motors.iter().zip(joints).map(|(motor, joint)| {
            let (low, high) = joint.limits();
            let (min, max) = (motor.min.max(low), motor.max.min(high));
            if max - min < RAD_PER_COUNT {
                let text = |(a, b): (f64, f64)| format!("{:.1} to {:.1} deg", a.to_degrees(), b.to_degrees());
                let [model, servo] = [(motor.min, motor.max), (low, high)].map(text);
                let what = format!("motor `{}`: the model allows {model}, the servo {servo}", joint.name);
                return Err(KindError::new("motors", what, "correct `offset_deg`, `inverted` or the calibration"));
            }
            Ok(Axis {
                name: joint.name.clone(),
                min,
                max,
                max_speed: motor.max_speed.map_or(speed, |most| most.min(speed)),
                max_acceleration: self.max_acceleration_deg_per_s2.to_radians(),
                resolution: RAD_PER_COUNT,
                hold_error: self.hold_error_deg.to_radians(),
                deflection: self.torque_nm / STIFFNESS,
                contact_effort: self.contact_load * self.torque_nm,
                ..Axis::default()
            })
        });
        KindError::gather(each)
    }

    /// Time that one transaction may take.
    pub fn timeout(&self) -> Duration {
        millis(self.timeout_ms)
    }

    /// Time from a command to its effect.
    pub fn latency(&self) -> Duration {
        millis(self.latency_ms)
    }

    /// Time to wait for the arm at the start.
    pub fn patience(&self) -> Duration {
        millis(1e3 * self.connect_s)
    }
}

/// The servo of one motor.
fn joint(
    name: &str,
    own: &BusMotorSettings,
    path: &str,
    calibration: &ArmCalibration,
) -> Result<ServoJoint, KindError> {
    let filed = calibration.0.get(name);
    let wrong =
        |key: &str, what: String, help: &str| Err(KindError::new(format!("{path}{key}"), what, help.to_owned()));
    if filed.is_some() && own.id.is_some() {
        return wrong(".id", format!("the calibration has the id of `{name}`, too"), "leave one of them out");
    }
    if filed.is_some() && own.range.is_some() {
        return wrong(".range", format!("the calibration has the range of `{name}`, too"), "leave one of them out");
    }
    let Some(id) = filed.map(|f| f.id).or(own.id) else {
        let help = "state `calibration`, or { joint = ..., id = ..., range = [..., ...] } for each motor of the robot";
        return wrong("", format!("motor `{name}` has no servo"), help);
    };
    let Some([min, max]) = filed.map(|f| [f.range_min, f.range_max]).or(own.range) else {
        return wrong(".range", format!("motor `{name}` has no range"), "state range = [least count, greatest count]");
    };
    if id > MAX_ID {
        return wrong(".id", format!("{id} is not the id of a servo"), "ids are 0 to 253");
    }
    if min < 0 || max >= TURN_COUNTS || max <= min {
        return wrong(".range", format!("{min} to {max} is not a range"), "ranges lie within 0 to 4095");
    }
    let middle = own.middle.unwrap_or(f64::from(min + max) / 2.0);
    if !(middle.is_finite() && middle.abs() <= f64::from(TURN_COUNTS)) {
        return wrong(".middle", format!("{middle} is not a count"), "counts are 0 to 4095");
    }
    if !(own.offset_deg.is_finite() && own.offset_deg.abs() <= 360.0) {
        return wrong(".offset_deg", format!("{} is not an angle", own.offset_deg), "give -360 to 360");
    }
    Ok(ServoJoint {
        name: name.into(),
        id,
        range: (min, max),
        middle,
        inverted: own.inverted,
        offset: own.offset_deg.to_radians(),
        homing_offset: filed.map(|f| f.homing_offset),
    })
}

fn millis(ms: f64) -> Duration {
    Duration::try_from_secs_f64(1e-3 * ms).unwrap_or_default()
}
