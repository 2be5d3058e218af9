//! The way back: the recorded poses backwards at the recorded rate (Algorithm 6).

use crate::controller::{Rules, clamped, distance};
use crate::history::Recorded;
use mobee_contract::{Command, ControlMode, Pose, Sample, Target, Time};
use std::time::Duration;

/// Share of a motor's greatest speed that a set-point may ask for.
const SHARE: f64 = 0.95;
/// How far thinned way-points may be off the recorded path, rad.
const THIN: f64 = 0.004;

/// A way back that is being driven.
#[derive(Clone, Debug)]
pub struct Retreat {
    /// Seconds from the way's beginning, and the pose there.
    points: Vec<(f64, Pose)>,
    direct: bool,
    clock: f64,
    next: usize,
    last: Time,
    written: Pose,
}

impl Retreat {
    /// From the recorded path (forwards) and the pose where it shall end. Dwells at rest are skipped.
    pub fn new(path: &[Recorded], safe: &Pose, rules: &Rules, now: Time) -> Retreat {
        let mut points: Vec<(f64, Pose)> = Vec::with_capacity(path.len());
        let mut later: Option<&Recorded> = None;
        for r in path.iter().rev() {
            let at = points.last().map_or(0.0, |(t, _)| *t);
            match later {
                Some(l) if r.speed.min(l.speed) < rules.rest_speed => points.push((at, r.q.clone())),
                Some(l) => points.push((at + l.at.since(r.at).as_secs_f64(), r.q.clone())),
                None => points.push((0.0, r.q.clone())),
            }
            later = Some(r);
        }
        let end = points.last().map_or(0.0, |(t, _)| *t);
        points.push((end, safe.clone()));
        if !rules.position_direct {
            points = thin(points);
        }
        let written = points.first().map_or_else(|| safe.clone(), |(_, q)| q.clone());
        Retreat { points, direct: rules.position_direct, clock: 0.0, next: 1, last: now + rules.reaction(), written }
    }

    /// Cuts off a detour: what was recorded after the robot first was about where it is now.
    pub fn without_detour(path: &mut Vec<Recorded>, near: f64) {
        let Some(here) = path.last().map(|r| r.q.clone()) else { return };
        if let Some(first) = path.iter().position(|r| distance(&r.q, &here) <= near) {
            path.truncate(first + 1);
        }
    }

    /// How long the way is: poses and seconds.
    pub fn length(&self) -> (usize, f64) {
        (self.points.len(), self.points.last().map_or(0.0, |(t, _)| *t))
    }

    /// The command that prepares the board.
    pub fn begin(&self) -> Command {
        let mode = if self.direct { ControlMode::PositionDirect } else { ControlMode::Position };
        Command::Mode { motors: Vec::new(), mode }
    }

    /// The pose last written.
    pub fn written(&self) -> &Pose {
        &self.written
    }

    /// Whether the last set-point has been written.
    pub fn is_over(&self) -> bool {
        self.next >= self.points.len()
    }

    /// When the last written pose should be reached: a way-point takes its leg's time, a set-point is followed at once.
    pub fn arrival(&self, now: Time) -> Time {
        let at =
            |back: usize| self.points.len().checked_sub(back).and_then(|i| self.points.get(i)).map_or(0.0, |(t, _)| *t);
        if self.direct { now } else { now + Duration::from_secs_f64((at(1) - at(2)).clamp(0.0, 1e6)) }
    }

    /// The next command if it is time for one.
    ///
    /// Set-points are spaced by the clock, not by the readings: those that were held up come in a bunch.
    pub fn step(&mut self, sample: &Sample, now: Time, rules: &Rules) -> Option<Command> {
        if self.is_over() {
            return None;
        }
        if self.direct { self.set_point(now, rules) } else { self.way_point(sample, rules) }
    }

    fn set_point(&mut self, now: Time, rules: &Rules) -> Option<Command> {
        // half a sample early rather than a whole one late
        let elapsed = now.since(self.last).as_secs_f64();
        let period = rules.period.as_secs_f64();
        if elapsed < 0.75 * period {
            return None;
        }
        let step = elapsed.min(1.5 * period);
        let mut q = self.pose_at(self.clock + step);
        let share = |q: &[f64]| {
            let motors = rules.axes.iter().zip(q.iter().zip(self.written.iter()));
            motors.map(|(axis, (a, b))| (a - b).abs() / (axis.max_speed * step)).fold(0.0, f64::max)
        };
        let asked = share(&q);
        if asked > SHARE {
            // a jump in the recording (or after a dwell) is driven at the greatest speed, not jumped
            let part = SHARE / asked;
            q = self.written.iter().zip(q.iter()).map(|(a, b)| a + (b - a) * part).collect();
            self.clock += step * part;
        } else {
            self.clock += step;
            let end = self.points.last().map_or(0.0, |(t, _)| *t);
            while self.points.get(self.next).is_some_and(|(t, _)| *t <= self.clock) {
                self.next += 1;
            }
            if self.clock >= end {
                self.next = self.points.len();
            }
        }
        self.last = now;
        self.written = clamped(&q, rules);
        Some(Command::Direct { q: self.written.to_vec() })
    }

    fn pose_at(&self, t: f64) -> Pose {
        let after = self.points.partition_point(|(at, _)| *at <= t).max(self.next);
        match (after.checked_sub(1).and_then(|i| self.points.get(i)), self.points.get(after)) {
            (Some((t0, a)), Some((t1, b))) if t1 > t0 => {
                let part = ((t - t0) / (t1 - t0)).clamp(0.0, 1.0);
                a.iter().zip(b.iter()).map(|(a, b)| a + (b - a) * part).collect()
            }
            (_, Some((_, b))) => b.clone(),
            (Some((_, a)), None) => a.clone(),
            (None, None) => self.written.clone(),
        }
    }

    fn way_point(&mut self, sample: &Sample, rules: &Rules) -> Option<Command> {
        let reacted = sample.at >= self.last + rules.reaction();
        let near = distance(&sample.q, &self.written) <= 3.0 * rules.tolerance;
        if !(reacted && near && sample.done.iter().all(|d| *d)) {
            return None;
        }
        let (_, q) = self.points.get(self.next)?;
        let before = self.next.checked_sub(1).and_then(|i| self.points.get(i)).map_or(0.0, |(t, _)| *t);
        let secs = self.points.get(self.next).map_or(0.0, |(t, _)| *t) - before;
        let pace =
            |(axis, (a, b)): (&mobee_contract::Axis, (&f64, &f64))| (a - b).abs() / (axis.max_speed * secs.max(1e-3));
        let speed = rules.axes.iter().zip(q.iter().zip(sample.q.iter())).map(pace).fold(0.01, f64::max).min(1.0);
        self.written = clamped(q, rules);
        self.next += 1;
        self.last = sample.at;
        let target = Target { motors: (0..self.written.len()).collect(), q: self.written.to_vec(), speed };
        Some(Command::Move(target.in_step(&sample.q, &rules.axes)))
    }
}

/// The points at which the path turns by more than [`THIN`].
fn thin(points: Vec<(f64, Pose)>) -> Vec<(f64, Pose)> {
    let mut kept: Vec<(f64, Pose)> = Vec::new();
    let mut from = 0;
    for (i, point) in points.iter().enumerate() {
        let (Some((_, a)), Some(before)) = (points.get(from), i.checked_sub(1)) else {
            kept.push(point.clone());
            continue;
        };
        let straight = points.iter().enumerate().take(i).skip(from + 1).all(|(k, (_, p))| {
            let part = (k - from) as f64 / (i - from) as f64;
            let on_line: Vec<f64> = a.iter().zip(point.1.iter()).map(|(a, b)| a + (b - a) * part).collect();
            distance(&on_line, p) <= THIN
        });
        if !straight {
            kept.extend(points.get(before).cloned());
            from = before;
        }
    }
    kept.extend(points.last().cloned());
    kept
}
