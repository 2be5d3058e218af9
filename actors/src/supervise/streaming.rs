//! What is asked in a stream of set-points, and what of it is written.
//!
//! What is written never jumps: a set-point of position that is farther than its axis can go in [`AHEAD`] is refused, and
//! one that is nearer is gone to at the axis' own speed. Velocities are lowered to what the axis can do, and to what can
//! still be braked before a limit when the lease is over.

use crate::controller::{Rules, clamped};
use mobee_contract::{Axis, Command, Pose, Refusal, Setpoints, Time, Values};
use std::time::Duration;

/// How far ahead of the robot a set-point of position may be, in time at its axis' greatest speed.
const AHEAD: Duration = Duration::from_millis(100);
/// Share of an axis' greatest speed that a written set-point may ask for.
const SHARE: f64 = 0.95;

/// A stream under way.
#[derive(Clone, Debug)]
pub(super) struct Streaming {
    pub(super) velocity: bool,
    /// Which motors it has named: no other is written to.
    pub(super) motors: Vec<bool>,
    /// The newest set-point of every motor: rad, or rad/s.
    pub(super) asked: Vec<f64>,
    /// What was last written, and when.
    pub(super) written: Vec<f64>,
    wrote: Time,
    /// Whether what was asked has not been written yet.
    pub(super) pending: bool,
    /// When the last set-point came.
    pub(super) heard: Time,
    /// Since when the robot brakes.
    pub(super) braking: Option<Time>,
    /// Since when the readings are equal bit for bit, and how far the set-points have moved since, rad.
    pub(super) mark: (Time, f64),
    /// The last reading.
    pub(super) seen: Time,
}

impl Streaming {
    pub(super) fn new(velocity: bool, here: &Pose, rules: &Rules, now: Time) -> Streaming {
        let n = here.len();
        let rest = if velocity { vec![0.0; n] } else { clamped(here, rules).to_vec() };
        Streaming {
            velocity,
            motors: vec![false; n],
            asked: rest.clone(),
            written: rest,
            wrote: now - rules.period,
            pending: false,
            heard: now,
            braking: None,
            mark: (now, 0.0),
            seen: now,
        }
    }

    /// The motors it has named.
    pub(super) fn named(&self) -> Vec<usize> {
        self.motors.iter().enumerate().filter(|(_, named)| **named).map(|(m, _)| m).collect()
    }

    /// Whether it has named this motor.
    pub(super) fn names(&self, motor: usize) -> bool {
        self.motors.get(motor) == Some(&true)
    }

    /// A whole pose with these values for the motors that it has named.
    pub(super) fn with(&self, rest: &[f64], values: &[f64]) -> Pose {
        let named = |(m, q): (usize, &f64)| values.get(m).filter(|_| self.names(m)).copied().unwrap_or(*q);
        rest.iter().enumerate().map(named).collect()
    }

    /// Takes in set-points of the controller's own for these motors; a motor without one is asked for what it was asked for.
    pub(super) fn ask(&mut self, motors: &[usize], all: &[f64], now: Time) {
        for m in motors {
            if let Some(named) = self.motors.get_mut(*m) {
                *named = true;
            }
            if let (Some(asked), Some(value)) = (self.asked.get_mut(*m), all.get(*m)) {
                *asked = *value;
            }
        }
        self.heard = now;
        self.pending = true;
    }

    /// Takes in what was checked.
    ///
    /// # Errors
    /// A position too far ahead; nothing is changed then.
    pub(super) fn take(&mut self, setpoints: &Setpoints, rules: &Rules, now: Time) -> Result<(), Refusal> {
        let (Values::Position(values) | Values::Velocity(values)) = &setpoints.values;
        if !self.velocity {
            for (m, q) in setpoints.motors.iter().zip(values) {
                let (Some(axis), Some(written)) = (rules.axes.get(*m), self.written.get(*m)) else { continue };
                let (by, most) = ((q - written).abs(), axis.max_speed * AHEAD.as_secs_f64() + rules.tolerance);
                if by > most {
                    let (by_deg, most_deg) = (by.to_degrees(), most.to_degrees());
                    return Err(Refusal::Jump { motor: axis.name.clone(), by_deg, most_deg });
                }
            }
        }
        for (m, value) in setpoints.motors.iter().zip(values) {
            let (Some(axis), Some(asked), Some(named)) =
                (rules.axes.get(*m), self.asked.get_mut(*m), self.motors.get_mut(*m))
            else {
                continue;
            };
            *named = true;
            *asked = if self.velocity { value.clamp(-axis.max_speed, axis.max_speed) } else { *value };
        }
        self.heard = now;
        self.pending = true;
        Ok(())
    }

    /// The next command, if there is one and it is time for it.
    pub(super) fn write(&mut self, here: &[f64], rules: &Rules, now: Time) -> Option<Command> {
        let elapsed = now.since(self.wrote).as_secs_f64();
        let period = rules.period.as_secs_f64();
        // half a sample early rather than a whole one late
        let due = elapsed >= 0.75 * period;
        if self.velocity {
            let motors = rules.axes.iter().zip(&self.asked).zip(here);
            let allowed: Vec<f64> = motors.map(|((axis, v), q)| before_limit(axis, *q, *v, rules)).collect();
            let brakes = allowed.iter().zip(&self.written).any(|(v, w)| v.abs() < w.abs() - 1e-9);
            if !(brakes || self.pending && due) {
                return None;
            }
            self.written = allowed;
            let motors = self.named();
            let speed = motors.iter().filter_map(|m| self.written.get(*m)).copied().collect();
            (self.wrote, self.pending) = (now, false);
            return Some(Command::Velocity { motors, speed });
        }
        if !(self.pending && due) {
            return None;
        }
        let step = elapsed.min(1.5 * period);
        let mut way = 0.0;
        self.pending = false;
        for ((axis, asked), written) in rules.axes.iter().zip(&self.asked).zip(&mut self.written) {
            let most = SHARE * axis.max_speed * step;
            let by = (asked - *written).clamp(-most, most);
            way = f64::max(way, by.abs());
            *written = if by == asked - *written { *asked } else { *written + by };
            self.pending |= *written != *asked;
        }
        self.mark.1 += way;
        self.wrote = now;
        let motors = self.named();
        let q = motors.iter().filter_map(|m| self.written.get(*m)).copied().collect();
        Some(Command::Direct { motors, q })
    }
}

/// The velocity towards which a motor at `q` may be driven: if nothing is heard from now on, the driver brakes it when the
/// lease is over, and it must still come to rest before its limit.
fn before_limit(axis: &Axis, q: f64, v: f64, rules: &Rules) -> f64 {
    // half of the tolerance, so that a target at the limit is reached
    let room = if v > 0.0 { axis.max - q } else { q - axis.min } - 0.5 * rules.tolerance;
    let (a, late) = (axis.max_acceleration, (rules.fresh + rules.latency).as_secs_f64());
    if room <= 0.0 || a <= 0.0 {
        return 0.0;
    }
    // v late + v^2 / (2 a) = room
    let most = a * ((late * late + 2.0 * room / a).sqrt() - late);
    v.clamp(-most, most)
}

#[cfg(test)]
mod tests;
