//! The commands by which an operator moves, stops and observes robots: halt, release, pose, go, home.

use super::handler::RequestHandler;
use crate::ctl::wire::Reply;
use mobee_contract::{Commit, CommitId, Filtered, Hold, MotionEnd, Outcome, Status, Target};
use mobee_model::{Robot, nearest};
use std::fmt::Write;
use std::sync::Arc;
use std::time::Duration;

/// The agent name under which an operator's motions are committed.
const AGENT: &str = "ctl";
/// Time in which a halted robot must stop.
const STOP_TIMEOUT: Duration = Duration::from_secs(5);
/// Interval at which its state, and the log for the end of a motion, are polled.
const POLL_INTERVAL: Duration = Duration::from_millis(50);
/// Maximum lag of the log behind the end of a motion.
const LOG_TIMEOUT: Duration = Duration::from_secs(2);

impl RequestHandler {
    /// Halts robots, and waits until they rest.
    pub(super) async fn halt(&self, names: &[&str]) -> Result<Vec<String>, String> {
        let all = self.running.robots();
        let robots: Vec<_> = self.robots(names)?.into_iter().filter_map(|i| all.get(i)).collect();
        // stop all before waiting for any
        for robot in &robots {
            robot.halt()?;
        }
        let mut lines = Vec::new();
        let mut left = STOP_TIMEOUT;
        for robot in robots {
            let rests = |robot: &Arc<dyn Filtered>| {
                let latest = robot.latest();
                latest.ready && latest.status == Status::Holding(Hold::Halted)
            };
            while !rests(robot) && !left.is_zero() {
                tokio::time::sleep(POLL_INTERVAL).await;
                left = left.saturating_sub(POLL_INTERVAL);
            }
            let name = robot.name();
            lines.push(match rests(robot) {
                true => format!("{name}: halted, at rest; `mobee ctl release` lets it act again"),
                false => format!("{name}: halted, its filter is closed; no reading shows yet that it rests"),
            });
        }
        Ok(lines)
    }

    /// Lets halted robots act again.
    pub(super) fn release(&self, names: &[&str]) -> Result<Vec<String>, String> {
        let all = self.running.robots();
        let robots: Vec<_> = self.robots(names)?.into_iter().filter_map(|i| all.get(i)).collect();
        let results: Vec<_> = robots.iter().map(|robot| (robot.name(), robot.release())).collect();
        let any = results.iter().any(|(_, released)| released.is_ok());
        let line = |(name, released): (&str, Result<(), String>)| match released {
            Ok(()) => format!("{name}: released; its filter opens once it rests free of contact"),
            Err(why) => format!("{name}: {why}"),
        };
        let lines: Vec<String> = results.into_iter().map(line).collect();
        if any { Ok(lines) } else { Err(lines.join("\n")) }
    }

    /// The positions of the robots' motors and markers.
    pub(super) fn pose(&self, names: &[&str]) -> Result<Vec<String>, String> {
        let all = self.running.robots();
        let models = self.running.models();
        let scene = self.running.scene();
        let mut lines = Vec::new();
        for index in self.robots(names)? {
            let (Some(robot), Some(model)) = (all.get(index), models.get(index)) else { continue };
            let latest = robot.latest();
            let age = self.running.now().since(latest.at).as_secs_f64();
            lines.push(format!("{}, read {age:.1} s ago", robot.name()));
            let wide = model.motors.iter().map(|m| m.name.len()).max().unwrap_or(0);
            for part in &model.parts {
                lines.push(format!("  {}", part.name));
                for m in part.motors.clone() {
                    let (Some(motor), Some(q)) = (model.motors.get(m), latest.q.get(m)) else { continue };
                    let value_text = format!("{:9.2} {}", q.to_degrees(), motor.motion.unit());
                    lines.push(format!("    {:wide$} {value_text}", motor.name));
                }
            }
            if latest.q.len() == model.motors.len() {
                let base = scene.base(index);
                for (marker, at) in model.markers.iter().zip(model.markers_at(&latest.q)) {
                    let p = base * at.position();
                    lines.push(format!("  {} at {:.3} {:.3} {:.3} m", marker.name, p.x, p.y, p.z));
                }
            }
        }
        Ok(lines)
    }

    /// Commits a motion of motors, each as `MOTOR=VALUE`; returns the robot's name and the commit's number.
    pub(super) async fn go(&self, robot: &str, speed: &str, motors: &[&str]) -> Result<Vec<String>, String> {
        let index = self.robot(robot)?;
        let model = self.running.models().get(index).cloned().ok_or("this robot has no model")?;
        let mut target = (Vec::new(), Vec::new());
        for word in motors {
            let (motor, q) = assignment(&model, word)?;
            if target.0.contains(&motor) {
                return Err(format!("`{word}`: this motor is named twice"));
            }
            target.0.push(motor);
            target.1.push(q);
        }
        if target.0.is_empty() {
            return Err("name motors and positions, such as r_elbow=60".into());
        }
        self.commit(index, speed, target).await
    }

    /// Commits a motion of all motors to the model's home.
    pub(super) async fn home(&self, robot: &str, speed: &str) -> Result<Vec<String>, String> {
        let index = self.robot(robot)?;
        let model = self.running.models().get(index).cloned().ok_or("this robot has no model")?;
        self.commit(index, speed, ((0..model.motors.len()).collect(), model.home())).await
    }

    async fn commit(&self, index: usize, speed: &str, target: (Vec<usize>, Vec<f64>)) -> Result<Vec<String>, String> {
        let robot = self.running.robots().get(index).ok_or("there is no such robot")?;
        let name = robot.name();
        let speed: f64 =
            speed.parse().map_err(|_| format!("{speed} is not a speed; give a share above 0 and up to 1"))?;
        let report = self.report().await?;
        let own = report.robots.iter().find(|r| r.name == name);
        if own.is_some_and(|r| r.has_agent && r.acts) && !report.counts.done.contains_key(name) {
            return Err(format!("{name}: its own agent moves it; pause that first: `mobee ctl pause {name}`"));
        }
        let (motors, q) = target;
        let commit = Commit { agent: AGENT.into(), target: Target { motors, q, speed }, speeds: None };
        let verdict = robot.commit(commit).await;
        let id = verdict.map_err(|refusal| format!("{name}: refused: {refusal}; {}", refusal.remedy()))?;
        Ok(vec![name.to_owned(), id.0.to_string()])
    }

    /// The end of an operator's motion as a word and a sentence; empty while it is under way.
    pub(super) async fn ended(&self, robot: &str, id: &str) -> Result<Vec<String>, String> {
        let filtered = self.running.robots().get(self.robot(robot)?).ok_or("there is no such robot")?;
        let number: u64 = id.parse().map_err(|_| format!("{id} is not the number of a motion"))?;
        let Some(end) = filtered.end_of(CommitId(number)) else { return Ok(Vec::new()) };
        let mut left = LOG_TIMEOUT;
        loop {
            if let Some((outcome, text)) = self.log.end_of(robot, number) {
                let word = if outcome == Outcome::Committed { "committed" } else { "failed" };
                return Ok(vec![word.into(), text]);
            }
            if left.is_zero() {
                let word = if end == MotionEnd::Reached { "committed" } else { "failed" };
                return Ok(vec![word.into(), format!("{robot}: motion {number} {word}")]);
            }
            tokio::time::sleep(POLL_INTERVAL).await;
            left = left.saturating_sub(POLL_INTERVAL);
        }
    }

    /// Brakes an operator's motion.
    pub(super) fn brake(&self, robot: &str) -> Result<Vec<String>, String> {
        let filtered = self.running.robots().get(self.robot(robot)?).ok_or("there is no such robot")?;
        filtered.stop(AGENT.into());
        Ok(vec![format!("{robot}: brakes")])
    }

    /// Lines of the log, preceded by the number of the next line: the newest ones, or all from a number on.
    pub(super) fn lines_of_log(&self, which: &str, number: &str) -> Result<Vec<String>, String> {
        let number: u64 = number.parse().map_err(|_| format!("{number} is not a number of lines"))?;
        let (next, lines) = match which {
            "last" => self.log.last(usize::try_from(number).unwrap_or(usize::MAX)),
            _ => self.log.from(number),
        };
        Ok(std::iter::once(next.to_string()).chain(lines).collect())
    }

    /// The reply to connected clients as the run ends; `done` if it ends because its agents are done.
    pub(super) fn farewell(&self) -> Reply {
        let done = self.log.done();
        let mut line = "the run has ended".to_owned();
        if let Some(done) = &done {
            let _ = write!(line, ": {done}");
        }
        Reply { done: done.is_some(), lines: vec![line], over: true }
    }
}

/// Parses `MOTOR=VALUE`, in degrees, or millimeters for prismatic joints: returns the motor and its position, rad of
/// encoder.
fn assignment(model: &Robot, word: &str) -> Result<(usize, f64), String> {
    let (name, value) =
        word.split_once('=').ok_or_else(|| format!("`{word}`: write MOTOR=DEGREES, such as r_elbow=60"))?;
    let is = |i: usize| {
        let motor = model.motors.get(i);
        let part = motor.and_then(|motor| model.parts.get(motor.part));
        motor.is_some_and(|motor| {
            motor.name == name || part.is_some_and(|part| format!("{}.{}", part.name, motor.name) == name)
        })
    };
    let motor = (0..model.motors.len()).find(|i| is(*i)).ok_or_else(|| {
        let names: Vec<&str> = model.motors.iter().map(|motor| motor.name.as_str()).collect();
        let meant = nearest(name, &names).map_or(String::new(), |meant| format!("; did you mean `{meant}`?"));
        format!("there is no motor `{name}` on {}{meant}", model.name)
    })?;
    let value: f64 = value.parse().map_err(|_| format!("`{word}`: `{value}` is not a number"))?;
    if !value.is_finite() {
        return Err(format!("`{word}`: the position is not a finite number"));
    }
    Ok((motor, value.to_radians()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn motors_are_named_with_their_degrees() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/robots/icub.xml");
        let model = mobee_model::load_robot(file).unwrap().value;
        let elbow = model.motors.iter().position(|m| m.name == "r_elbow").unwrap();
        assert_eq!(assignment(&model, "r_elbow=60"), Ok((elbow, 60_f64.to_radians())));
        assert_eq!(assignment(&model, "right_arm.r_elbow=-1.5"), Ok((elbow, -1.5_f64.to_radians())));
        for (word, why) in [
            ("r_elbow", "MOTOR=DEGREES"),
            ("r_elbo=1", "did you mean `r_elbow`?"),
            ("r_elbow=x", "not a number"),
            ("r_elbow=nan", "not a finite number"),
            ("=1", "no motor"),
        ] {
            let refused = assignment(&model, word).expect_err(word);
            assert!(refused.contains(why), "{refused}");
        }
    }
}
