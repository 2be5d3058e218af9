//! A parsed command of the streaming port `command:i` (spec section 13).

use super::joints::{CodeSuffix, Joints};
use crate::{Bottle, Value, Vocab};

/// Setpoints, which have no answer. Values are finite; in degrees, or meters for prismatic joints.
#[derive(Clone, Debug, PartialEq)]
pub enum Streamed {
    /// Velocities, deg/s.
    Velocity(Joints, Vec<f64>),
    /// Position-direct setpoints, deg.
    Direct(Joints, Vec<f64>),
    /// A position move of all joints, deg.
    Move(Vec<f64>),
}

const VELOCITY: Vocab = Vocab::new("vmo");
const DIRECT: Vocab = Vocab::new("dpo");
const MOVE: Vocab = Vocab::new("poss");

impl Streamed {
    /// Parses a command for a board with this number of axes. `None` for an unknown command (torque, current
    /// and PWM included), a joint that does not exist, a body of the wrong length (the original server
    /// accepts short ones, with undefined effect), or a number that is not finite.
    pub fn parse(head: &Bottle, body: &[f64], axes: usize) -> Option<Streamed> {
        let (code, rest) = head.0.split_first()?;
        let code = code.as_vocab()?;
        let (family, joints) = if code == MOVE {
            (MOVE, Joints::All)
        } else {
            let (family, shape) = CodeSuffix::of(code)?;
            (family, Joints::read(shape, rest)?.0)
        };
        let fits = joints.on(axes)?.len() == body.len() && !body.is_empty() && body.iter().all(|v| v.is_finite());
        match family {
            _ if !fits => None,
            VELOCITY => Some(Streamed::Velocity(joints, body.to_vec())),
            DIRECT => Some(Streamed::Direct(joints, body.to_vec())),
            MOVE => Some(Streamed::Move(body.to_vec())),
            _ => None,
        }
    }

    /// Head and body as the original client writes them.
    pub fn pair(&self) -> (Bottle, Vec<f64>) {
        let mut head = Vec::new();
        let mut word = |code: Vocab, joints: &Joints| {
            head.push(Value::Vocab(code));
            joints.write(&mut head);
        };
        let body = match self {
            Streamed::Velocity(joints, body) => {
                word(joints.shape().code(VELOCITY), joints);
                body
            }
            Streamed::Direct(joints, body) => {
                word(joints.shape().code(DIRECT), joints);
                body
            }
            Streamed::Move(body) => {
                word(MOVE, &Joints::All);
                body
            }
        };
        (Bottle(head), body.clone())
    }
}
