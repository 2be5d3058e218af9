//! Commands, checked against the board before any of them is believed.

use super::Plant;
use mobee_contract::{Axis, Command, ControlMode, Move};

/// By how much (rad) a target may lie outside its limits, for rounding between degrees and radians.
const ROUNDING: f64 = 1e-9;
/// By how much (rad) a set-point may: recorded positions carry the noise of the encoders. 0.1 deg.
const ENCODER_NOISE: f64 = 0.1 * std::f64::consts::PI / 180.0;

/// Where one motor is to go.
#[derive(Clone, Copy, Debug)]
pub struct Way {
    /// Its index.
    pub motor: usize,
    /// Where to, rad, within limits.
    pub to: f64,
    /// Reference speed to set first, rad/s.
    pub speed: Option<f64>,
    /// Reference acceleration to set first, rad/s^2.
    pub acceleration: Option<f64>,
}

/// A command that fits the board.
#[derive(Clone, Debug)]
pub enum Checked {
    /// Position moves to absolute targets.
    Move(Vec<Way>),
    /// A set-point for every motor.
    Direct(Vec<f64>),
    /// Velocities of these.
    Velocity(Vec<(usize, f64)>),
    /// Brake these.
    Stop(Vec<usize>),
    /// Reference speed and acceleration of these.
    Reference(Vec<(usize, f64, f64)>),
    /// Control mode of these.
    Mode(Vec<usize>, ControlMode),
}

impl Checked {
    /// Whether it starts a motion.
    pub fn moves(&self) -> bool {
        matches!(self, Checked::Move(_) | Checked::Direct(_) | Checked::Velocity(_))
    }

    /// The motors whose motion it changes.
    pub fn disturbs(&self) -> Vec<usize> {
        match self {
            Checked::Move(ways) => ways.iter().map(|w| w.motor).collect(),
            Checked::Direct(q) => (0..q.len()).collect(),
            Checked::Velocity(speeds) => speeds.iter().map(|(m, _)| *m).collect(),
            Checked::Stop(motors) | Checked::Mode(motors, _) => motors.clone(),
            Checked::Reference(_) => Vec::new(),
        }
    }
}

/// Checks all of a command.
pub fn check(plant: &Plant, command: &Command) -> Result<Checked, String> {
    match command {
        Command::Move(m) => check_move(plant, m).map(Checked::Move),
        Command::Direct { q } => check_direct(plant, q).map(Checked::Direct),
        Command::Velocity { motors, speed } => check_velocity(plant, motors, speed).map(Checked::Velocity),
        Command::Stop { motors } => indices(plant, motors).map(Checked::Stop),
        Command::Mode { motors, mode } => Ok(Checked::Mode(indices(plant, motors)?, *mode)),
        Command::Reference { motors, speed, acceleration } => {
            named(plant, motors)?;
            let speed = references(plant, motors, speed, "speed")?;
            let acceleration = references(plant, motors, acceleration, "acceleration")?;
            let all = motors.iter().zip(speed).zip(acceleration);
            Ok(Checked::Reference(all.map(|((m, v), a)| (*m, *v, *a)).collect()))
        }
    }
}

fn check_move(plant: &Plant, m: &Move) -> Result<Vec<Way>, String> {
    let axes = named(plant, &m.motors)?;
    same_length(m.motors.len(), m.q.len(), "positions")?;
    let optional = |list: &Option<Vec<f64>>, what| match list {
        Some(list) => references(plant, &m.motors, list, what).map(|l| l.iter().copied().map(Some).collect()),
        None => Ok(vec![None; m.motors.len()]),
    };
    let speed = optional(&m.speed, "speed")?;
    let acceleration = optional(&m.acceleration, "acceleration")?;
    let now: Vec<f64> = plant.positions().collect();
    let references = speed.into_iter().zip(acceleration);
    let targets = m.motors.iter().zip(&m.q).zip(axes);
    targets
        .zip(references)
        .map(|(((motor, q), axis), (speed, acceleration))| {
            let base = if m.relative { now.get(*motor).copied().unwrap_or_default() } else { 0.0 };
            Ok(Way { motor: *motor, to: within(axis, base + q, ROUNDING)?, speed, acceleration })
        })
        .collect()
}

fn check_direct(plant: &Plant, q: &[f64]) -> Result<Vec<f64>, String> {
    same_length(plant.axes.len(), q.len(), "positions")?;
    // the modes that will be in force when it takes effect
    let mut modes = plant.modes();
    for (_, command) in &plant.in_flight {
        let (motors, mode) = match command {
            Checked::Mode(motors, mode) => (motors.clone(), *mode),
            Checked::Move(_) => (command.disturbs(), ControlMode::Position),
            Checked::Velocity(_) => (command.disturbs(), ControlMode::Velocity),
            _ => continue,
        };
        for m in motors {
            if let Some(slot) = modes.get_mut(m) {
                *slot = mode;
            }
        }
    }
    for (axis, mode) in plant.axes.iter().zip(modes) {
        if mode != ControlMode::PositionDirect {
            return Err(format!("motor {} takes no set-points: it is in mode {mode:?}", axis.name));
        }
    }
    plant.axes.iter().zip(q).map(|(axis, q)| within(axis, *q, ENCODER_NOISE)).collect()
}

/// Velocities; what exceeds an axis is lowered to what it can do, as boards do.
fn check_velocity(plant: &Plant, motors: &[usize], speed: &[f64]) -> Result<Vec<(usize, f64)>, String> {
    let axes = named(plant, motors)?;
    same_length(motors.len(), speed.len(), "velocities")?;
    let each = motors.iter().zip(speed).zip(axes);
    each.map(|((motor, v), axis)| {
        if !v.is_finite() {
            return Err(format!("motor {}: the velocity is not a finite number", axis.name));
        }
        Ok((*motor, v.clamp(-axis.max_speed, axis.max_speed)))
    })
    .collect()
}

/// The position within the axis' limits, if it exceeds them by no more than `tolerance`.
fn within(axis: &Axis, q: f64, tolerance: f64) -> Result<f64, String> {
    let Axis { name, min, max, .. } = axis;
    if !q.is_finite() {
        return Err(format!("motor {name}: the position is not a finite number"));
    }
    if q < min - tolerance || q > max + tolerance {
        let [q, min, max] = [q, *min, *max].map(f64::to_degrees);
        return Err(format!("motor {name}: {q:.3} deg is outside its limits {min:.3} to {max:.3} deg"));
    }
    Ok(q.clamp(*min, *max))
}

/// The axes of motors named once each.
fn named<'a>(plant: &'a Plant, motors: &[usize]) -> Result<Vec<&'a Axis>, String> {
    if motors.is_empty() {
        return Err("the command names no motor".into());
    }
    let mut seen = vec![false; plant.axes.len()];
    let count = plant.axes.len();
    motors
        .iter()
        .map(|m| match (plant.axes.get(*m), seen.get_mut(*m)) {
            (Some(axis), Some(seen)) if !*seen => {
                *seen = true;
                Ok(axis)
            }
            (Some(axis), _) => Err(format!("motor {} is named twice", axis.name)),
            (None, _) => Err(format!("there is no motor {m}; the board has {count}")),
        })
        .collect()
}

/// These motors, or all if none is named.
fn indices(plant: &Plant, motors: &[usize]) -> Result<Vec<usize>, String> {
    if motors.is_empty() {
        return Ok((0..plant.axes.len()).collect());
    }
    named(plant, motors)?;
    Ok(motors.to_vec())
}

fn references<'a>(plant: &Plant, motors: &[usize], list: &'a [f64], what: &str) -> Result<&'a [f64], String> {
    same_length(motors.len(), list.len(), &format!("values of {what}"))?;
    for (m, value) in motors.iter().zip(list) {
        if !(value.is_finite() && *value >= 0.0) {
            let name = plant.axes.get(*m).map_or("", |a| a.name.as_str());
            return Err(format!("motor {name}: a reference {what} of {value} is not a finite number from zero up"));
        }
    }
    Ok(list)
}

fn same_length(want: usize, got: usize, what: &str) -> Result<(), String> {
    if want == got { Ok(()) } else { Err(format!("{got} {what} for {want} motors")) }
}
