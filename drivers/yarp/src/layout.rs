//! Assignment of motors to boards, joints and units. The only place that converts between degrees and
//! radians.
//!
//! Below this layer the driver uses degrees for revolute and millimeters for prismatic joints. Boards use
//! meters for the latter: the patch's `Units` convert everything that is sent to a board (`Hand::send`,
//! `Hand::stream`) and received from it (`states.rs`, `describe`).

use super::YarpDriverSettings;
use mobee_contract::{KindError, MotorUnits, suggestion};
use mobee_model::{JointMotion, Robot};
use mobee_yarp::board::{JointKind, Units};
use std::ops::Range;

/// A board among the robot's motors. Joint `j` of the board is motor `motors.start + j`: the model numbers
/// the motors of a part as its board does (so the torso's yaw comes first, although it is the last of the
/// chain).
#[derive(Clone, Debug, PartialEq)]
pub struct Patch {
    /// Name of the part.
    pub part: String,
    /// Prefix of the board's port names.
    pub port: String,
    /// Motors of the board.
    pub motors: Range<usize>,
    /// Joint kinds, from the model.
    pub units: Units,
}

/// All boards of a robot.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    /// The boards, in the order of the settings.
    pub patches: Vec<Patch>,
    /// Home configuration, rad; motors without a board stay there.
    pub home: Vec<f64>,
    /// Names of the motors.
    pub names: Vec<String>,
    /// Limits of the model, rad of encoder.
    pub limits: Vec<(f64, f64)>,
    /// Maximum speeds of the model, rad/s of encoder; infinite where it has none.
    pub speeds: Vec<f64>,
    /// Joint motions.
    pub motions: Vec<JointMotion>,
}

impl Layout {
    /// Assigns the boards of the settings to the robot's parts.
    ///
    /// # Errors
    /// A part that the robot does not have, or that is named twice.
    pub fn new(settings: &YarpDriverSettings, robot: &Robot) -> Result<Layout, KindError> {
        let mut patches: Vec<Patch> = Vec::new();
        let names: Vec<&str> = robot.parts.iter().map(|p| p.name.as_str()).collect();
        KindError::gather(settings.parts.iter().enumerate().map(|(i, p)| {
            let Some(part) = robot.parts.iter().find(|known| known.name == p.part) else {
                let what = format!("robot {} has no part {}", robot.name, p.part);
                return Err(KindError::new(format!("parts[{i}].part"), what, suggestion(&p.part, "part", &names)));
            };
            if patches.iter().any(|known| known.part == p.part || known.port == p.port) {
                let what = format!("{} at {} is there already", p.part, p.port);
                return Err(KindError::new(format!("parts[{i}]"), what, "give every part one board of its own"));
            }
            let motors = robot.motors.get(part.motors.clone()).unwrap_or_default();
            let units = Units::new(motors.iter().map(|m| joint_kind(m.motion)));
            patches.push(Patch { part: p.part.clone(), port: p.port.clone(), motors: part.motors.clone(), units });
            Ok(())
        }))?;
        Ok(Layout {
            patches,
            home: robot.motors.iter().map(|m| m.home).collect(),
            names: robot.motors.iter().map(|m| m.name.clone()).collect(),
            limits: robot.motors.iter().map(|m| (m.min, m.max)).collect(),
            speeds: robot.motors.iter().map(|m| m.limit_speed(f64::INFINITY)).collect(),
            motions: robot.motors.iter().map(|m| m.motion).collect(),
        })
    }

    /// Units of the motors, for messages.
    pub fn units(&self) -> MotorUnits {
        let sliding = self.motions.iter().enumerate().filter(|(_, motion)| !motion.is_turn());
        MotorUnits::new(self.motors(), &sliding.map(|(motor, _)| motor).collect::<Vec<_>>())
    }

    /// Number of motors of the robot.
    pub fn motors(&self) -> usize {
        self.names.len()
    }

    /// Board and joint of a motor.
    pub fn joint(&self, motor: usize) -> Option<(usize, usize)> {
        let on = |p: &Patch| p.motors.contains(&motor);
        let board = self.patches.iter().position(on)?;
        Some((board, motor - self.patches.get(board)?.motors.start))
    }

    /// Sorts the values of some motors by board: for each board that has any of them, its joints and their
    /// values in degrees or millimeters. Motors without a board are omitted.
    pub fn split(&self, motors: &[usize], values: &[f64]) -> Vec<(usize, Vec<usize>, Vec<f64>)> {
        let mut split: Vec<(usize, Vec<usize>, Vec<f64>)> = Vec::new();
        for (m, v) in motors.iter().zip(values) {
            let Some((board, joint)) = self.joint(*m) else { continue };
            match split.iter_mut().find(|(b, ..)| *b == board) {
                Some((_, joints, degrees)) => {
                    joints.push(joint);
                    degrees.push(v.to_degrees());
                }
                None => split.push((board, vec![joint], vec![v.to_degrees()])),
            }
        }
        split
    }
}

/// Joint kind of a board for a joint motion of the model.
pub fn joint_kind(motion: JointMotion) -> JointKind {
    match motion {
        JointMotion::Turn => JointKind::Revolute,
        JointMotion::Slide => JointKind::Prismatic,
    }
}

/// Description and remedy if the joint kind that a board reports differs from the model's, because its
/// numbers then have another meaning. A board that reports no kind is assumed to agree.
pub fn disagreement(reported: JointKind, model: JointKind, motor: &str, joint: &str) -> Option<[String; 2]> {
    let in_words = |kind| match kind {
        JointKind::Prismatic => "slides (meters)",
        JointKind::Revolute | JointKind::Unknown => "turns (degrees)",
    };
    if reported == JointKind::Unknown || reported == model {
        return None;
    }
    let reported = in_words(reported);
    let model = in_words(model);
    let what = format!("{joint} {reported}, as its board tells, but motor {motor} of the model {model}");
    let remedy = "correct the type of the joint in the robot file or in the board's configuration, and check that the ports are this \
                  part's and its joints in this order";
    Some([what, remedy.into()])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn robot() -> Robot {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/robots/icub.xml");
        mobee_model::load_robot(std::path::Path::new(path)).unwrap().value
    }

    #[test]
    fn the_torso_is_commanded_in_board_order() {
        let robot = robot();
        let layout = Layout::new(&YarpDriverSettings::of([("right_arm", "/r"), ("torso", "/t")]), &robot).unwrap();
        let motor = |name: &str| robot.motors.iter().position(|m| m.name == name).unwrap();
        for (joint, name) in ["torso_yaw", "torso_roll", "torso_pitch"].iter().enumerate() {
            assert_eq!(layout.joint(motor(name)), Some((1, joint)));
        }
        assert_eq!(layout.joint(motor("neck_pitch")), None, "a part without a board");
        let motors = [motor("torso_pitch"), motor("r_elbow"), motor("torso_yaw"), motor("neck_pitch")];
        let q = [0.1f64, 0.2, 0.3, 0.4];
        let split = layout.split(&motors, &q);
        assert_eq!(split.len(), 2);
        assert_eq!((split[0].0, &split[0].1), (1, &vec![2, 0]));
        assert!((split[0].2[0] - 0.1f64.to_degrees()).abs() < 1e-12);
        assert_eq!((split[1].0, &split[1].1), (0, &vec![3]));
    }

    #[test]
    fn every_motor_comes_back_from_its_board() {
        let robot = robot();
        let ports: Vec<(String, String)> =
            robot.parts.iter().map(|p| (p.name.clone(), format!("/icub/{}", p.name))).collect();
        let settings = YarpDriverSettings::of(ports.iter().map(|(a, b)| (a.as_str(), b.as_str())));
        let layout = Layout::new(&settings, &robot).unwrap();
        for m in 0..robot.motors.len() {
            let (board, joint) = layout.joint(m).unwrap();
            assert_eq!(layout.patches[board].motors.start + joint, m);
        }
    }

    #[test]
    fn unknown_and_double_parts_are_named() {
        let robot = robot();
        let tail = Layout::new(&YarpDriverSettings::of([("tail", "/t")]), &robot).unwrap_err();
        assert!(tail.what.contains("tail") && tail.help.contains("torso"), "{tail:?}");
        let twice = YarpDriverSettings::of([("torso", "/t"), ("torso", "/u")]);
        assert_eq!(Layout::new(&twice, &robot).unwrap_err().path, "parts[1]");
    }
}
