//! Execution of a retreat: the recorded configurations backwards at the recorded rate (Algorithm 6), on the common
//! clock of the retreat group.
//!
//! There are two modes, depending on the board. Streamed (`direct`): one set-point per period, at the clock's time;
//! the clock stops for a robot that does not follow. By way-points: a few moves, each sent when the previous one has
//! been reached; the board plans between them, within [`crate::joint_retreat`]'s tolerance of the recorded path.

use super::FROZEN_TRAVEL;
use crate::joint_retreat::{JointRetreat, RetreatPath};
use crate::{Rules, within};
use mobee_contract::{Command, ControlMode, Sample, Target, Time, distance};
use std::time::Duration;

/// Greatest retreat speed relative to the recorded speed, for a robot that is behind its group. Without catching up
/// it would stay behind, where it was not when the others were at their present configurations.
const CATCH_UP_RATIO: f64 = 1.05;
/// Time to return to the full rate after a halt, s.
const SPEED_UP_TIME: f64 = 0.3;
/// Share of the motors' acceleration used to halt a retreat.
pub const HALT_ACCELERATION_SHARE: f64 = 0.9;
/// Time window of the speed estimate on the path, s.
const SPEED_WINDOW: f64 = 0.06;

/// A retreat in execution.
#[derive(Clone, Debug)]
pub struct Retreat {
    /// Index of the robot.
    robot: usize,
    /// Path of the retreat.
    path: RetreatPath,
    /// Time on the path to which the robot is sent, s.
    clock: f64,
    /// Index of the first point of the path that has not been passed, or commanded, yet.
    next: usize,
    /// Time of the last set-point; for a way-point, the time of the reading at which it was sent.
    last: Time,
    /// Last set-points of the path's motors, rad.
    written: Vec<f64>,
    /// Time since which the robot has not followed.
    lagging_since: Option<Time>,
    /// Rate on the path, as a share of the recorded rate. After a halt it rises gradually, since each robot
    /// accelerates as it can.
    rate: f64,
}

/// Error: a robot of the same retreat group went no further.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GroupBroken;

impl Retreat {
    /// Begins the retreat of a robot on this path. The first command after [`Retreat::begin`] waits for a reaction
    /// time: the board ignores set-points until it is in their mode.
    pub fn new(robot: usize, path: RetreatPath, rules: &Rules, now: Time) -> Retreat {
        let written = path.points.first().map(|(_, q)| path.of(q)).unwrap_or_default();
        Retreat {
            robot,
            path,
            clock: 0.0,
            next: 1,
            last: now + rules.reaction(),
            written,
            lagging_since: None,
            rate: 1.0,
        }
    }

    /// Path of the retreat.
    pub fn path(&self) -> &RetreatPath {
        &self.path
    }

    /// Length of the path: number of configurations, and duration in seconds.
    pub fn length(&self) -> (usize, f64) {
        (self.path.points.len(), self.secs(self.path.points.len()))
    }

    /// Command that sets the control mode for the retreat.
    pub fn begin(&self) -> Command {
        let mode = if self.path.direct { ControlMode::PositionDirect } else { ControlMode::Position };
        Command::Mode { motors: self.path.motors.to_vec(), mode }
    }

    /// Last set-points of the retreating motors, rad.
    pub fn written(&self) -> &[f64] {
        &self.written
    }

    /// Duration for which the robot has not followed, by the clock; zero if it follows.
    pub fn lag_time(&self, now: Time) -> Duration {
        self.lagging_since.map_or(Duration::ZERO, |since| now.since(since))
    }

    /// Returns whether a robot that pushes something still brakes: its first set-point has not been written.
    pub fn brakes(&self) -> bool {
        self.path.pressed && self.clock == 0.0
    }

    /// Returns whether the path still leads straight away from the pushed obstacle: joints that are bent or hooked
    /// follow late.
    pub fn takes_load_off(&self) -> bool {
        self.path.takes_off(&self.written)
    }

    /// Returns whether the last set-point has been written.
    pub fn is_over(&self) -> bool {
        self.next >= self.path.points.len()
    }

    /// Time of the point before this one, seconds on the path; zero for the first.
    fn secs(&self, next: usize) -> f64 {
        next.checked_sub(1).and_then(|i| self.path.points.get(i)).map_or(0.0, |(t, _)| *t)
    }

    /// Expected arrival at the last set-point: a way-point takes the duration of its segment, a streamed set-point is
    /// followed at once.
    pub fn arrival(&self, now: Time) -> Time {
        let end = self.path.points.len();
        let leg = self.secs(end) - self.secs(end.saturating_sub(1));
        if self.path.direct { now } else { now + Duration::from_secs_f64(leg.clamp(0.0, 1e6)) }
    }

    /// Returns the next command, if one is due.
    ///
    /// The clock spaces the set-points, not the readings: delayed readings arrive in a burst.
    ///
    /// # Errors
    /// If another robot of the group went no further.
    pub fn step(
        &mut self,
        joint_retreat: &JointRetreat,
        sample: &Sample,
        now: Time,
        rules: &Rules,
    ) -> Result<Option<Command>, GroupBroken> {
        if self.is_over() {
            Ok(None)
        } else if self.path.direct {
            self.set_point(joint_retreat, sample, now, rules)
        } else {
            self.way_point(joint_retreat, sample, now, rules)
        }
    }

    /// Next set-point of a streamed retreat, at the clock's present time.
    fn set_point(
        &mut self,
        joint_retreat: &JointRetreat,
        sample: &Sample,
        now: Time,
        rules: &Rules,
    ) -> Result<Option<Command>, GroupBroken> {
        let Some(elapsed) = self.since_last(now, rules) else { return Ok(None) };
        // A robot behind its set-points would take a shortcut to them, off the path that is known to be free.
        let follows = self.is_followed(sample, now, rules);
        self.lagging_since = if follows { None } else { self.lagging_since.or(Some(now)) };
        let most = if follows { self.clock + elapsed * CATCH_UP_RATIO * self.rate } else { self.clock };
        self.rate = (self.rate + elapsed / SPEED_UP_TIME).min(1.0);
        self.send_to(most, joint_retreat, now, rules).map(Some)
    }

    /// Time since the last set-point, s, if the next one is due: half a sample early rather than a whole one late.
    fn since_last(&self, now: Time, rules: &Rules) -> Option<f64> {
        let elapsed = now.since(self.last).as_secs_f64();
        (elapsed >= 0.75 * rules.period.as_secs_f64()).then_some(elapsed)
    }

    /// Set-point at the next time of the common clock, which is `most` at the latest: other robots of the group may
    /// be behind.
    fn send_to(
        &mut self,
        most: f64,
        joint_retreat: &JointRetreat,
        now: Time,
        rules: &Rules,
    ) -> Result<Command, GroupBroken> {
        self.clock = joint_retreat.step(self.robot, most, now).ok_or(GroupBroken)?;
        self.next += self.path.points.iter().skip(self.next).take_while(|(t, _)| *t <= self.clock).count();
        self.last = now;
        self.written = self.limited(self.positions(), rules);
        Ok(Command::Direct { motors: self.path.motors.to_vec(), q: self.written.clone() })
    }

    /// Halts the robot on its path, and the group with it.
    ///
    /// A robot that looks ahead is sent on along its path, ever slower, over its braking distance. Without new
    /// set-points it would brake beyond the last one and return to it, into a robot that has stopped there, since
    /// other robots predict where it stops.
    ///
    /// # Errors
    /// If another robot of the group went no further.
    pub fn halt(
        &mut self,
        joint_retreat: &JointRetreat,
        sample: &Sample,
        now: Time,
        rules: &Rules,
    ) -> Result<Option<Command>, GroupBroken> {
        let brakes = rules.reserve.is_some() && self.path.direct && !self.is_over() && self.rate > 0.0;
        if !brakes || !self.is_followed(sample, now, rules) {
            self.lagging_since = None;
            self.last = now;
            self.rate = 0.0;
            return joint_retreat.step(self.robot, self.clock, now).map(|_| None).ok_or(GroupBroken);
        }
        self.lagging_since = None;
        let Some(elapsed) = self.since_last(now, rules) else { return Ok(None) };
        self.rate = (self.rate - elapsed / self.braking_time(rules).max(1e-3)).max(0.0);
        self.send_to(self.clock + elapsed * self.rate, joint_retreat, now, rules).map(Some)
    }

    /// Time that the slowest of the motors needs to brake from the path's speed about the clock's present time, s.
    fn braking_time(&self, rules: &Rules) -> f64 {
        let points = &self.path.points;
        let about = |t: f64| points.partition_point(|(at, _)| *at < t).min(points.len().saturating_sub(1));
        let ends = (points.get(about(self.clock - SPEED_WINDOW).saturating_sub(1)), points.get(about(self.clock)));
        let (Some((t0, a)), Some((t1, b))) = ends else { return 0.0 };
        let time = |(m, (a, b)): (&usize, (f64, f64))| {
            let speed = (b - a).abs() / (t1 - t0).max(1e-3);
            rules.axes.get(*m).map_or(0.0, |axis| speed / (HALT_ACCELERATION_SHARE * axis.max_acceleration.max(1e-6)))
        };
        self.path.motors.iter().zip(self.path.of(a).into_iter().zip(self.path.of(b))).map(time).fold(0.0, f64::max)
    }

    /// Returns whether the robot is at its last set-point, to a degree.
    pub fn is_at_setpoint(&self, sample: &Sample, rules: &Rules) -> bool {
        let beside =
            |(m, (q, written)): (&usize, (f64, &f64))| (q - written).abs() <= FROZEN_TRAVEL + rules.pushed_error(*m);
        self.path.motors.iter().zip(self.path.of(&sample.q).into_iter().zip(&self.written)).all(beside)
    }

    /// Returns the last set-point again if the robot rests beside it or beside the safe pose: it may have arrived
    /// after the lease expired, or never, or with the hold offsets of another configuration. Repeated after a
    /// reaction time at the earliest, so that the previous one can take effect first.
    pub fn resend(&mut self, sample: &Sample, now: Time, rules: &Rules) -> Option<Command> {
        let here = self.path.of(&sample.q);
        let apart = distance(&here, &self.written);
        let missed = apart.max(distance(&here, &self.path.of(&self.path.end.q)));
        // Farther than a degree, the robot is not late but elsewhere, and a straight motion from there is on no
        // recorded path.
        let sag = self.path.motors.iter().map(|m| rules.pushed_error(*m)).fold(0.0, f64::max);
        let beside = missed > rules.tolerance && apart <= FROZEN_TRAVEL + sag;
        if !(self.path.direct && beside && now >= self.last + rules.reaction()) {
            return None;
        }
        self.last = now;
        Some(Command::Direct { motors: self.path.motors.to_vec(), q: self.written.clone() })
    }

    /// Returns whether each motor is at the set-points of the last reaction time, to a degree. A board without a
    /// lease, or a delayed one, may not be: with a running clock the robot would go straight to the clock's present
    /// configuration, beside its recorded path.
    fn is_followed(&self, sample: &Sample, now: Time, rules: &Rules) -> bool {
        if self.takes_load_off() {
            return true;
        }
        // Later set-points may still be on their way to the board, or the reading on its way from it.
        let since = self.clock - (rules.reaction() + now.since(sample.at)).as_secs_f64();
        let first = self.path.points.partition_point(|(t, _)| *t <= since).saturating_sub(1);
        let sent = |m: usize| {
            let passed = self.path.points.iter().take(self.next).skip(first).filter_map(|(_, q)| q.get(m));
            passed.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), q| (q.min(low), q.max(high)))
        };
        self.path.motors.iter().zip(&self.written).all(|(m, written)| {
            let ((low, high), here) = (sent(*m), sample.q.get(*m).copied().unwrap_or(f64::NAN));
            let beside = FROZEN_TRAVEL + rules.pushed_error(*m);
            (low.min(*written) - beside..=high.max(*written) + beside).contains(&here)
        })
    }

    /// Positions of the path's motors at the clock's time, interpolated linearly between two points, rad.
    fn positions(&self) -> Vec<f64> {
        let before = self.next.checked_sub(1).and_then(|i| self.path.points.get(i));
        match (before, self.path.points.get(self.next)) {
            (Some((t0, a)), Some((t1, b))) => {
                let part = ((self.clock - t0) / (t1 - t0).max(1e-9)).clamp(0.0, 1.0);
                self.path.of(a).iter().zip(self.path.of(b)).map(|(a, b)| a + (b - a) * part).collect()
            }
            (a, b) => a.or(b).map_or_else(|| self.written.clone(), |(_, q)| self.path.of(q)),
        }
    }

    /// Clamps to the limits of the motors: readings near a limit may be beyond it by encoder noise, commands never
    /// are (I5).
    fn limited(&self, mut q: Vec<f64>, rules: &Rules) -> Vec<f64> {
        for (m, q) in self.path.motors.iter().zip(&mut q) {
            *q = rules.axes.get(*m).map_or(*q, |axis| within(*q, axis));
        }
        q
    }

    /// Next move of a retreat by way-points, once all robots of the group have reached the previous way-point.
    fn way_point(
        &mut self,
        joint_retreat: &JointRetreat,
        sample: &Sample,
        now: Time,
        rules: &Rules,
    ) -> Result<Option<Command>, GroupBroken> {
        // "Done" in a reading from before the board received the move belongs to the previous move.
        let reacted = sample.at >= self.last + rules.reaction();
        let here = self.path.of(&sample.q);
        // A board may report "done" slightly early.
        let near = distance(&here, &self.written) <= 3.0 * rules.tolerance;
        let there = reacted && near && sample.done.iter().all(|d| *d);
        let reached = if there { self.next } else { self.next.saturating_sub(1) };
        let all = joint_retreat.reached(self.robot, reached, now).ok_or(GroupBroken)?;
        let Some((_, q)) = self.path.points.get(self.next).filter(|_| there && all) else { return Ok(None) };
        let secs = self.secs(self.next + 1) - self.secs(self.next);
        let q = self.limited(self.path.of(q), rules);
        let pace =
            |(axis, (a, b)): (&mobee_contract::Axis, (&f64, f64))| (a - b).abs() / (axis.max_speed * secs.max(1e-3));
        let axes = self.path.motors.iter().filter_map(|m| rules.axes.get(*m));
        // The recorded speed, but never so slow that a noisy pair of readings stops the retreat.
        let speed = axes.zip(q.iter().zip(here)).map(pace).fold(0.01, f64::max).min(1.0);
        self.written = q;
        self.next += 1;
        self.last = sample.at;
        let target = Target { motors: self.path.motors.to_vec(), q: self.written.clone(), speed };
        Ok(Some(Command::Move(target.in_step(&sample.q, &rules.axes))))
    }
}

#[cfg(test)]
mod tests;
