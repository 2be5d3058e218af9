//! How joints move and what their motors count: the attributes `type` and `continuous`.
//!
//! ```text
//! <motor name="lift" minPos="0" maxPos="350">               350 encoder units: millimeters, since its joint slides
//!   <joint type="prismatic" z="1" minPos="0" maxPos="0.35"> in meters, as all lengths
//! ```

use super::element::{Element, Warnings};
use crate::error::FileError;
use crate::{JointMotion, Motor};
use std::f64::consts::TAU;

/// The attributes of a motor that are about its motion.
pub(super) const MOTOR: &[&str] = &["type", "continuous"];
/// How far a full turn of a motor without end may be from whole turns of its joints, turns: rounding in files.
const WHOLE: f64 = 1e-6;

/// A joint that slides farther than this is doubted, m, as a mesh of that length is.
const FAR: f64 = 10.0;

/// What is known of a motor's motion.
pub(super) struct MotorMotion {
    /// As the motor's own `type` says.
    stated: Option<JointMotion>,
    /// Whether it turns without end.
    pub(super) continuous: bool,
}

impl MotorMotion {
    /// Reads what the motor itself says.
    pub(super) fn read(e: &Element, warnings: &mut Warnings) -> Result<Self, FileError> {
        let stated = word(e, "motors")?;
        let continuous = e.flag("continuous", warnings);
        if continuous && stated == Some(JointMotion::Slide) {
            return Err(e.error_at("continuous", "what slides has an end", "leave `continuous` out"));
        }
        Ok(Self { stated, continuous })
    }

    /// What the motor counts before any joint is known.
    pub(super) fn stated(&self) -> JointMotion {
        self.stated.unwrap_or_default()
    }

    /// A joint joins the motor: without a `type` of its own, a motor counts as its joints move, which must be alike.
    ///
    /// # Errors
    /// At the joint, if it does not move as the motor's others do, or is no whole number of turns where the motor has no end.
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
            let whole =
                motion == JointMotion::Turn && (turns - turns.round()).abs() * ((max - min) / TAU).max(1.0) < WHOLE;
            if !whole {
                let message = format!("a full turn of motor `{}` does not bring this joint back", motor.name);
                let help = "a motor with continuous=\"true\" needs joints whose range is a whole multiple of its own";
                return Err(e.error_at("maxPos", message, help));
            }
        }
        Ok(())
    }
}

/// The maximum speed of a motor, if it is limited: encoder units per second in the file, rad/s of encoder here.
pub(super) fn speed_of_motor(e: &Element) -> Result<Option<f64>, FileError> {
    match e.number("maxSpeed")? {
        Some(speed) if speed <= 0.0 => {
            let help = "give degrees (or millimeters) per second above 0, or leave `maxSpeed` out";
            Err(e.error_at("maxSpeed", format!("`maxSpeed` is {speed}, but must be above 0"), help))
        }
        other => Ok(other.map(f64::to_radians)),
    }
}

/// How a joint moves.
pub(super) fn of_joint(e: &Element) -> Result<JointMotion, FileError> {
    Ok(word(e, "joints")?.unwrap_or_default())
}

/// Where a joint stands at its motor's limits, rad or meters. Warns of one that slides so far that millimeters may be meant.
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
            if let Some((attr, far)) = [("minPos", min), ("maxPos", max)].into_iter().find(|(_, at)| at.abs() > FAR) {
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

/// Both limits as written: `minPos` and `maxPos`, each with its default.
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
