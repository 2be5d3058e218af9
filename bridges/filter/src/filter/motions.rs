//! Motion commands as commits and streams.

use super::{BoardAxis, BoardClient, BoardReply, FilterCore, FilterDecision, RobotSnapshot};
use mobee_contract::{Commit, Setpoints, Target, Values};

/// Tolerance of a target beyond a limit, deg, for rounding; such a target is set to the limit.
const ROUNDING: f64 = 1e-3;
/// Least reference speed of a move, deg/s.
const SLOWEST: f64 = 1e-3;
/// Greatest distance between target and reading, deg, at which a joint beyond a limit counts as commanded to
/// stay: its reading may have changed since the client read it.
const STAYS: f64 = 0.5;

/// Interpretation of a joint's target.
#[derive(Clone, Copy, Debug, PartialEq)]
enum JointGoal {
    /// Move to this position, deg, within limits.
    To(f64),
    /// Stay beyond the limit.
    Stay,
    /// Out of reach.
    Beyond,
}

impl JointGoal {
    /// Interprets the target `value`, deg. A joint beyond a limit, by sag or an encoder offset, must not
    /// block its part: a target at its position is accepted, and one beyond the limit on that side means the
    /// limit, as on real boards.
    fn of(axis: &BoardAxis, value: f64) -> JointGoal {
        let within = value.clamp(axis.min, axis.max);
        let beyond = value - within;
        let stands = axis.q - axis.q.clamp(axis.min, axis.max);
        if beyond.abs() <= ROUNDING {
            JointGoal::To(within)
        } else if beyond * stands > 0.0 {
            if (value - axis.q).abs() <= STAYS { JointGoal::Stay } else { JointGoal::To(within) }
        } else {
            // includes NaN
            JointGoal::Beyond
        }
    }
}

impl FilterCore {
    pub(super) fn moves(&mut self, client: &BoardClient, joints: &[usize], values: &[f64]) -> Option<FilterDecision> {
        let part = self.parts.get(client.part)?;
        let mut motors = Vec::new();
        let mut q = Vec::new();
        let mut speeds = Vec::new();
        for (joint, value) in joints.iter().zip(values) {
            let axis = part.axes.get(*joint)?;
            let to = match JointGoal::of(axis, *value) {
                JointGoal::To(to) => to,
                JointGoal::Stay => continue,
                JointGoal::Beyond => return None,
            };
            let speed = axis.ref_speed.abs().min(self.speed * axis.max_speed);
            if speed.is_nan() || speed < SLOWEST {
                return None;
            }
            motors.push(part.motors.start + joint);
            q.push(to.to_radians());
            speeds.push(speed.to_radians());
        }
        if motors.is_empty() {
            return Some(FilterDecision::Reply(BoardReply::Accepted));
        }
        let target = Target { motors, q, speed: 1.0 };
        Some(FilterDecision::Commit(Commit { agent: self.agent(), target, speeds: Some(speeds) }))
    }

    pub(super) fn velocities(
        &mut self,
        client: &BoardClient,
        joints: &[usize],
        values: &[f64],
    ) -> Option<FilterDecision> {
        self.setpoints(client, joints, values, |axis, value| {
            let most = self.speed * axis.max_speed;
            if value.is_finite() { JointGoal::To(value.clamp(-most, most)) } else { JointGoal::Beyond }
        })
        .map(|(motors, values)| FilterDecision::Stream(Setpoints { motors, values: Values::Velocity(values) }))
    }

    pub(super) fn directs(&mut self, client: &BoardClient, joints: &[usize], values: &[f64]) -> Option<FilterDecision> {
        self.setpoints(client, joints, values, JointGoal::of)
            .map(|(motors, values)| FilterDecision::Stream(Setpoints { motors, values: Values::Position(values) }))
    }

    fn setpoints(
        &self,
        client: &BoardClient,
        joints: &[usize],
        values: &[f64],
        goal: impl Fn(&BoardAxis, f64) -> JointGoal,
    ) -> Option<(Vec<usize>, Vec<f64>)> {
        let part = self.parts.get(client.part)?;
        let mut motors = Vec::new();
        let mut all = Vec::new();
        for (joint, value) in joints.iter().zip(values) {
            match goal(part.axes.get(*joint)?, *value) {
                JointGoal::To(value) => {
                    motors.push(part.motors.start + joint);
                    all.push(value.to_radians());
                }
                JointGoal::Stay => {}
                JointGoal::Beyond => return None,
            }
        }
        (!motors.is_empty()).then_some((motors, all))
    }

    /// Stops some joints. If no other joint moves the motion is aborted; otherwise these joints hold their
    /// positions.
    pub(super) fn stop(
        &mut self,
        client: &BoardClient,
        joints: &[usize],
        seen: &RobotSnapshot,
    ) -> Option<FilterDecision> {
        let part = self.parts.get(client.part)?;
        let requested: Vec<usize> = joints.iter().map(|j| part.motors.start + j).collect();
        let moving = self.lines.moving(seen);
        if moving.iter().all(|m| !requested.contains(m)) {
            return Some(FilterDecision::Reply(BoardReply::Accepted));
        }
        if moving.iter().all(|m| requested.contains(m)) {
            self.lines.stopped(seen);
            return Some(FilterDecision::Stop);
        }
        let motors: Vec<usize> = requested.into_iter().filter(|m| moving.contains(m)).collect();
        let axis = |m: &usize| part.axes.get(m - part.motors.start);
        let q: Option<Vec<f64>> = motors
            .iter()
            .map(|m| Some(seen.q.get(*m)?.clamp(axis(m)?.min.to_radians(), axis(m)?.max.to_radians())))
            .collect();
        let speeds: Option<Vec<f64>> = motors.iter().map(|m| Some(axis(m)?.max_speed.to_radians())).collect();
        let target = Target { motors, q: q?, speed: 1.0 };
        Some(FilterDecision::Commit(Commit { agent: self.agent(), target, speeds: Some(speeds?) }))
    }

    /// Reports a motion's setpoints as the board's own.
    pub(super) fn show(&mut self, part: usize, step: &FilterDecision) {
        let Some(part) = self.parts.get_mut(part) else { return };
        let start = part.motors.start;
        let mut each = |motors: &[usize], values: &[f64], put: fn(&mut BoardAxis, f64)| {
            for (motor, value) in motors.iter().zip(values) {
                if let Some(axis) = motor.checked_sub(start).and_then(|j| part.axes.get_mut(j)) {
                    put(axis, value.to_degrees());
                }
            }
        };
        match step {
            FilterDecision::Commit(c) => each(&c.target.motors, &c.target.q, |axis, v| axis.target = v),
            FilterDecision::Stream(Setpoints { motors, values: Values::Velocity(v) }) => {
                each(motors, v, |axis, v| axis.velocity = v);
            }
            FilterDecision::Stream(Setpoints { motors, values: Values::Position(v) }) => {
                each(motors, v, |axis, v| axis.direct = v);
            }
            _ => {}
        }
    }
}
