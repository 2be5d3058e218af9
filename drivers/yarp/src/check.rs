//! Checks commands against boards and newest reading before any part of them is sent.

use mobee_contract::fit::{ENCODER_NOISE, ROUNDING, follows, named, references, same_length, velocities, within};
use mobee_contract::{Axis, Command, ControlMode, Move};

/// State that commands are checked against.
#[derive(Clone, Copy, Debug)]
pub struct CheckedAgainst<'a> {
    /// The motors.
    pub axes: &'a [Axis],
    /// True for motors with a board. A motor without one rests at home and accepts only a command to stay
    /// there.
    pub driven: &'a [bool],
    /// Measured positions, rad.
    pub q: &'a [f64],
    /// Control modes in force when the command arrives.
    pub modes: &'a [ControlMode],
}

/// A valid command, in absolute positions within limits.
#[derive(Clone, Debug, PartialEq)]
pub enum CheckedCommand {
    /// Position moves: motors, targets, reference speeds, reference accelerations.
    Move(Vec<usize>, Vec<f64>, Option<Vec<f64>>, Option<Vec<f64>>),
    /// Set-points.
    Direct(Vec<usize>, Vec<f64>),
    /// Velocities.
    Velocity(Vec<usize>, Vec<f64>),
    /// Brake these motors; all if the list is empty.
    Stop(Vec<usize>),
    /// Reference speeds and accelerations.
    Reference(Vec<usize>, Vec<f64>, Vec<f64>),
    /// Control mode of these motors.
    Mode(Vec<usize>, ControlMode),
}

impl CheckedCommand {
    /// True if it starts a motion.
    pub fn moves(&self) -> bool {
        matches!(self, CheckedCommand::Move(..) | CheckedCommand::Direct(..) | CheckedCommand::Velocity(..))
    }
}

impl CheckedAgainst<'_> {
    /// Checks a command completely.
    ///
    /// # Errors
    /// The part that does not fit, naming the motor.
    pub fn check(&self, command: &Command) -> Result<CheckedCommand, String> {
        match command {
            Command::Move(m) => self.check_move(m),
            Command::Direct { motors, q } => self.check_direct(motors, q),
            Command::Velocity { motors, speed } => {
                let (motors, speed) = velocities(self.axes, motors, speed)?.into_iter().unzip();
                Ok(CheckedCommand::Velocity(motors, speed))
            }
            Command::Stop { motors } if motors.is_empty() => Ok(CheckedCommand::Stop(Vec::new())),
            Command::Stop { motors } => named(self.axes, motors).map(|_| CheckedCommand::Stop(motors.clone())),
            Command::Mode { motors, mode } => {
                named(self.axes, motors).map(|_| CheckedCommand::Mode(motors.clone(), *mode))
            }
            Command::Reference { motors, speed, acceleration } => {
                let axes = named(self.axes, motors)?;
                let speed = lowered(&axes, speed, "speed", |a| a.max_speed)?;
                let acceleration = lowered(&axes, acceleration, "acceleration", |a| a.max_acceleration)?;
                Ok(CheckedCommand::Reference(motors.clone(), speed, acceleration))
            }
        }
    }

    fn check_move(&self, m: &Move) -> Result<CheckedCommand, String> {
        let axes = named(self.axes, &m.motors)?;
        same_length(m.motors.len(), m.q.len(), "positions")?;
        let optional = |list: &Option<Vec<f64>>, what, most: fn(&Axis) -> f64| match list {
            Some(list) => lowered(&axes, list, what, most).map(Some),
            None => Ok(None),
        };
        let speed = optional(&m.speed, "speed", |a| a.max_speed)?;
        let acceleration = optional(&m.acceleration, "acceleration", |a| a.max_acceleration)?;
        let to = m.motors.iter().zip(&m.q).zip(&axes).map(|((motor, q), axis)| {
            let here = self.q.get(*motor).copied().unwrap_or(f64::NAN);
            let to = within(axis, if m.relative { here + q } else { *q }, ROUNDING)?;
            if !self.is_driven(*motor) && (to - here).abs() > ENCODER_NOISE {
                return Err(format!("motor {} has no board to move it", axis.name));
            }
            Ok(to)
        });
        Ok(CheckedCommand::Move(m.motors.clone(), to.collect::<Result<_, _>>()?, speed, acceleration))
    }

    fn check_direct(&self, motors: &[usize], q: &[f64]) -> Result<CheckedCommand, String> {
        let axes = named(self.axes, motors)?;
        same_length(motors.len(), q.len(), "positions")?;
        let to = motors.iter().zip(axes).zip(q).map(|((motor, axis), q)| {
            follows(axis, self.modes.get(*motor).copied())?;
            within(axis, *q, ENCODER_NOISE)
        });
        Ok(CheckedCommand::Direct(motors.to_vec(), to.collect::<Result<_, _>>()?))
    }

    fn is_driven(&self, motor: usize) -> bool {
        self.driven.get(motor) == Some(&true)
    }
}

/// References, lowered to the limits of the motors.
fn lowered(axes: &[&Axis], list: &[f64], what: &str, most: fn(&Axis) -> f64) -> Result<Vec<f64>, String> {
    Ok(references(axes, list, what)?.iter().zip(axes).map(|(value, axis)| value.min(most(axis))).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A motor without a board keeps its position, within the encoders' resolution, and may be commanded to
    /// that position.
    #[test]
    fn what_has_no_board_is_not_moved() {
        let axis = Axis {
            name: "alone".into(),
            min: -1.0,
            max: 1.0,
            max_speed: 1.0,
            max_acceleration: 1.0,
            ..Default::default()
        };
        let goes = |driven: bool, here: f64, to: f64| {
            let axes = [axis.clone()];
            let driven = [driven];
            let q = [here];
            let known = CheckedAgainst { axes: &axes, driven: &driven, q: &q, modes: &[ControlMode::Position] };
            let to = Move { motors: vec![0], q: vec![to], relative: false, speed: None, acceleration: None };
            known.check(&Command::Move(to)).is_ok()
        };
        let far = 2.0 * ENCODER_NOISE;
        assert!(goes(false, 0.5, 0.5) && goes(false, 0.0, ENCODER_NOISE));
        assert!(!goes(false, 0.5, 0.5 + far) && !goes(false, 0.5, 0.5 - far) && goes(true, 0.5, 0.5 + far));
    }
}
