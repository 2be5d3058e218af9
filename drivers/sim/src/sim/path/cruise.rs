//! Motion at a velocity (velocity move).

use super::{Bounds, Pieces, State};

/// Halvings of the time until braking for a limit: a millionth of a watchdog's time.
const HALVINGS: u32 = 20;

/// Accelerates to the velocity `v`, holds it until `seconds` have passed, then brakes to a rest. If this
/// would leave `limits`, it brakes at the last moment that still stops inside. A motion that already leaves
/// the limits brakes at once.
pub fn cruise(from: State, v: f64, seconds: f64, limits: [f64; 2], greatest: Bounds) -> Pieces {
    let v = v.clamp(-greatest.speed, greatest.speed);
    let [min, max] = limits;
    let inside = |p: &Pieces| if v > 0.0 { p.end() <= max } else { p.end() >= min };
    let whole = cruise_for(from, v, seconds, greatest.acceleration);
    if v == 0.0 || inside(&whole) {
        return whole;
    }
    // the later it brakes, the farther it gets in the direction of `v`
    let (mut early, mut late) = (0.0, seconds);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (early + late);
        if inside(&cruise_for(from, v, middle, greatest.acceleration)) {
            early = middle;
        } else {
            late = middle;
        }
    }
    cruise_for(from, v, early, greatest.acceleration)
}

fn cruise_for(from: State, v: f64, seconds: f64, acceleration: f64) -> Pieces {
    let mut p = Pieces::new(from);
    let ramp = (v - from.v).abs() / acceleration;
    p.push(acceleration.copysign(v - from.v), ramp.min(seconds));
    if ramp <= seconds {
        p.finish(p.last().q, v);
        p.push(0.0, seconds - ramp);
    }
    let State { v, .. } = p.last();
    p.push(-acceleration.copysign(v), v.abs() / acceleration);
    p.finish(p.end(), 0.0);
    p
}
