//! Move of a gain: the speed is in proportion to the remaining distance.

use super::State;

/// Speed by distance and reference speed, as measured on iCub_SIM, 1/rad: at a reference of 10 deg/s a move
/// of 33 degrees starts at 35 deg/s.
const GAIN: f64 = 6.0;
/// Gain of the derivative, which brakes a little, s.
const DERIVATIVE: f64 = 0.3;
/// Remaining distance at which the motor rests, rad.
const REST_DISTANCE_RAD: f64 = 1e-6;
/// Remaining distance at which the board reports done, rad.
const DONE: f64 = std::f64::consts::PI / 180.0;

/// A move to `to`, which starts at the greatest speed where the gain commands more. It starts at once,
/// whatever the motor did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Approach {
    from: f64,
    to: f64,
    /// Rate of the approach, 1/s.
    rate: f64,
    /// Duration of the phase at the greatest speed, s, and that speed, rad/s.
    full: f64,
    greatest: f64,
}

impl Approach {
    /// Creates a move from rest or in mid-motion, with this reference speed and at no more than the greatest
    /// one, rad/s.
    pub fn to(from: State, to: f64, reference: f64, greatest: f64) -> Approach {
        let rate = GAIN * reference / (1.0 + DERIVATIVE * reference);
        let way = (to - from.q).abs();
        // distance at which the gain commands the greatest speed
        let near = greatest / rate;
        Approach { from: from.q, to, rate, full: ((way - near) / greatest).max(0.0), greatest }
    }

    /// State after `t` seconds.
    pub fn at(&self, t: f64) -> State {
        let way = self.to - self.from;
        if t < self.full {
            return State { q: self.from + way.signum() * self.greatest * t, v: way.signum() * self.greatest, a: 0.0 };
        }
        if t >= self.duration() {
            return State::rest(self.to);
        }
        let left = (way - way.signum() * self.greatest * self.full) * (-self.rate * (t - self.full)).exp();
        State { q: self.to - left, v: self.rate * left, a: -self.rate * self.rate * left }
    }

    /// Seconds until it rests.
    pub fn duration(&self) -> f64 {
        self.until(REST_DISTANCE_RAD)
    }

    /// Seconds until the board reports done.
    pub fn done(&self) -> f64 {
        self.until(DONE)
    }

    /// Final position, rad.
    pub fn end(&self) -> f64 {
        self.to
    }

    fn until(&self, left: f64) -> f64 {
        let way = (self.to - self.from).abs() - self.greatest * self.full;
        self.full + ((way / left).ln() / self.rate).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Figures measured on iCub_SIM: an initial speed of 35 deg/s for a commanded 10 deg/s, a time constant of
    /// 0.95 s, and done within 1 deg of the target.
    #[test]
    fn a_gain_is_as_fast_as_the_way_is_far() {
        let rad = f64::to_radians;
        let move_ = Approach::to(State::rest(0.0), rad(33.0), rad(10.0), rad(100.0));
        let v = |t: f64| move_.at(t).v.to_degrees();
        assert!((v(0.0) - 34.0).abs() < 2.0, "{}", v(0.0));
        let constant = (v(0.0) / v(1.0)).ln().recip();
        assert!((constant - 0.95).abs() < 0.1, "{constant}");
        let done = move_.at(move_.done()).q.to_degrees();
        assert!((done - 32.0).abs() < 1e-6 && move_.duration() > 3.0 * move_.done() / 2.0, "{done}");
        assert_eq!(move_.at(1e3), State::rest(rad(33.0)));
        // long moves start at the greatest speed, and position and speed are continuous at the switch to the
        // proportional law
        let far = Approach::to(State::rest(0.0), rad(-200.0), rad(40.0), rad(100.0));
        assert_eq!(far.at(0.0).v.to_degrees(), -100.0);
        let there = |t: f64| far.at(far.full + t);
        assert!((there(-1e-9).q - there(1e-9).q).abs() < 1e-6 && (there(-1e-9).v - there(1e-9).v).abs() < 1e-6);
    }
}
