//! Checks of commands that all boards share: existing motors, finite numbers, positions within limits.

use crate::{Axis, ControlMode};

/// Tolerance of targets beyond their limits, rad, for rounding between degrees and radians.
pub const ROUNDING: f64 = 1e-9;
/// Tolerance of setpoints beyond their limits, rad: recorded positions carry encoder noise. 0.1 deg.
pub const ENCODER_NOISE: f64 = 0.1 * std::f64::consts::PI / 180.0;

/// Axes of motors, each of which is named once.
pub fn named<'a>(axes: &'a [Axis], motors: &[usize]) -> Result<Vec<&'a Axis>, String> {
    if motors.is_empty() {
        return Err("the command names no motor".into());
    }
    let mut seen = vec![false; axes.len()];
    let one = |m: &usize| match (axes.get(*m), seen.get_mut(*m)) {
        (Some(axis), Some(seen)) if !*seen => {
            *seen = true;
            Ok(axis)
        }
        (Some(axis), _) => Err(format!("motor {} is named twice", axis.name)),
        (None, _) => Err(format!("there is no motor {m}; the board has {}", axes.len())),
    };
    motors.iter().map(one).collect()
}

/// Motors of a command, each named once, or all if none is named.
pub fn named_or_all(axes: &[Axis], motors: &[usize]) -> Result<Vec<usize>, String> {
    if motors.is_empty() {
        return Ok((0..axes.len()).collect());
    }
    named(axes, motors).map(|_| motors.to_vec())
}

/// Velocities by motor; velocities beyond an axis's speed limit are lowered to it, as boards do.
pub fn velocities(axes: &[Axis], motors: &[usize], speed: &[f64]) -> Result<Vec<(usize, f64)>, String> {
    let named = named(axes, motors)?;
    same_length(motors.len(), speed.len(), "velocities")?;
    let each = motors.iter().zip(speed).zip(named);
    each.map(|((motor, v), axis)| match v.is_finite() {
        true => Ok((*motor, v.clamp(-axis.max_speed, axis.max_speed))),
        false => Err(format!("motor {}: the velocity is not a finite number", axis.name)),
    })
    .collect()
}

/// Checks references of these motors: finite, zero or above.
pub fn references<'a>(named: &[&Axis], list: &'a [f64], what: &str) -> Result<&'a [f64], String> {
    same_length(named.len(), list.len(), &format!("values of {what}"))?;
    for (axis, value) in named.iter().zip(list) {
        if !(value.is_finite() && *value >= 0.0) {
            let name = &axis.name;
            return Err(format!("motor {name}: a reference {what} of {value} is not a finite number from zero up"));
        }
    }
    Ok(list)
}

/// Clamps a position that exceeds the axis's limits by no more than `tolerance`.
pub fn within(axis: &Axis, q: f64, tolerance: f64) -> Result<f64, String> {
    let Axis { name, min, max, motion, .. } = axis;
    if !q.is_finite() {
        return Err(format!("motor {name}: the position is not a finite number"));
    }
    if q < min - tolerance || q > max + tolerance {
        let q = motion.told(q, 3);
        let limits = motion.told_range([*min, *max], 3);
        return Err(format!("motor {name}: {q} is outside its limits {limits}"));
    }
    Ok(q.clamp(*min, *max))
}

/// Checks that a motor is in the mode for setpoints.
pub fn follows(axis: &Axis, mode: Option<ControlMode>) -> Result<(), String> {
    match mode {
        Some(ControlMode::PositionDirect) => Ok(()),
        mode => Err(format!(
            "motor {} takes no set-points: it is in mode {:?}",
            axis.name,
            mode.unwrap_or(ControlMode::Idle)
        )),
    }
}

/// Checks that a list has a value for each of the motors.
pub fn same_length(want: usize, got: usize, what: &str) -> Result<(), String> {
    if want == got { Ok(()) } else { Err(format!("{got} {what} for {want} motors")) }
}
