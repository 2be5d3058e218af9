//! What a commit must satisfy before anything else is asked (I5).
//!
//! First of all, so that what an agent got wrong is said to it whatever state the robot is in. The command guard asks
//! the same again before the driver: there it is a defect of ours, here an answer to a stranger.

use crate::Rules;
use mobee_contract::{Commit, Refusal, Setpoints, Target, Values};
use mobee_model::JointMotion;

/// Whether the target fits the board.
///
/// # Errors
/// The first thing that does not.
pub fn check(target: &Target, rules: &Rules) -> Result<(), Refusal> {
    // so, and not `<= 0.0 ||`: it is false for what is no number
    if !(target.speed > 0.0 && target.speed <= 1.0) {
        return Err(Refusal::Speed { speed: target.speed.to_string() });
    }
    shape(&target.motors, &target.q, rules)?;
    limits(&target.motors, &target.q, rules)
}

/// Whether set-points fit the board. Velocities have no limits here: they are lowered to what the motors can do.
///
/// # Errors
/// The first thing that does not.
pub fn check_setpoints(setpoints: &Setpoints, rules: &Rules) -> Result<(), Refusal> {
    match &setpoints.values {
        Values::Position(_) if !rules.position_direct => Err(Refusal::Malformed {
            what: "the board takes no set-points of position; commit moves, or stream velocities".into(),
        }),
        Values::Position(q) => {
            shape(&setpoints.motors, q, rules)?;
            limits(&setpoints.motors, q, rules)
        }
        Values::Velocity(v) => shape(&setpoints.motors, v, rules),
    }
}

/// Each motor once, with one finite number: a motor that is named twice would be asked for two things at once.
fn shape(motors: &[usize], values: &[f64], rules: &Rules) -> Result<(), Refusal> {
    let malformed = |what: String| Err(Refusal::Malformed { what });
    if motors.is_empty() {
        return malformed("it names no motor".into());
    }
    if motors.len() != values.len() {
        return malformed(format!("{} motors with {} values", motors.len(), values.len()));
    }
    let mut seen = vec![false; rules.axes.len()];
    for (motor, value) in motors.iter().zip(values) {
        let (Some(axis), Some(seen)) = (rules.axes.get(*motor), seen.get_mut(*motor)) else {
            return malformed(format!("there is no motor {motor}; the board has {}", rules.axes.len()));
        };
        if std::mem::replace(seen, true) {
            return malformed(format!("motor {} is named twice", axis.name));
        }
        if !value.is_finite() {
            return Err(Refusal::NotFinite { motor: axis.name.clone() });
        }
    }
    Ok(())
}

/// Each position within its motor's limits, which are inclusive, rad; the refusal tells degrees or millimeters, as people give them.
///
/// # Errors
/// The first that is not.
fn limits(motors: &[usize], q: &[f64], rules: &Rules) -> Result<(), Refusal> {
    for (motor, q) in motors.iter().zip(q) {
        let Some(axis) = rules.axes.get(*motor) else { continue };
        if *q < axis.min || *q > axis.max {
            return Err(Refusal::Limits {
                motor: axis.name.clone(),
                q_deg: q.to_degrees(),
                min_deg: axis.min.to_degrees(),
                max_deg: axis.max.to_degrees(),
                motion: axis.motion,
            });
        }
    }
    Ok(())
}

/// Whether the commit's own speeds, if it has any, fit its target.
///
/// # Errors
/// The first that does not.
pub fn check_speeds(commit: &Commit, rules: &Rules) -> Result<(), Refusal> {
    let Some(speeds) = &commit.speeds else { return Ok(()) };
    let motors = &commit.target.motors;
    if speeds.len() != motors.len() {
        return Err(Refusal::Malformed { what: format!("{} motors with {} speeds", motors.len(), speeds.len()) });
    }
    for (motor, speed) in motors.iter().zip(speeds) {
        if !(speed.is_finite() && *speed > 0.0) {
            let axis = rules.axes.get(*motor);
            let (name, motion) = axis.map_or(("?", JointMotion::Turn), |a| (a.name.as_str(), a.motion));
            let speed = motion.told_speed(*speed, 3);
            return Err(Refusal::Malformed { what: format!("a speed of {speed} for motor {name}") });
        }
    }
    Ok(())
}
