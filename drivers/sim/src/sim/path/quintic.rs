//! Minimum-jerk motion: a polynomial of degree five (Flash and Hogan, 1985).

use super::{Bounds, State};

/// Peak speed of a minimum-jerk motion over distance by duration.
const PEAK_SPEED: f64 = 1.875;
/// Peak acceleration of a minimum-jerk motion over distance by duration squared, 10 / sqrt(3).
const PEAK_ACCELERATION: f64 = 5.773_502_691_896_258;

/// A polynomial of degree five over time, at rest at its end.
#[derive(Clone, Debug, PartialEq)]
pub struct Quintic {
    /// Coefficients over normalized time, lowest degree first.
    c: [f64; 6],
    seconds: f64,
    end: f64,
}

impl Quintic {
    /// Motion from `from` to a rest at `to`; `None` if in mid-motion no polynomial was found that neither
    /// turns back nor violates the bounds.
    pub fn to(from: State, to: f64, bounds: Bounds) -> Option<Quintic> {
        let way = (to - from.q).abs();
        let at_rest = (PEAK_SPEED * way / bounds.speed).max((PEAK_ACCELERATION * way / bounds.acceleration).sqrt());
        if !(at_rest.is_finite() && at_rest > 0.0) {
            return None;
        }
        if from.v == 0.0 {
            return Some(Quintic::through(State { a: 0.0, ..from }, to, at_rest));
        }
        // above the speed limit the motor has to slow down first, for any distance
        if from.v.abs() > bounds.speed {
            return None;
        }
        let acceleration = bounds.acceleration.max(from.a.abs());
        (0..28)
            .map(|i| Quintic::through(from, to, 0.4 * at_rest * 1.12f64.powi(i)))
            .find(|p| p.stays_within(from.q, bounds.speed, acceleration))
    }

    /// Polynomial of this duration through both end states.
    fn through(from: State, to: f64, seconds: f64) -> Quintic {
        let (c0, c1, c2) = (from.q, from.v * seconds, 0.5 * from.a * seconds * seconds);
        let (d, v, a) = (to - c0 - c1 - c2, -c1 - 2.0 * c2, -2.0 * c2);
        let c = [c0, c1, c2, 10.0 * d - 4.0 * v + 0.5 * a, -15.0 * d + 7.0 * v - a, 6.0 * d - 3.0 * v + 0.5 * a];
        Quintic { c, seconds, end: to }
    }

    /// True if it stays between its ends and within the bounds, with a tolerance for rounding.
    fn stays_within(&self, start: f64, speed: f64, acceleration: f64) -> bool {
        let room = 1.0 + 1e-12;
        let v = derivative(&self.c);
        let a = derivative(&v);
        let (low, high) = range(&self.c);
        let (slowest, fastest) = range(&v);
        let (least, most) = range(&a);
        let speed = speed * self.seconds * room;
        let acceleration = acceleration * self.seconds * self.seconds * room;
        low >= start.min(self.end) - 1e-12
            && high <= start.max(self.end) + 1e-12
            && -slowest <= speed
            && fastest <= speed
            && -least <= acceleration
            && most <= acceleration
    }

    /// State after `t` seconds; at rest after its duration.
    pub fn at(&self, t: f64) -> State {
        if t >= self.seconds {
            return State::rest(self.end);
        }
        let s = (t / self.seconds).max(0.0);
        let [c0, c1, c2, c3, c4, c5] = self.c;
        State {
            q: c0 + s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * c5)))),
            v: (c1 + s * (2.0 * c2 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))) / self.seconds,
            a: (2.0 * c2 + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5))) / (self.seconds * self.seconds),
        }
    }

    /// Seconds to its end.
    pub fn duration(&self) -> f64 {
        self.seconds
    }

    /// Position at its end.
    pub fn end(&self) -> f64 {
        self.end
    }
}

fn value(c: &[f64], s: f64) -> f64 {
    c.iter().rev().fold(0.0, |sum, c| sum * s + c)
}

fn derivative(c: &[f64]) -> Vec<f64> {
    c.iter().enumerate().skip(1).map(|(i, c)| i as f64 * c).collect()
}

/// Least and greatest value of a polynomial over [0, 1].
fn range(c: &[f64]) -> (f64, f64) {
    let ends = [0.0, 1.0];
    let inner = roots(&derivative(c));
    ends.iter()
        .chain(&inner)
        .map(|s| value(c, *s))
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
}

/// Sign changes of a polynomial within [0, 1]: between the roots of its derivative it is monotone, so that
/// bisection finds each.
fn roots(c: &[f64]) -> Vec<f64> {
    if c.len() < 2 {
        return Vec::new();
    }
    let mut bounds = vec![0.0];
    bounds.extend(roots(&derivative(c)));
    bounds.push(1.0);
    let pairs = bounds.iter().zip(bounds.iter().skip(1));
    pairs
        .filter_map(|(&low, &high)| {
            let (mut low, mut high) = (low, high);
            let rising = value(c, low) < 0.0;
            if rising == (value(c, high) < 0.0) {
                return None;
            }
            for _ in 0..40 {
                let middle = 0.5 * (low + high);
                if (value(c, middle) < 0.0) == rising { low = middle } else { high = middle }
            }
            Some(0.5 * (low + high))
        })
        .collect()
}
