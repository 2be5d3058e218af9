//! Commands, checked against boards and newest reading before anything of them is sent.

use mobee_contract::{Axis, Command, ControlMode, Move};

/// By how much (rad) a target may lie outside its limits, for rounding between degrees and radians.
const ROUNDING: f64 = 1e-9;
/// By how much (rad) a set-point may: recorded positions carry the noise of the encoders. 0.1 deg.
const ENCODER_NOISE: f64 = 0.1 * std::f64::consts::PI / 180.0;

/// What a command is checked against.
#[derive(Clone, Copy, Debug)]
pub struct Known<'a> {
    /// The motors.
    pub axes: &'a [Axis],
    /// Whether a motor has a board. One without rests at home and can only be told to stay there.
    pub driven: &'a [bool],
    /// Where they are, rad.
    pub q: &'a [f64],
    /// The modes that will be in force when the command arrives.
    pub modes: &'a [ControlMode],
}

/// A command that fits, in absolute positions within limits.
#[derive(Clone, Debug, PartialEq)]
pub enum Checked {
    /// Position moves: motors, targets, reference speeds, reference accelerations.
    Move(Vec<usize>, Vec<f64>, Option<Vec<f64>>, Option<Vec<f64>>),
    /// A set-point for every motor.
    Direct(Vec<f64>),
    /// Velocities.
    Velocity(Vec<usize>, Vec<f64>),
    /// Brake these; all if the list is empty.
    Stop(Vec<usize>),
    /// Reference speeds and accelerations.
    Reference(Vec<usize>, Vec<f64>, Vec<f64>),
    /// Control mode of these.
    Mode(Vec<usize>, ControlMode),
}

impl Checked {
    /// Whether it starts a motion.
    pub fn moves(&self) -> bool {
        matches!(self, Checked::Move(..) | Checked::Direct(_) | Checked::Velocity(..))
    }
}

impl Known<'_> {
    /// Checks all of a command.
    ///
    /// # Errors
    /// What does not fit, naming the motor.
    pub fn check(&self, command: &Command) -> Result<Checked, String> {
        match command {
            Command::Move(m) => self.check_move(m),
            Command::Direct { q } => self.check_direct(q),
            Command::Velocity { motors, speed } => self.check_velocity(motors, speed),
            Command::Stop { motors } if motors.is_empty() => Ok(Checked::Stop(Vec::new())),
            Command::Stop { motors } => self.named(motors).map(|_| Checked::Stop(motors.clone())),
            Command::Mode { motors, mode } => {
                let motors = if motors.is_empty() { (0..self.axes.len()).collect() } else { motors.clone() };
                self.named(&motors)?;
                Ok(Checked::Mode(motors, *mode))
            }
            Command::Reference { motors, speed, acceleration } => {
                self.named(motors)?;
                let speed = self.references(motors, speed, "speed", |a| a.max_speed)?;
                let acceleration = self.references(motors, acceleration, "acceleration", |a| a.max_acceleration)?;
                Ok(Checked::Reference(motors.clone(), speed, acceleration))
            }
        }
    }

    fn check_move(&self, m: &Move) -> Result<Checked, String> {
        let axes = self.named(&m.motors)?;
        same_length(m.motors.len(), m.q.len(), "positions")?;
        let optional = |list: &Option<Vec<f64>>, what, most: fn(&Axis) -> f64| match list {
            Some(list) => self.references(&m.motors, list, what, most).map(Some),
            None => Ok(None),
        };
        let speed = optional(&m.speed, "speed", |a| a.max_speed)?;
        let acceleration = optional(&m.acceleration, "acceleration", |a| a.max_acceleration)?;
        let to = m.motors.iter().zip(&m.q).zip(axes).map(|((motor, q), axis)| {
            let here = self.q.get(*motor).copied().unwrap_or(f64::NAN);
            let to = within(axis, if m.relative { here + q } else { *q }, ROUNDING)?;
            if !self.is_driven(*motor) && (to - here).abs() > ENCODER_NOISE {
                return Err(format!("motor {} has no board to move it", axis.name));
            }
            Ok(to)
        });
        Ok(Checked::Move(m.motors.clone(), to.collect::<Result<_, _>>()?, speed, acceleration))
    }

    fn check_direct(&self, q: &[f64]) -> Result<Checked, String> {
        same_length(self.axes.len(), q.len(), "positions")?;
        for (axis, mode) in self.axes.iter().zip(self.modes) {
            if *mode != ControlMode::PositionDirect {
                return Err(format!("motor {} takes no set-points: it is in mode {mode:?}", axis.name));
            }
        }
        let to = self.axes.iter().zip(q).map(|(axis, q)| within(axis, *q, ENCODER_NOISE));
        Ok(Checked::Direct(to.collect::<Result<_, _>>()?))
    }

    fn check_velocity(&self, motors: &[usize], speed: &[f64]) -> Result<Checked, String> {
        let axes = self.named(motors)?;
        same_length(motors.len(), speed.len(), "velocities")?;
        let lowered = speed.iter().zip(axes).map(|(v, axis)| match v.is_finite() {
            true => Ok(v.clamp(-axis.max_speed, axis.max_speed)),
            false => Err(format!("motor {}: the velocity is not a finite number", axis.name)),
        });
        Ok(Checked::Velocity(motors.to_vec(), lowered.collect::<Result<_, _>>()?))
    }

    fn is_driven(&self, motor: usize) -> bool {
        self.driven.get(motor) == Some(&true)
    }

    /// The axes of motors named once each.
    fn named(&self, motors: &[usize]) -> Result<Vec<&Axis>, String> {
        if motors.is_empty() {
            return Err("the command names no motor".into());
        }
        let mut seen = vec![false; self.axes.len()];
        let count = self.axes.len();
        let one = |m: &usize| match (self.axes.get(*m), seen.get_mut(*m)) {
            (Some(axis), Some(seen)) if !*seen => {
                *seen = true;
                Ok(axis)
            }
            (Some(axis), _) => Err(format!("motor {} is named twice", axis.name)),
            (None, _) => Err(format!("there is no motor {m}; the robot has {count}")),
        };
        motors.iter().map(one).collect()
    }

    /// References, lowered to what the motors can do.
    fn references(
        &self,
        motors: &[usize],
        list: &[f64],
        what: &str,
        most: fn(&Axis) -> f64,
    ) -> Result<Vec<f64>, String> {
        same_length(motors.len(), list.len(), &format!("values of {what}"))?;
        let one = |(m, value): (&usize, &f64)| {
            let Some(axis) = self.axes.get(*m) else { return Err(format!("there is no motor {m}")) };
            if !(value.is_finite() && *value >= 0.0) {
                let name = &axis.name;
                return Err(format!("motor {name}: a reference {what} of {value} is not a finite number from zero up"));
            }
            Ok(value.min(most(axis)))
        };
        motors.iter().zip(list).map(one).collect()
    }
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

fn same_length(want: usize, got: usize, what: &str) -> Result<(), String> {
    if want == got { Ok(()) } else { Err(format!("{got} {what} for {want} motors")) }
}
