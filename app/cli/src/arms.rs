//! Arms that people own, and what is the same for all arms of a make: the model, the order of the servos, a rest pose.
//!
//! `mobee new --arm` and `mobee calibrate` need nothing else to start from.

#![cfg_attr(not(feature = "feetech"), allow(dead_code, reason = "without the driver only the names are used"))]

use mobee_compose::config::{ConfigError, suggestion};
use mobee_model::{FileError, Robot, parse_robot};

/// An arm of servos on one bus. The servos have the ids 1, 2, ... in the order of the model's motors.
#[derive(Debug)]
pub(crate) struct KnownArm {
    /// Its name on the command line, and that of the robot in its behavior.
    pub(crate) name: &'static str,
    /// The model's file name, and its text.
    pub(crate) model: (&'static str, &'static str),
    /// Motors that turn without end: their range can't be found by hand.
    pub(crate) endless: &'static [&'static str],
    /// The model's angle at the middle of the range, deg, if it is not 0.
    pub(crate) offset_deg: &'static [(&'static str, f64)],
    /// The motors of its first exploration.
    pub(crate) explored: &'static [&'static str],
    /// A folded pose, deg, 20 mm or more from contact, since weight bends the arm; other motors at the middle of their ranges.
    pub(crate) rest_deg: &'static [(&'static str, f64)],
}

const ARMS: &[KnownArm] = &[KnownArm {
    name: "so101",
    model: ("so101.xml", include_str!("../../../configs/robots/so101.xml")),
    endless: &["wrist_roll"],
    offset_deg: &[("gripper", 45.0)],
    explored: &["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex"],
    rest_deg: &[("shoulder_lift", -88.0), ("elbow_flex", 76.0), ("wrist_flex", 50.0), ("gripper", 20.0)],
}];

/// The arm of this name.
///
/// # Errors
/// If there is none.
pub(crate) fn known(name: &str) -> Result<&'static KnownArm, ConfigError> {
    ARMS.iter().find(|arm| arm.name == name).ok_or_else(|| {
        let names: Vec<&str> = ARMS.iter().map(|arm| arm.name).collect();
        let help = format!("{}; any other robot: mobee new NAME --robot URDF", suggestion(name, "arm", &names));
        ConfigError::plain(format!("there is no arm `{name}`"), help)
    })
}

/// A complaint that this program lacks the driver of these arms.
#[cfg(not(feature = "feetech"))]
pub(crate) fn lacks_driver() -> ConfigError {
    let help = "build it with the feature: cargo install --path . --features feetech";
    ConfigError::plain("this program was built without the driver of servo buses (feature `feetech`)", help)
}

impl KnownArm {
    /// Its model.
    ///
    /// # Errors
    /// None, as a test loads every shipped model.
    pub(crate) fn robot(&self) -> Result<Robot, FileError> {
        let (file, text) = self.model;
        Ok(parse_robot(file, text)?.value)
    }

    /// The model's angle at the middle of a motor's range, deg.
    pub(crate) fn middle_deg(&self, motor: &str) -> f64 {
        value_of(self.offset_deg, motor).unwrap_or_default()
    }

    /// The rest pose of a motor, deg.
    pub(crate) fn rest_of(&self, motor: &str) -> f64 {
        value_of(self.rest_deg, motor).unwrap_or_else(|| self.middle_deg(motor))
    }
}

fn value_of(table: &[(&str, f64)], motor: &str) -> Option<f64> {
    table.iter().find(|(name, _)| *name == motor).map(|(_, value)| *value)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The tables name motors of the models, within their limits.
    #[test]
    fn each_arm_fits_its_model() {
        for arm in ARMS {
            let robot = arm.robot().expect("a model");
            let names: Vec<&str> = robot.motors.iter().map(|m| m.name.as_str()).collect();
            let tables = arm.offset_deg.iter().chain(arm.rest_deg).map(|(name, _)| name);
            for name in tables.chain(arm.endless).chain(arm.explored) {
                assert!(names.contains(name), "{}: {name}", arm.name);
            }
            for motor in &robot.motors {
                let rest = arm.rest_of(&motor.name).to_radians();
                assert!(motor.min < rest && rest < motor.max, "{}: {}", arm.name, motor.name);
            }
        }
    }

    #[test]
    fn an_unknown_arm_is_refused_with_the_known_ones() {
        let refused = known("so-101").expect_err("a refusal");
        assert!(refused.message().contains("`so-101`") && refused.help_text().contains("so101"), "{refused}");
    }
}
