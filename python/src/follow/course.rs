//! Course of a followed program: set-points over time, straight between two of them. No Python here.

use mobee_contract::{Axis, Time};
use std::time::Duration;

/// Share of a motor's greatest speed that a course may use: supervise writes set-points at no more.
const SPEED_SHARE: f64 = 0.95;

/// Share of a motor's greatest acceleration that a course may use: the rest lets a board catch up.
const ACCELERATION_SHARE: f64 = 0.6;
/// Speed of a motor, relative to that of its set-points: a servo that lags catches up.
const SPEED_RESERVE: f64 = 1.1;
/// Share of a stopping way by which its prediction may be wrong, as the controller assumes.
const FAST_ERROR: f64 = 0.1;

/// Configurations with their times, the first at the present.
#[derive(Clone, Debug)]
pub(super) struct FollowCourse {
    points: Vec<(Time, Vec<f64>)>,
}

impl FollowCourse {
    /// Begins at a configuration, rad of encoder.
    pub fn begin(at: Time, q: Vec<f64>) -> Self {
        Self { points: vec![(at, q)] }
    }

    /// Adds a configuration, later than all others.
    pub fn push(&mut self, at: Time, q: Vec<f64>) {
        self.points.push((at, q));
    }

    /// Time of the last configuration.
    pub fn end(&self) -> Time {
        self.points.last().map_or(Time::ZERO, |(at, _)| *at)
    }

    /// Velocities at a time, rad/s of encoder: those toward the next configuration. Until `late` after the last one, those that led there.
    pub fn velocities(&self, time: Time, late: Duration) -> Vec<f64> {
        let later = self.points.partition_point(|(at, _)| *at <= time);
        let rests = time > self.end() + late || self.points.len() < 2;
        let to = later.clamp(1, self.points.len().saturating_sub(1).max(1));
        match (self.points.get(to - 1), self.points.get(to)) {
            (Some((since, from)), Some((until, to))) if !rests => {
                let secs = until.since(*since).as_secs_f64().max(1e-6);
                from.iter().zip(to).map(|(a, b)| (b - a) / secs).collect()
            }
            _ => vec![0.0; self.goal().len()],
        }
    }

    /// The last configuration.
    pub fn goal(&self) -> &[f64] {
        self.points.last().map_or(&[], |(_, q)| q)
    }

    /// Number of configurations after the first.
    pub fn len(&self) -> usize {
        self.points.len().saturating_sub(1)
    }

    /// The configurations after the first.
    pub fn goals(&self) -> impl Iterator<Item = &[f64]> {
        self.points.iter().skip(1).map(|(_, q)| q.as_slice())
    }

    /// Configuration at a time: the first before the beginning, the last after the end.
    pub fn at(&self, time: Time) -> Vec<f64> {
        let later = self.points.partition_point(|(at, _)| *at <= time);
        match (later.checked_sub(1).and_then(|k| self.points.get(k)), self.points.get(later)) {
            (Some((since, from)), Some((until, to))) => {
                let share = time.since(*since).as_secs_f64() / until.since(*since).as_secs_f64().max(1e-9);
                from.iter().zip(to).map(|(a, b)| a + (b - a) * share).collect()
            }
            (Some((_, q)), None) | (None, Some((_, q))) => q.clone(),
            (None, None) => Vec::new(),
        }
    }
}

/// Ability of the motors of a board.
#[derive(Clone, Debug)]
pub(super) struct FollowLimits {
    pub axes: Vec<Axis>,
    /// Share of each motor's greatest speed.
    pub speed: f64,
    /// Time from a set-point until its effect is measured, s.
    pub reaction: f64,
}

impl FollowLimits {
    /// Moves a configuration, rad of encoder, into the limits. Returns whether it was beyond them.
    pub fn clip(&self, q: &mut [f64]) -> bool {
        let mut clipped = false;
        for (q, axis) in q.iter_mut().zip(&self.axes) {
            let within = q.max(axis.min).min(axis.max);
            clipped |= (within - *q).abs() > 1e-9;
            *q = within;
        }
        clipped
    }

    /// Velocities of the motors, rad/s, with which a period of `secs` leads from `from` toward `to`, no faster than the motors can
    /// accelerate from the velocities `before`, and can brake to those with which `to` moves on.
    ///
    /// # Arguments
    /// * `share`: of the velocities that would lead there.
    /// * `top`: greatest velocity, rad/s.
    pub fn velocities(
        &self,
        (from, before): (&[f64], &[f64]),
        (to, on): (&[f64], &[f64]),
        (share, top): (f64, f64),
        secs: f64,
    ) -> Vec<f64> {
        let each = |(j, axis): (usize, &Axis)| {
            let of = |all: &[f64]| all.get(j).copied().unwrap_or_default();
            let (way, before, on) = (of(to) - of(from), of(before), of(on));
            let change = ACCELERATION_SHARE * axis.max_acceleration * secs;
            // the steps by which the velocity falls end with the way
            let most = 0.5 * change * ((1.0 + 8.0 * way.abs() / (change * secs).max(1e-9)).sqrt() - 1.0);
            let wanted = share * (way / secs).clamp(on.min(0.0) - most, on.max(0.0) + most);
            let top = top.min(SPEED_SHARE * self.speed * axis.max_speed);
            wanted.clamp(-top, top).clamp(before - change, before + change)
        };
        self.axes.iter().enumerate().map(each).collect()
    }

    /// Velocities with which a program's set-point moves on, rad/s: zero for a jump.
    pub fn moves_on(&self, before: &[f64], goal: &[f64], secs: f64) -> Vec<f64> {
        let each = self.axes.iter().zip(before).zip(goal).map(|((axis, a), b)| {
            let v = (b - a) / secs;
            if v.abs() <= SPEED_SHARE * self.speed * axis.max_speed { v } else { 0.0 }
        });
        each.collect()
    }

    /// Configuration after a period of `secs` at these velocities, within the limits.
    pub fn after(&self, from: &[f64], velocities: &[f64], secs: f64) -> Vec<f64> {
        let mut to: Vec<f64> = from.iter().zip(velocities).map(|(q, v)| q + v * secs).collect();
        self.clip(&mut to);
        to
    }

    /// Configuration in which the motors would stop that pass `from` at these velocities. As the controller's look-ahead predicts it: they
    /// accelerate until the stop takes effect, for they lag behind their set-points, and then brake.
    ///
    /// # Arguments
    /// * `caution`: factor on the way, from 1.
    pub fn stop(&self, from: &[f64], velocities: &[f64], caution: f64) -> Vec<f64> {
        let each = from.iter().zip(velocities).zip(&self.axes);
        let stop = |((q, v), axis): ((&f64, &f64), &Axis)| {
            let way = self.stopping_way(axis, SPEED_RESERVE * v.abs());
            let beyond = axis.overshoot / self.stopping_way(axis, axis.max_speed).max(1e-6);
            q + v.signum() * way * (caution + FAST_ERROR + beyond)
        };
        let mut stop: Vec<f64> = each.map(stop).collect();
        self.clip(&mut stop);
        stop
    }

    /// Way on which a motor stops that has this speed, rad/s.
    fn stopping_way(&self, axis: &Axis, speed: f64) -> f64 {
        if speed < 1e-9 {
            return 0.0;
        }
        let a = axis.max_acceleration.max(1e-3);
        let gain = a * self.reaction;
        let then = speed + gain;
        self.reaction * (speed + 0.5 * gain) + then * then / (2.0 * a)
    }
}
