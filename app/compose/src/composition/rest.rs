//! Rest poses: the configurations that robots move to when the run ends.

use super::{BuiltRobot, derive_seed, placed};
use crate::config::{Complaints, Config, RestTable, RobotConfig, Source, suggestion};
use mobee_agents::RestAgent;
use mobee_contract::{Agent, Context, KindError, SetPose};
use mobee_planning::group;
use mobee_planning::hand_goal::ResolvedGoal;
use mobee_runtime::system::{AgentMaker, RestSetup};
use serde_json::Value;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// The name of the home configuration in the robot's file.
const HOME_POSE: &str = "home";
/// Share of the maximum speeds if neither the table nor the agent has a speed.
const DEFAULT_SPEED: f64 = 0.1;
/// Tolerance if the agent's settings have none, degrees.
const DEFAULT_TOLERANCE_DEG: f64 = 0.5;

/// The motion to a robot's rest pose, and the pose.
pub(super) type Rest = (RestSetup, SetPose);

/// Builds the rest motions of all robots that have one.
pub(super) fn all(
    config: &Config,
    source: &Source,
    built: &mut [Option<BuiltRobot>],
    found: &[(String, ResolvedGoal)],
    wrong: &mut Complaints,
) {
    for (i, (r, b)) in config.robot.iter().zip(built).enumerate() {
        let (Some(rest), Some(b)) = (&r.rest, b) else { continue };
        let table = rest.table();
        // settings that are out of bounds are reported elsewhere
        if table.pose.is_some() == table.q_deg.is_some()
            || !(0.1..=3600.0).contains(&table.within_s)
            || table.speed.is_some_and(|speed| !(speed > 0.0 && speed <= 1.0))
        {
            continue;
        }
        let seed = derive_seed(config.seed, &format!("{}/rest", r.name));
        let at = format!("robot[{i}].rest");
        b.rest = wrong.keep(one(r, &table, b, found, seed).map_err(|e| placed(source, &at, e)));
    }
}

fn one(
    r: &RobotConfig,
    table: &RestTable,
    b: &BuiltRobot,
    found: &[(String, ResolvedGoal)],
    seed: u64,
) -> Result<Rest, KindError> {
    let robot = &b.model;
    let all: Vec<usize> = (0..robot.motors.len()).collect();
    let driven = b.hardware.as_ref().and_then(|h| h.known().motors).unwrap_or(all);
    let mut q = group::home(robot);
    let positions = match (&table.q_deg, &table.pose) {
        (Some(q_deg), _) => {
            let positions = group::positions("q_deg", q_deg, robot)?;
            let idle = positions.iter().find(|(m, _)| !driven.contains(m)).and_then(|(m, _)| robot.motors.get(*m));
            if let Some(motor) = idle {
                let what = format!("{} has no board, so nothing moves it", motor.name);
                return Err(KindError::new(format!("q_deg.{}", motor.name), what, "remove it"));
            }
            positions
        }
        (None, Some(name)) if name == HOME_POSE => Vec::new(),
        (None, name) => {
            let q_deg = agents_pose(r, name.as_deref().unwrap_or_default(), found)?;
            group::positions("", &q_deg, robot)?
        }
    };
    for (m, value) in positions {
        if let Some(slot) = q.get_mut(m) {
            *slot = value;
        }
    }
    let of_agent = |key: &str| r.agent.as_ref().and_then(|agent| agent.get(key)).and_then(Value::as_f64);
    let speed = table.speed.or(of_agent("speed")).unwrap_or(DEFAULT_SPEED);
    let tolerance_deg = of_agent("tolerance_deg").unwrap_or(DEFAULT_TOLERANCE_DEG.max(r.controller.tolerance_deg));
    let context = Context { robot: robot.clone(), seed };
    let make = {
        let q = q.clone();
        move || RestAgent::new(&driven, &q, speed, tolerance_deg, &context)
    };
    make()?;
    let maker: AgentMaker = Arc::new(move || match make() {
        Ok(agent) => Ok(Box::new(agent) as Box<dyn Agent>),
        Err(e) => Err(e.to_string()),
    });
    let within = Duration::from_secs_f64(table.within_s);
    Ok((RestSetup { maker, within }, SetPose { path: "rest".into(), q, optional: false }))
}

/// A pose of the robot's agent by its name, in degrees.
fn agents_pose(
    r: &RobotConfig,
    name: &str,
    found: &[(String, ResolvedGoal)],
) -> Result<BTreeMap<String, f64>, KindError> {
    let path = if matches!(r.rest, Some(crate::config::RestConfig::Name(_))) { "" } else { "pose" };
    let poses = r.agent.as_ref().and_then(|agent| agent.get("poses")).and_then(Value::as_array);
    let poses = poses.map(Vec::as_slice).unwrap_or_default();
    let name_of = |pose: &Value| pose.get("name").and_then(Value::as_str).map(str::to_owned);
    let known: Vec<String> = poses.iter().filter_map(name_of).collect();
    let Some(pose) = poses.iter().find(|pose| name_of(pose).as_deref() == Some(name)) else {
        let names: Vec<&str> = std::iter::once(HOME_POSE).chain(known.iter().map(String::as_str)).collect();
        let help = match suggestion(name, "pose", &names) {
            help if poses.is_empty() => format!("{help}; or give joint values: rest = {{ q_deg = {{ MOTOR = 10 }} }}"),
            help => help,
        };
        return Err(KindError::new(path, format!("{} has no pose {name:?}", r.name), help));
    };
    if let Some(q_deg) = pose.get("q_deg").and_then(Value::as_object) {
        return Ok(q_deg.iter().filter_map(|(motor, deg)| Some((motor.clone(), deg.as_f64()?))).collect());
    }
    let of_hand = found.iter().find(|(robot, goal)| *robot == r.name && goal.name.as_deref() == Some(name));
    let of_hand = of_hand.map(|(_, goal)| goal.q_deg.iter().cloned().collect());
    of_hand.ok_or_else(|| KindError::new(path, format!("pose {name:?} has no joint values"), "mend the agent's pose"))
}
