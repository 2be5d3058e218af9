//! Motion commands as commits and streams.

use super::{Client, FilterCore, Seen, Step};
use mobee_contract::{Commit, Setpoints, Target, Values};
use mobee_yarp::board::{Joints, ShadowAxis, reply};

/// A target this near beyond a limit is taken for the limit, deg.
const ROUNDING: f64 = 1e-3;
/// A slower reference speed is no motion, deg/s.
const SLOWEST: f64 = 1e-3;

impl FilterCore {
    pub(super) fn moves(&mut self, client: &Client, joints: &Joints, values: &[f64], _: &Seen) -> Option<Step> {
        let part = self.parts.get(client.part)?;
        let (mut motors, mut q, mut speeds) = (Vec::new(), Vec::new(), Vec::new());
        for (joint, value) in joints.on(part.shadow.axes.len())?.into_iter().zip(values) {
            let axis = part.shadow.axes.get(joint)?;
            // written so that not-a-number fails
            if !(*value >= axis.min - ROUNDING && *value <= axis.max + ROUNDING) {
                return None;
            }
            let speed = axis.ref_speed.abs().min(self.speed * axis.max_speed);
            if speed.is_nan() || speed < SLOWEST {
                return None;
            }
            motors.push(part.motors.start + joint);
            q.push(value.clamp(axis.min, axis.max).to_radians());
            speeds.push(speed.to_radians());
        }
        let target = Target { motors, q, speed: 1.0 };
        Some(Step::Commit(Commit { agent: self.agent(), target, speeds: Some(speeds) }))
    }

    pub(super) fn velocities(&mut self, client: &Client, joints: &Joints, values: &[f64]) -> Option<Step> {
        self.setpoints(client, joints, values, |axis, value| {
            let most = self.speed * axis.max_speed;
            value.is_finite().then(|| value.clamp(-most, most))
        })
        .map(|(motors, values)| Step::Stream(Setpoints { motors, values: Values::Velocity(values) }))
    }

    pub(super) fn directs(&mut self, client: &Client, joints: &Joints, values: &[f64]) -> Option<Step> {
        self.setpoints(client, joints, values, |axis, value| {
            let within = value >= axis.min - ROUNDING && value <= axis.max + ROUNDING;
            within.then(|| value.clamp(axis.min, axis.max))
        })
        .map(|(motors, values)| Step::Stream(Setpoints { motors, values: Values::Position(values) }))
    }

    fn setpoints(
        &self,
        client: &Client,
        joints: &Joints,
        values: &[f64],
        check: impl Fn(&ShadowAxis, f64) -> Option<f64>,
    ) -> Option<(Vec<usize>, Vec<f64>)> {
        let part = self.parts.get(client.part)?;
        let joints = joints.on(part.shadow.axes.len())?;
        let checked: Option<Vec<f64>> = joints
            .iter()
            .zip(values)
            .map(|(j, value)| Some(check(part.shadow.axes.get(*j)?, *value)?.to_radians()))
            .collect();
        Some((joints.iter().map(|j| part.motors.start + j).collect(), checked?))
    }

    /// Stops some joints. When no other joint moves the motion is given up; else these joints hold where they are.
    pub(super) fn stop(&mut self, client: &Client, joints: &Joints, seen: &Seen) -> Option<Step> {
        let part = self.parts.get(client.part)?;
        let asked: Vec<usize> = joints.on(part.shadow.axes.len())?.into_iter().map(|j| part.motors.start + j).collect();
        let moving = self.lines.moving(seen);
        if moving.iter().all(|m| !asked.contains(m)) {
            return Some(Step::Reply(reply::ok()));
        }
        if moving.iter().all(|m| asked.contains(m)) {
            self.lines.stopped(seen);
            return Some(Step::Stop);
        }
        let motors: Vec<usize> = asked.into_iter().filter(|m| moving.contains(m)).collect();
        let axis = |m: &usize| part.shadow.axes.get(m - part.motors.start);
        let q: Option<Vec<f64>> = motors
            .iter()
            .map(|m| Some(seen.q.get(*m)?.clamp(axis(m)?.min.to_radians(), axis(m)?.max.to_radians())))
            .collect();
        let speeds: Option<Vec<f64>> = motors.iter().map(|m| Some(axis(m)?.max_speed.to_radians())).collect();
        let target = Target { motors, q: q?, speed: 1.0 };
        Some(Step::Commit(Commit { agent: self.agent(), target, speeds: Some(speeds?) }))
    }

    /// Shows a motion's set-points as the board's own.
    pub(super) fn show(&mut self, part: usize, step: &Step) {
        let Some(part) = self.parts.get_mut(part) else { return };
        let start = part.motors.start;
        let mut each = |motors: &[usize], values: &[f64], put: fn(&mut ShadowAxis, f64)| {
            for (motor, value) in motors.iter().zip(values) {
                if let Some(axis) = motor.checked_sub(start).and_then(|j| part.shadow.axes.get_mut(j)) {
                    put(axis, value.to_degrees());
                }
            }
        };
        match step {
            Step::Commit(c) => each(&c.target.motors, &c.target.q, |axis, v| axis.target = v),
            Step::Stream(Setpoints { motors, values: Values::Velocity(v) }) => {
                each(motors, v, |axis, v| axis.vel_ref = v);
            }
            Step::Stream(Setpoints { motors, values: Values::Position(v) }) => {
                each(motors, v, |axis, v| axis.direct_ref = v);
            }
            _ => {}
        }
    }
}
