//! The retreat: the recorded poses backwards at the recorded rate (Algorithm 6), on the clock of all that go back
//! together.
//!
//! Two ways to drive one, by what the board can do. Streamed (`direct`): a set-point per period, where the clock says
//! the robot is on its way; the clock stops for a robot that does not follow. By way-points: few moves, each sent when
//! the one before has been reached; the board plans between them, within [`crate::joint_retreat`]'s tolerance of the
//! recorded path.

use super::FROZEN_WAY;
use crate::joint_retreat::{JointRetreat, RetreatPath};
use crate::{Rules, distance, within};
use mobee_contract::{Command, ControlMode, Sample, Target, Time};
use std::time::Duration;

/// How much faster than it came a robot goes back that is behind those who go along: without, it would stay behind, and elsewhere than
/// it was when they were where they are.
const CATCH_UP: f64 = 1.05;
/// How long after a halt the way is gone at its rate again, s.
const EASE: f64 = 0.3;
/// The share of its motors' acceleration with which a retreat comes to a halt.
pub const HALT_BRAKES: f64 = 0.9;
/// The time over which its speed is taken, s.
const PACE_TIME: f64 = 0.06;

/// A retreat that is being driven.
#[derive(Clone, Debug)]
pub struct Retreat {
    /// Its robot, by index.
    robot: usize,
    /// Where it leads.
    way: RetreatPath,
    /// How far on its way the robot is sent, seconds.
    clock: f64,
    /// The first of the way's points that has not been passed, or moved to, yet.
    next: usize,
    /// When the last set-point was written; of a way-point, when the reading was taken that it was written at.
    last: Time,
    /// What was last written to the way's motors.
    written: Vec<f64>,
    /// Since when the robot has not followed.
    behind: Option<Time>,
    /// The share of its rate at which the way is gone: after a halt robots set out gently, since each gains speed as it can.
    rate: f64,
}

/// Another robot that was retreating with this one went no further.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Parted;

impl Retreat {
    /// Of a robot, on this way. The first command after [`Retreat::begin`] waits for a reaction: the board ignores
    /// set-points before it is in their mode.
    pub fn new(robot: usize, way: RetreatPath, rules: &Rules, now: Time) -> Retreat {
        let written = way.points.first().map(|(_, q)| way.of(q)).unwrap_or_default();
        Retreat { robot, way, clock: 0.0, next: 1, last: now + rules.reaction(), written, behind: None, rate: 1.0 }
    }

    /// Where it leads.
    pub fn way(&self) -> &RetreatPath {
        &self.way
    }

    /// How long the way is: poses and seconds.
    pub fn length(&self) -> (usize, f64) {
        (self.way.points.len(), self.secs(self.way.points.len()))
    }

    /// The command that prepares the board.
    pub fn begin(&self) -> Command {
        let mode = if self.way.direct { ControlMode::PositionDirect } else { ControlMode::Position };
        Command::Mode { motors: self.way.motors.to_vec(), mode }
    }

    /// The positions last written, of the motors that go back.
    pub fn written(&self) -> &[f64] {
        &self.written
    }

    /// How long the robot has not followed, by the clock: zero for one that does.
    pub fn waits(&self, now: Time) -> Duration {
        self.behind.map_or(Duration::ZERO, |since| now.since(since))
    }

    /// Whether a robot that pushes something has not had its first set-point yet: it brakes.
    pub fn brakes(&self) -> bool {
        self.way.pressed && self.clock == 0.0
    }

    /// Whether it still leads straight off what the robot pushes: joints that this has bent, or hooked, come along late.
    pub fn takes_load_off(&self) -> bool {
        self.way.takes_off(&self.written)
    }

    /// Whether the last set-point has been written.
    pub fn is_over(&self) -> bool {
        self.next >= self.way.points.len()
    }

    /// The time of the point before this one, seconds on the way; zero for the first.
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
        joint_retreat: &JointRetreat,
        sample: &Sample,
        now: Time,
        rules: &Rules,
    ) -> Result<Option<Command>, Parted> {
        if self.is_over() {
            Ok(None)
        } else if self.way.direct {
            self.set_point(joint_retreat, sample, now, rules)
        } else {
            self.way_point(joint_retreat, sample, now, rules)
        }
    }

    /// The streamed way: where the clock is now.
    fn set_point(
        &mut self,
        joint_retreat: &JointRetreat,
        sample: &Sample,
        now: Time,
        rules: &Rules,
    ) -> Result<Option<Command>, Parted> {
        let Some(elapsed) = self.since_last(now, rules) else { return Ok(None) };
        // a robot behind its set-points would cut the corner to them, off the path that is known to be free
        let follows = self.is_followed(sample, now, rules);
        self.behind = if follows { None } else { self.behind.or(Some(now)) };
        let most = if follows { self.clock + elapsed * CATCH_UP * self.rate } else { self.clock };
        self.rate = (self.rate + elapsed / EASE).min(1.0);
        self.send_to(most, joint_retreat, now, rules).map(Some)
    }

    /// The time since the last set-point, s, once the next one is due: half a sample early rather than a whole one late.
    fn since_last(&self, now: Time, rules: &Rules) -> Option<f64> {
        let elapsed = now.since(self.last).as_secs_f64();
        (elapsed >= 0.75 * rules.period.as_secs_f64()).then_some(elapsed)
    }

    /// The set-point of the clock's next time, which is this one at most: those who go along may be behind.
    fn send_to(
        &mut self,
        most: f64,
        joint_retreat: &JointRetreat,
        now: Time,
        rules: &Rules,
    ) -> Result<Command, Parted> {
        self.clock = joint_retreat.step(self.robot, most, now).ok_or(Parted)?;
        self.next += self.way.points.iter().skip(self.next).take_while(|(t, _)| *t <= self.clock).count();
        self.last = now;
        self.written = self.limited(self.positions(), rules);
        Ok(Command::Direct { motors: self.way.motors.to_vec(), q: self.written.clone() })
    }

    /// It comes to a halt on its way and stays there, and those who go along do.
    ///
    /// A robot that looks ahead is sent on along its path, ever slower, as far as it goes while it brakes. Without new set-points it would
    /// brake beyond the last one and come back to it: into what has stopped there, since others foresee where it brakes to.
    ///
    /// # Errors
    /// If somebody who went along does so no more.
    pub fn stay(
        &mut self,
        joint_retreat: &JointRetreat,
        sample: &Sample,
        now: Time,
        rules: &Rules,
    ) -> Result<Option<Command>, Parted> {
        let brakes = rules.reserve.is_some() && self.way.direct && !self.is_over() && self.rate > 0.0;
        if !brakes || !self.is_followed(sample, now, rules) {
            (self.behind, self.last, self.rate) = (None, now, 0.0);
            return joint_retreat.step(self.robot, self.clock, now).map(|_| None).ok_or(Parted);
        }
        self.behind = None;
        let Some(elapsed) = self.since_last(now, rules) else { return Ok(None) };
        self.rate = (self.rate - elapsed / self.braking_time(rules).max(1e-3)).max(0.0);
        self.send_to(self.clock + elapsed * self.rate, joint_retreat, now, rules).map(Some)
    }

    /// How long the slowest of its motors brakes from the speed that its path has about the clock's time, s.
    fn braking_time(&self, rules: &Rules) -> f64 {
        let points = &self.way.points;
        let about = |t: f64| points.partition_point(|(at, _)| *at < t).min(points.len().saturating_sub(1));
        let ends = (points.get(about(self.clock - PACE_TIME).saturating_sub(1)), points.get(about(self.clock)));
        let (Some((t0, a)), Some((t1, b))) = ends else { return 0.0 };
        let time = |(m, (a, b)): (&usize, (f64, f64))| {
            let speed = (b - a).abs() / (t1 - t0).max(1e-3);
            rules.axes.get(*m).map_or(0.0, |axis| speed / (HALT_BRAKES * axis.max_acceleration.max(1e-6)))
        };
        self.way.motors.iter().zip(self.way.of(a).into_iter().zip(self.way.of(b))).map(time).fold(0.0, f64::max)
    }

    /// Whether it is where it was last sent, to a degree.
    pub fn is_where_sent(&self, sample: &Sample, rules: &Rules) -> bool {
        let beside =
            |(m, (q, written)): (&usize, (f64, &f64))| (q - written).abs() <= FROZEN_WAY + rules.pushed_error(*m);
        self.way.motors.iter().zip(self.way.of(&sample.q).into_iter().zip(&self.written)).all(beside)
    }

    /// The last set-point once more, if the robot rests beside it or beside the safe pose: it may have come as the lease was over, or
    /// never, or with the hold offsets of another pose. A reaction apart, so that the one before may show first.
    pub fn again(&mut self, sample: &Sample, now: Time, rules: &Rules) -> Option<Command> {
        let here = self.way.of(&sample.q);
        let apart = distance(&here, &self.written);
        let missed = apart.max(distance(&here, &self.way.of(&self.way.end.q)));
        // farther than a degree it is not late but elsewhere: to send it straight from there is nobody's recorded path
        let sag = self.way.motors.iter().map(|m| rules.pushed_error(*m)).fold(0.0, f64::max);
        let beside = missed > rules.tolerance && apart <= FROZEN_WAY + sag;
        if !(self.way.direct && beside && now >= self.last + rules.reaction()) {
            return None;
        }
        self.last = now;
        Some(Command::Direct { motors: self.way.motors.to_vec(), q: self.written.clone() })
    }

    /// Whether each motor is where it was sent within its reaction, to a degree. A board without a lease, or one that
    /// is held up, is not: to go on without the robot would lead it straight to where the clock is then, beside its
    /// recorded path.
    fn is_followed(&self, sample: &Sample, now: Time, rules: &Rules) -> bool {
        if self.takes_load_off() {
            return true;
        }
        // what it was sent to since then may still be on its way to the board, or the reading on its way from it
        let since = self.clock - (rules.reaction() + now.since(sample.at)).as_secs_f64();
        let first = self.way.points.partition_point(|(t, _)| *t <= since).saturating_sub(1);
        let sent = |m: usize| {
            let passed = self.way.points.iter().take(self.next).skip(first).filter_map(|(_, q)| q.get(m));
            passed.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), q| (q.min(low), q.max(high)))
        };
        self.way.motors.iter().zip(&self.written).all(|(m, written)| {
            let ((low, high), here) = (sent(*m), sample.q.get(*m).copied().unwrap_or(f64::NAN));
            let beside = FROZEN_WAY + rules.pushed_error(*m);
            (low.min(*written) - beside..=high.max(*written) + beside).contains(&here)
        })
    }

    /// Where its motors are at the clock's time: on the line between the two points about it, rad.
    fn positions(&self) -> Vec<f64> {
        let before = self.next.checked_sub(1).and_then(|i| self.way.points.get(i));
        match (before, self.way.points.get(self.next)) {
            (Some((t0, a)), Some((t1, b))) => {
                let part = ((self.clock - t0) / (t1 - t0).max(1e-9)).clamp(0.0, 1.0);
                self.way.of(a).iter().zip(self.way.of(b)).map(|(a, b)| a + (b - a) * part).collect()
            }
            (a, b) => a.or(b).map_or_else(|| self.written.clone(), |(_, q)| self.way.of(q)),
        }
    }

    /// Within the limits of its motors: readings beside a limit may lie beyond it by the encoders' noise, commands
    /// never do (I5).
    fn limited(&self, mut q: Vec<f64>, rules: &Rules) -> Vec<f64> {
        for (m, q) in self.way.motors.iter().zip(&mut q) {
            *q = rules.axes.get(*m).map_or(*q, |axis| within(*q, axis));
        }
        q
    }

    /// The way by moves: the next one, once all that go along have reached the one before.
    fn way_point(
        &mut self,
        joint_retreat: &JointRetreat,
        sample: &Sample,
        now: Time,
        rules: &Rules,
    ) -> Result<Option<Command>, Parted> {
        // "done" in a reading from before the board heard of the move is the end of the move before it
        let reacted = sample.at >= self.last + rules.reaction();
        let here = self.way.of(&sample.q);
        // a board may say "done" a little early
        let near = distance(&here, &self.written) <= 3.0 * rules.tolerance;
        let there = reacted && near && sample.done.iter().all(|d| *d);
        let reached = if there { self.next } else { self.next.saturating_sub(1) };
        let all = joint_retreat.reached(self.robot, reached, now).ok_or(Parted)?;
        let Some((_, q)) = self.way.points.get(self.next).filter(|_| there && all) else { return Ok(None) };
        let secs = self.secs(self.next + 1) - self.secs(self.next);
        let q = self.limited(self.way.of(q), rules);
        let pace =
            |(axis, (a, b)): (&mobee_contract::Axis, (&f64, f64))| (a - b).abs() / (axis.max_speed * secs.max(1e-3));
        let axes = self.way.motors.iter().filter_map(|m| rules.axes.get(*m));
        // as fast as it came, but never so slowly that a noisy pair of readings stops the way
        let speed = axes.zip(q.iter().zip(here)).map(pace).fold(0.01, f64::max).min(1.0);
        self.written = q;
        self.next += 1;
        self.last = sample.at;
        let target = Target { motors: self.way.motors.to_vec(), q: self.written.clone(), speed };
        Ok(Some(Command::Move(target.in_step(&sample.q, &rules.axes))))
    }
}

#[cfg(test)]
mod tests;
