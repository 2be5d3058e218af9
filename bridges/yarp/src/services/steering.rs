//! Runs the force fields of a robot's parts as one agent that streams velocities.

use super::parts::{PartPorts, SharedRobot, degrees};
use mobee_contract::{CommitId, MotionEnd, Refusal, Setpoints, Time, Values};
use std::sync::{Arc, PoisonError};

/// Force fields of a robot as one agent.
pub(super) struct Steering {
    agent: Arc<str>,
    last: Option<Time>,
    open: Option<CommitId>,
}

impl Steering {
    pub(super) fn new(robot: &SharedRobot) -> Steering {
        Steering { agent: format!("{}/force_field", robot.filtered.name()).into(), last: None, open: None }
    }

    /// Runs one cycle: applies the newest requests, and streams the resulting velocities.
    pub(super) async fn cycle(&mut self, robot: &SharedRobot, parts: &mut [PartPorts]) {
        let latest = robot.filtered.latest();
        let secs = self.last.map(|last| latest.at.since(last).as_secs_f64());
        if self.last.replace(latest.at) == Some(latest.at) {
            return;
        }
        let ended = self.open.and_then(|id| robot.filtered.end_of(id));
        if ended.is_some() {
            self.open = None;
        }
        let failed = ended == Some(MotionEnd::Failed);
        let mut setpoints = (Vec::new(), Vec::new());
        let mut all = vec![0.0; robot.model.motors.len()];
        for ports in parts.iter_mut() {
            let Some((field, commands)) = &mut ports.control else { continue };
            let motors = robot.model.parts.get(ports.part).map(|p| p.motors.clone()).unwrap_or_default();
            let q = degrees(latest.q.get(motors.clone()).unwrap_or_default());
            if failed {
                field.settle(&q);
            }
            while let Some(message) = commands.try_recv() {
                let wish = message.payload.bottle(robot.network.dialect()).ok().and_then(|b| crate::wish::parse(&b));
                let done = match wish {
                    Some(wish) => field.wish(&wish, &robot.model, ports.part, &latest.q),
                    None => Err("it is none of qatt, qfor, opsp".into()),
                };
                if let Err(error) = done {
                    tracing::debug!(from = message.from, error, "a command for the force field was not understood");
                }
            }
            let Some(velocities) = field.step(&q, secs.unwrap_or_default()) else { continue };
            for joint in field.joints() {
                if let Some(v) = velocities.get(joint) {
                    let motor = motors.start + joint;
                    let most = robot.filtered.board().axes.get(motor).map_or(0.0, |a| a.max_speed);
                    let v = v.to_radians().clamp(-most, most);
                    setpoints.0.push(motor);
                    setpoints.1.push(v);
                    if let Some(slot) = all.get_mut(motor) {
                        *slot = v.to_degrees();
                    }
                }
            }
        }
        *robot.commanded.lock().unwrap_or_else(PoisonError::into_inner) = all;
        if setpoints.0.is_empty() {
            return;
        }
        let setpoints = Setpoints { motors: setpoints.0, values: Values::Velocity(setpoints.1) };
        match robot.filtered.stream(self.agent.clone(), setpoints).await {
            Ok(id) => self.open = Some(id),
            // another agent moves the robot: the attractor is retained for later
            Err(Refusal::Busy | Refusal::NotReady { .. }) => {}
            Err(_) => {
                for ports in parts {
                    let motors = robot.model.parts.get(ports.part).map(|p| p.motors.clone()).unwrap_or_default();
                    if let Some((field, _)) = &mut ports.control {
                        field.settle(&degrees(latest.q.get(motors).unwrap_or_default()));
                    }
                }
            }
        }
    }
}
