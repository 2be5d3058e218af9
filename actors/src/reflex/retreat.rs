//! The way back: the recorded poses backwards at the recorded rate (Algorithm 6), on the clock of all that go back together.

use crate::controller::{Rules, clamped, distance};
use crate::convoy::{Convoy, Way};
use mobee_contract::{Command, ControlMode, Pose, Sample, Target, Time};
use std::time::Duration;

/// A way back that is being driven.
#[derive(Clone, Debug)]
pub struct Retreat {
    /// Its robot, by index.
    robot: usize,
    way: Way,
    clock: f64,
    next: usize,
    last: Time,
    written: Pose,
}

/// Another robot that was on its way back with this one went no further.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Parted;

impl Retreat {
    /// Of a robot, on this way.
    pub fn new(robot: usize, way: Way, rules: &Rules, now: Time) -> Retreat {
        let written = way.points.first().map_or_else(|| way.end.1.clone(), |(_, q)| q.clone());
        Retreat { robot, way, clock: 0.0, next: 1, last: now + rules.reaction(), written }
    }

    /// Where it leads.
    pub fn way(&self) -> &Way {
        &self.way
    }

    /// How long the way is: poses and seconds.
    pub fn length(&self) -> (usize, f64) {
        (self.way.points.len(), self.secs(self.way.points.len()))
    }

    /// The command that prepares the board.
    pub fn begin(&self) -> Command {
        let mode = if self.way.direct { ControlMode::PositionDirect } else { ControlMode::Position };
        Command::Mode { motors: Vec::new(), mode }
    }

    /// The pose last written.
    pub fn written(&self) -> &Pose {
        &self.written
    }

    /// Whether the last set-point has been written.
    pub fn is_over(&self) -> bool {
        self.next >= self.way.points.len()
    }

    /// The time of the point before this one, seconds on the way.
    fn secs(&self, next: usize) -> f64 {
        next.checked_sub(1).and_then(|i| self.way.points.get(i)).map_or(0.0, |(t, _)| *t)
    }

    /// When the last written pose should be reached: a way-point takes its leg's time, a set-point is followed at once.
    pub fn arrival(&self, now: Time) -> Time {
        let end = self.way.points.len();
        let leg = self.secs(end) - self.secs(end.saturating_sub(1));
        if self.way.direct { now } else { now + Duration::from_secs_f64(leg.clamp(0.0, 1e6)) }
    }

    /// The next command if it is time for one.
    ///
    /// Set-points are spaced by the clock, not by the readings: those that were held up come in a bunch.
    ///
    /// # Errors
    /// If somebody who went along does so no more.
    pub fn step(
        &mut self,
        convoy: &Convoy,
        sample: &Sample,
        now: Time,
        rules: &Rules,
    ) -> Result<Option<Command>, Parted> {
        if self.is_over() {
            Ok(None)
        } else if self.way.direct {
            self.set_point(convoy, now, rules)
        } else {
            self.way_point(convoy, sample, now, rules)
        }
    }

    fn set_point(&mut self, convoy: &Convoy, now: Time, rules: &Rules) -> Result<Option<Command>, Parted> {
        // half a sample early rather than a whole one late
        let elapsed = now.since(self.last).as_secs_f64();
        let period = rules.period.as_secs_f64();
        if elapsed < 0.75 * period {
            return Ok(None);
        }
        let most = self.clock + elapsed.min(1.5 * period);
        self.clock = convoy.step(self.robot, most, now).ok_or(Parted)?;
        self.next += self.way.points.iter().skip(self.next).take_while(|(t, _)| *t <= self.clock).count();
        self.last = now;
        self.written = clamped(&self.pose(), rules);
        Ok(Some(Command::Direct { q: self.written.to_vec() }))
    }

    /// The pose at the clock's time.
    fn pose(&self) -> Pose {
        let before = self.next.checked_sub(1).and_then(|i| self.way.points.get(i));
        match (before, self.way.points.get(self.next)) {
            (Some((t0, a)), Some((t1, b))) => {
                let part = ((self.clock - t0) / (t1 - t0).max(1e-9)).clamp(0.0, 1.0);
                a.iter().zip(b.iter()).map(|(a, b)| a + (b - a) * part).collect()
            }
            (a, b) => a.or(b).map_or_else(|| self.written.clone(), |(_, q)| q.clone()),
        }
    }

    fn way_point(
        &mut self,
        convoy: &Convoy,
        sample: &Sample,
        now: Time,
        rules: &Rules,
    ) -> Result<Option<Command>, Parted> {
        let reacted = sample.at >= self.last + rules.reaction();
        let near = distance(&sample.q, &self.written) <= 3.0 * rules.tolerance;
        let there = reacted && near && sample.done.iter().all(|d| *d);
        let reached = if there { self.next } else { self.next.saturating_sub(1) };
        let all = convoy.reached(self.robot, reached, now).ok_or(Parted)?;
        let Some((_, q)) = self.way.points.get(self.next).filter(|_| there && all) else { return Ok(None) };
        let secs = self.secs(self.next + 1) - self.secs(self.next);
        let pace =
            |(axis, (a, b)): (&mobee_contract::Axis, (&f64, &f64))| (a - b).abs() / (axis.max_speed * secs.max(1e-3));
        let speed = rules.axes.iter().zip(q.iter().zip(sample.q.iter())).map(pace).fold(0.01, f64::max).min(1.0);
        self.written = clamped(q, rules);
        self.next += 1;
        self.last = sample.at;
        let target = Target { motors: (0..self.written.len()).collect(), q: self.written.to_vec(), speed };
        Ok(Some(Command::Move(target.in_step(&sample.q, &rules.axes))))
    }
}
