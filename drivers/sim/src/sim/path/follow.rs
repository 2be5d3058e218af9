//! Motion along a stream of setpoints (position-direct).

use super::{Bounds, Pieces, State, trapezoid};

/// Largest share of the greatest speed at which setpoints are followed; the rest is reserved for catching up.
const FOLLOW_SHARE: f64 = 0.95;

/// Straight leg between two setpoints that a motor follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leg {
    /// Position at its beginning, rad.
    pub from: f64,
    /// Newest setpoint, rad.
    pub to: f64,
    /// Duration, s.
    pub seconds: f64,
}

impl Leg {
    /// Creates the leg from the present position of the setpoint to a new one, at the rate of the stream: it
    /// lasts as long as the interval between the last two setpoints, or longer if the motor is too slow.
    pub fn new(from: f64, to: f64, interval: f64, greatest: Bounds) -> Leg {
        let seconds = interval.max((to - from).abs() / (FOLLOW_SHARE * greatest.speed));
        Leg { from, to, seconds }
    }

    /// Position of the moving setpoint after `t` seconds.
    pub fn at(&self, t: f64) -> f64 {
        if t >= self.seconds { self.to } else { self.from + (self.to - self.from) * t / self.seconds }
    }
}

/// Follows a leg, then stops at its end.
///
/// In the frame of the moving setpoint the leg is a point at rest. The motor is brought to this point as fast
/// as its bounds allow, and then stays on it exactly. So it lags the newest setpoint by at most one interval,
/// with all motors on the straight line between setpoints. If the stream ends in full motion, the motor
/// overshoots by its braking path. If that could leave `limits`, or if the leg is too short to be caught up
/// with, it goes to the setpoint without following it.
pub fn follow(from: State, leg: Leg, limits: [f64; 2], greatest: Bounds) -> Pieces {
    let stop_there = |from: State| trapezoid(from, leg.to, greatest, greatest.acceleration);
    let speed = (leg.to - leg.from) / leg.seconds;
    if !speed.is_finite() || speed == 0.0 {
        return stop_there(from);
    }
    let relative = State { v: from.v - speed, ..from };
    // speed available for catching up, in the direction of the position error after braking
    let room = greatest.speed - speed * (leg.from - relative.stopping_point(greatest.acceleration)).signum();
    let bounds = Bounds { speed: room, ..greatest };
    let chase = trapezoid(relative, leg.from, bounds, greatest.acceleration).in_moving_frame(speed);
    let path = chase.then(leg.seconds, &stop_there(chase.at_moving(leg.seconds)));
    let [min, max] = limits;
    let inside = |q: f64| (min..=max).contains(&q);
    let safe = path.joints().all(|(_, s)| inside(s.stopping_point(greatest.acceleration)) && inside(s.q));
    if safe { path } else { stop_there(from) }
}

impl Pieces {
    /// State after `t` seconds of a motion that continues at constant speed after its last piece.
    fn at_moving(&self, t: f64) -> State {
        let s = self.at(t);
        State { q: s.q + s.v * (t - self.duration()).max(0.0), ..s }
    }
}
