//! Motion of joints and units of motors: the attributes `type` and `continuous`.
//!
//! ```text
//! <motor name="lift" minPos="0" maxPos="350">               350 encoder units: millimeters, since its joint is prismatic
//!   <joint type="prismatic" z="1" minPos="0" maxPos="0.35"> in meters, as all lengths
//! ```

use super::element::{Element, Warnings};
use crate::{JointMotion, Motor};
use mobee_text::FileError;
use std::f64::consts::TAU;

/// The attributes of a motor that concern its motion.
pub(super) const MOTOR: &[&str] = &["type", "continuous"];
/// Tolerance, in turns, for whole turns of the joints of a continuous motor: rounding in files.
const WHOLE_TURN_TOLERANCE: f64 = 1e-6;

/// Position of a prismatic joint above which a warning is given, meters; equals the limit for meshes.
const DOUBTED_POSITION_M: f64 = 10.0;

/// Motion of a motor as given by its own attributes.
pub(super) struct MotorMotion {
    /// Its `type`, if given.
    stated: Option<JointMotion>,
    /// True if it is continuous.
    pub(super) continuous: bool,
}

impl MotorMotion {
    /// Reads the motor's own attributes.
    pub(super) fn read(e: &Element, warnings: &mut Warnings) -> Result<Self, FileError> {
        let stated = word(e, "motors")?;
        let continuous = e.flag("continuous", warnings);
        if continuous && stated == Some(JointMotion::Slide) {
            return Err(e.error_at("continuous", "what slides has an end", "leave `continuous` out"));
        }
        Ok(Self { stated, continuous })
    }

    /// The motor's motion before its joints are read.
    pub(super) fn stated(&self) -> JointMotion {
        self.stated.unwrap_or_default()
    }

    /// Attaches a joint to the motor: a motor without a `type` gets the motion of its joints, which must be equal.
    ///
    /// # Errors
    /// At the joint, if its motion differs from that of the motor's others, or if the motor is continuous and the
    /// joint's range is not a whole multiple of its own.
    pub(super) fn joins(
        &self,
        e: &Element,
        motor: &mut Motor,
        motion: JointMotion,
        (min, max): (f64, f64),
    ) -> Result<(), FileError> {
        if self.stated.is_none() {
            if !motor.joints.is_empty() && motor.motion != motion {
                let message = format!("motor `{}` has joints that turn and joints that slide", motor.name);
                let help = "say what its encoder counts: type=\"revolute\" (degrees) or type=\"prismatic\" (millimeters) \
                            at the motor";
                return Err(e.error_at("type", message, help));
            }
            motor.motion = motion;
        }
        if motor.continuous {
            let turns = (max - min) / (motor.max - motor.min);
            let whole = motion == JointMotion::Turn
                && (turns - turns.round()).abs() * ((max - min) / TAU).max(1.0) < WHOLE_TURN_TOLERANCE;
            if !whole {
                let message = format!("a full turn of motor `{}` does not bring this joint back", motor.name);
                let help = "a motor with continuous=\"true\" needs joints whose range is a whole multiple of its own";
                return Err(e.error_at("maxPos", message, help));
            }
        }
        Ok(())
    }
}

/// The maximum speed of a motor, if limited: encoder units per second in the file, converted to rad/s of encoder.
pub(super) fn speed_of_motor(e: &Element) -> Result<Option<f64>, FileError> {
    match e.number("maxSpeed")? {
        Some(speed) if speed <= 0.0 => {
            let help = "give degrees (or millimeters) per second above 0, or leave `maxSpeed` out";
            Err(e.error_at("maxSpeed", format!("`maxSpeed` is {speed}, but must be above 0"), help))
        }
        other => Ok(other.map(f64::to_radians)),
    }
}

/// The motion of a joint.
pub(super) fn of_joint(e: &Element) -> Result<JointMotion, FileError> {
    Ok(word(e, "joints")?.unwrap_or_default())
}

/// Positions of a joint at its motor's limits, rad or meters. Warns if a prismatic one is so large that millimeters may
/// be meant.
pub(super) fn limits_of_joint(
    e: &Element,
    motion: JointMotion,
    warnings: &mut Warnings,
) -> Result<(f64, f64), FileError> {
    match motion {
        JointMotion::Turn => {
            limits(e, "the joint", -180.0, 180.0).map(|(min, max)| (min.to_radians(), max.to_radians()))
        }
        JointMotion::Slide => {
            if let Some(missing) = ["minPos", "maxPos"].into_iter().find(|a| e.get(a).is_none()) {
                let help = "give both limits in meters: minPos=\"0\" maxPos=\"0.35\"";
                return Err(e.error(format!("a prismatic joint has no `{missing}`"), help));
            }
            let (min, max) = limits(e, "the joint", 0.0, 0.0)?;
            if let Some((attr, far)) =
                [("minPos", min), ("maxPos", max)].into_iter().find(|(_, at)| at.abs() > DOUBTED_POSITION_M)
            {
                let message = format!("this joint slides to {far} m");
                let help =
                    "a prismatic joint's limits are in meters (its motor's in millimeters); check what was meant";
                warnings.add(|| e.warning_at(attr, message, help));
            }
            Ok((min, max))
        }
    }
}

/// The attribute `type`; `None` if it is missing or empty.
fn word(e: &Element, what: &str) -> Result<Option<JointMotion>, FileError> {
    match e.get("type").map_or("", |t| t.value.trim()) {
        "" => Ok(None),
        "revolute" => Ok(Some(JointMotion::Turn)),
        "prismatic" => Ok(Some(JointMotion::Slide)),
        other => {
            let message = format!("{what} of type \"{other}\" are not supported");
            Err(e.error_at("type", message, "write `revolute` or `prismatic`; revolute may be left out"))
        }
    }
}

/// Both limits in the units of the file: `minPos` and `maxPos`, each with its default.
pub(super) fn limits(e: &Element, what: &str, min: f64, max: f64) -> Result<(f64, f64), FileError> {
    let min = e.number("minPos")?.unwrap_or(min);
    let max = e.number("maxPos")?.unwrap_or(max);
    if min > max {
        let attr = if e.get("minPos").is_some() { "minPos" } else { "maxPos" };
        return Err(e.error_at(
            attr,
            format!("limits reversed: {what} has minPos {min} above maxPos {max}"),
            "give both limits, the smaller as minPos",
        ));
    }
    Ok((min, max))
}
