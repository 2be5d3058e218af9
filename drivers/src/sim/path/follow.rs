//! Following a stream of set-points (position-direct).

use super::{Bounds, Pieces, State, trapezoid};

/// Share of the greatest speed at which set-points are followed at most; the rest is left to catch up.
const FOLLOW_SHARE: f64 = 0.95;

/// The straight leg from one set-point to the next that a motor follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leg {
    /// Position at its beginning, rad.
    pub from: f64,
    /// The newest set-point, rad.
    pub to: f64,
    /// Seconds it takes.
    pub seconds: f64,
}

impl Leg {
    /// The leg from where the set-point is now to a new one, at the stream's own rate: it takes as long as the
    /// interval between the last two set-points, or longer if the motor is not that fast.
    pub fn new(from: f64, to: f64, interval: f64, greatest: Bounds) -> Leg {
        let seconds = interval.max((to - from).abs() / (FOLLOW_SHARE * greatest.speed));
        Leg { from, to, seconds }
    }

    /// Where the followed set-point is after `t` seconds.
    pub fn at(&self, t: f64) -> f64 {
        if t >= self.seconds { self.to } else { self.from + (self.to - self.from) * t / self.seconds }
    }
}

/// Follows a leg, then stops at its end.
///
/// In the frame of the moving set-point the leg is a point at rest, and the motor is brought to it as fast as its bounds allow; it then stays on it exactly. So it
/// lags the newest set-point by one interval at most, with all motors on the straight line between set-points. Where the stream
/// ends in full motion it overshoots by its braking path. If that could leave `limits`, or the leg is too short to be caught up with, it
/// goes to the set-point without following it.
pub fn follow(from: State, leg: Leg, limits: [f64; 2], greatest: Bounds) -> Pieces {
    let stop_there = |from: State| trapezoid(from, leg.to, greatest, greatest.acceleration);
    let speed = (leg.to - leg.from) / leg.seconds;
    if !speed.is_finite() || speed == 0.0 {
        return stop_there(from);
    }
    let relative = State { v: from.v - speed, ..from };
    // room left for catching up, in the direction of the catching up, which is seen where it has braked
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
    /// The state after `t` seconds of a motion that goes on at constant speed after its last piece.
    fn at_moving(&self, t: f64) -> State {
        let s = self.at(t);
        State { q: s.q + s.v * (t - self.duration()).max(0.0), ..s }
    }
}
