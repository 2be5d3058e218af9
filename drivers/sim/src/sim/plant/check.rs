//! Checks commands against the board before any part of them is accepted.

use super::Plant;
use mobee_contract::fit::{
    ENCODER_NOISE, ROUNDING, follows, named, named_or_all, references, same_length, velocities, within,
};
use mobee_contract::{Command, ControlMode, Move};

/// Target of one motor.
#[derive(Clone, Copy, Debug)]
pub struct Destination {
    /// Index of the motor.
    pub motor: usize,
    /// Target position, rad, within limits.
    pub to: f64,
    /// Reference speed to set first, rad/s.
    pub speed: Option<f64>,
    /// Reference acceleration to set first, rad/s^2.
    pub acceleration: Option<f64>,
}

/// A command that fits the board.
#[derive(Clone, Debug)]
pub enum PlantCommand {
    /// Position moves to absolute targets.
    Move(Vec<Destination>),
    /// Setpoints of these motors.
    Direct(Vec<(usize, f64)>),
    /// Velocities of these motors.
    Velocity(Vec<(usize, f64)>),
    /// Brake these motors.
    Stop(Vec<usize>),
    /// Reference speed and acceleration of these motors.
    Reference(Vec<(usize, f64, f64)>),
    /// Control mode of these motors.
    Mode(Vec<usize>, ControlMode),
}

impl PlantCommand {
    /// True if it starts a motion.
    pub fn moves(&self) -> bool {
        matches!(self, PlantCommand::Move(_) | PlantCommand::Direct(_) | PlantCommand::Velocity(_))
    }

    /// Motors whose motion it changes.
    pub fn disturbs(&self) -> Vec<usize> {
        match self {
            PlantCommand::Move(ways) => ways.iter().map(|w| w.motor).collect(),
            PlantCommand::Direct(each) | PlantCommand::Velocity(each) => each.iter().map(|(m, _)| *m).collect(),
            PlantCommand::Stop(motors) | PlantCommand::Mode(motors, _) => motors.clone(),
            PlantCommand::Reference(_) => Vec::new(),
        }
    }
}

/// Checks a command completely.
pub fn check(plant: &Plant, command: &Command) -> Result<PlantCommand, String> {
    match command {
        Command::Move(m) => check_move(plant, m).map(PlantCommand::Move),
        Command::Direct { motors, q } => check_direct(plant, motors, q).map(PlantCommand::Direct),
        Command::Velocity { motors, speed } => velocities(&plant.axes, motors, speed).map(PlantCommand::Velocity),
        Command::Stop { motors } => named_or_all(&plant.axes, motors).map(PlantCommand::Stop),
        Command::Mode { motors, mode } => named(&plant.axes, motors).map(|_| PlantCommand::Mode(motors.clone(), *mode)),
        Command::Reference { motors, speed, acceleration } => {
            let axes = named(&plant.axes, motors)?;
            let speed = references(&axes, speed, "speed")?;
            let acceleration = references(&axes, acceleration, "acceleration")?;
            let all = motors.iter().zip(speed).zip(acceleration);
            Ok(PlantCommand::Reference(all.map(|((m, v), a)| (*m, *v, *a)).collect()))
        }
    }
}

fn check_move(plant: &Plant, m: &Move) -> Result<Vec<Destination>, String> {
    let axes = named(&plant.axes, &m.motors)?;
    same_length(m.motors.len(), m.q.len(), "positions")?;
    let optional = |list: &Option<Vec<f64>>, what| match list {
        Some(list) => references(&axes, list, what).map(|l| l.iter().copied().map(Some).collect()),
        None => Ok(vec![None; m.motors.len()]),
    };
    let speed = optional(&m.speed, "speed")?;
    let acceleration = optional(&m.acceleration, "acceleration")?;
    let now: Vec<f64> = plant.positions().collect();
    let references = speed.into_iter().zip(acceleration);
    let targets = m.motors.iter().zip(&m.q).zip(&axes);
    targets
        .zip(references)
        .map(|(((motor, q), axis), (speed, acceleration))| {
            let base = if m.relative { now.get(*motor).copied().unwrap_or_default() } else { 0.0 };
            Ok(Destination { motor: *motor, to: within(axis, base + q, ROUNDING)?, speed, acceleration })
        })
        .collect()
}

fn check_direct(plant: &Plant, motors: &[usize], q: &[f64]) -> Result<Vec<(usize, f64)>, String> {
    let axes = named(&plant.axes, motors)?;
    same_length(motors.len(), q.len(), "positions")?;
    // modes in force when the command takes effect
    let mut modes = plant.modes();
    for (_, command) in &plant.in_flight {
        let (motors, mode) = match command {
            PlantCommand::Mode(motors, mode) => (motors.clone(), *mode),
            PlantCommand::Move(_) => (command.disturbs(), ControlMode::Position),
            PlantCommand::Velocity(_) => (command.disturbs(), ControlMode::Velocity),
            _ => continue,
        };
        for m in motors {
            if let Some(slot) = modes.get_mut(m) {
                *slot = mode;
            }
        }
    }
    let each = motors.iter().zip(axes).zip(q).map(|((motor, axis), q)| {
        follows(axis, modes.get(*motor).copied())?;
        Ok((*motor, within(axis, *q, ENCODER_NOISE)?))
    });
    each.collect()
}
