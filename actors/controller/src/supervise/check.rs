//! First checks of a commit (I5).
//!
//! They come before all others, so that an agent is notified of its errors in any state of the robot. The command
//! guard repeats them in front of the driver: there, a violation is a defect of this program; here, it is an answer
//! to an agent.

use crate::Rules;
use mobee_contract::{Commit, Refusal, Setpoints, Target, Values};
use mobee_model::JointMotion;

/// Checks whether the target fits the board.
///
/// # Errors
/// The first violation.
pub fn check(target: &Target, rules: &Rules) -> Result<(), Refusal> {
    // Written so that NaN is refused, unlike `<= 0.0 ||`.
    if !(target.speed > 0.0 && target.speed <= 1.0) {
        return Err(Refusal::Speed { speed: target.speed.to_string() });
    }
    shape(&target.motors, &target.q, rules)?;
    limits(&target.motors, &target.q, rules)
}

/// Checks whether set-points fit the board. Velocities have no limits here: they are lowered to those of the motors.
///
/// # Errors
/// The first violation.
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

/// Checks that each motor is named once, with one finite number: a motor named twice would have two targets.
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

/// Checks that each position is within its motor's limits, inclusive, rad. The refusal has degrees or millimeters, as
/// users give them.
///
/// # Errors
/// The first violation.
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

/// Checks whether the commit's own speeds, if it has any, fit its target.
///
/// # Errors
/// The first violation.
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
