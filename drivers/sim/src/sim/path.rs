//! Path of one motor over time, in closed form: position, speed, and time of the stop.
//!
//! ```text
//! trapezoidal   accelerate, cruise, decelerate: pieces of constant acceleration
//! minimum_jerk  one polynomial of degree five
//! gain          speed in proportion to the remaining distance
//! brake         one piece at the greatest deceleration
//! cruise        go at a velocity for a while, then brake (velocity move)
//! follow        catch up with a moving setpoint, stay on it, then stop there (position-direct)
//! ```
//! A path has a bounded speed and acceleration, starts from any position and speed without a jump in either,
//! and ends at rest. The exception is the path of a gain, whose speed jumps.

mod approach;
mod cruise;
mod follow;
mod pieces;
mod quintic;

pub use approach::Approach;
pub use cruise::cruise;
pub use follow::{Leg, follow};
pub use pieces::{Pieces, brake, trapezoid};
pub use quintic::Quintic;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Shape of a board's position moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Profile {
    /// Minimum-jerk trajectories, as on the control boards of the iCub.
    #[default]
    MinimumJerk,
    /// Constant acceleration, constant speed, constant deceleration.
    Trapezoidal,
    /// Speed in proportion to the remaining distance and the reference speed; starts at once, and is done
    /// within a degree. As iCub_SIM does.
    Gain,
}

/// State of a motor: position (rad), speed (rad/s), acceleration (rad/s^2).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct State {
    /// Position, rad.
    pub q: f64,
    /// Speed, rad/s.
    pub v: f64,
    /// Acceleration, rad/s^2.
    pub a: f64,
}

impl State {
    /// State at rest at `q`.
    pub fn rest(q: f64) -> State {
        State { q, v: 0.0, a: 0.0 }
    }
}

/// Speed (rad/s) and acceleration (rad/s^2) that a path may use.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Speed, rad/s, above zero.
    pub speed: f64,
    /// Acceleration, rad/s^2, above zero.
    pub acceleration: f64,
}

/// Motion of a motor, as a function of the seconds since it began.
#[derive(Clone, Debug, PartialEq)]
pub enum Path {
    /// Rests at this position.
    Rest(f64),
    /// Moves in pieces of constant acceleration.
    Pieces(Box<Pieces>),
    /// Moves along a polynomial.
    Quintic(Quintic),
    /// Approaches the target as a gain does.
    Approach(Approach),
}

impl Path {
    /// Position move from `from` to a rest at `to`.
    ///
    /// `reference` holds the bounds of the move, `greatest` those of the motor; the latter are used only to
    /// brake where the former would overshoot. A minimum-jerk move that starts from rest takes `T = max(1.875
    /// d / speed, sqrt(5.774 d / acceleration))`, at which the peaks of speed and acceleration equal the
    /// references (Flash and Hogan, 1985). One that starts in mid-motion uses the shortest such polynomial
    /// found that neither turns back nor violates the bounds, or a trapezoid if there is none.
    pub fn to(profile: Profile, from: State, to: f64, reference: Bounds, greatest: Bounds) -> Path {
        if from.v == 0.0 && from.q == to {
            return Path::Rest(to);
        }
        let quintic = match profile {
            Profile::MinimumJerk => Quintic::to(from, to, reference),
            Profile::Trapezoidal => None,
            Profile::Gain => return Path::Approach(Approach::to(from, to, reference.speed, greatest.speed)),
        };
        match quintic {
            Some(q) => Path::Quintic(q),
            None => Path::Pieces(Box::new(trapezoid(from, to, reference, greatest.acceleration))),
        }
    }

    /// State after `t` seconds.
    pub fn at(&self, t: f64) -> State {
        match self {
            Path::Rest(q) => State::rest(*q),
            Path::Pieces(p) => p.at(t),
            Path::Quintic(p) => p.at(t),
            Path::Approach(p) => p.at(t),
        }
    }

    /// Seconds from the beginning to the rest.
    pub fn duration(&self) -> f64 {
        match self {
            Path::Rest(_) => 0.0,
            Path::Pieces(p) => p.duration(),
            Path::Quintic(p) => p.duration(),
            Path::Approach(p) => p.duration(),
        }
    }

    /// Seconds from the beginning until the board reports done.
    pub fn done(&self) -> f64 {
        match self {
            Path::Approach(p) => p.done(),
            path => path.duration(),
        }
    }

    /// Final position, rad.
    pub fn end(&self) -> f64 {
        match self {
            Path::Rest(q) => *q,
            Path::Pieces(p) => p.end(),
            Path::Quintic(p) => p.end(),
            Path::Approach(p) => p.end(),
        }
    }
}
