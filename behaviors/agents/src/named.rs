//! Poses that the settings of an agent name: the initial vertices of its map.

use mobee_contract::{KindError, Requirements, SetPose, suggestion};
use mobee_model::Robot;
use mobee_planning::group;
use mobee_planning::hand_goal::{HandGoal, joint_values};
use mobee_planning::roadmap::{Roadmap, Vertex};
use schemars::JsonSchema;
use serde::Deserialize;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

/// A pose with a name.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NamedPose {
    /// Name of the pose, unique in the agent.
    pub name: String,
    /// Motor positions in degrees, such as `{ torso_yaw = 10, r_elbow = 40 }`; the other motors are at home.
    #[serde(default)]
    pub q_deg: Option<BTreeMap<String, f64>>,
    /// Goal pose of the hand, instead of `q_deg`. Joint values are searched for when the file is
    /// read: those of the agent's motors that move the hand; the other motors are at home.
    #[serde(default)]
    pub hand_at: Option<HandGoal>,
}

/// Creates a map with these poses as its last vertices. Motors that a pose does not name are at
/// home.
///
/// # Arguments
/// * `given`: the map to start from, as a run wrote it.
/// * `motors`: the motors that the map moves if `given` is `None`; empty: those that the poses
///   name.
///
/// # Errors
/// Unknown motors, positions outside the limits, duplicate names and a broken map, each with its
/// path.
pub(super) fn map(
    given: Option<&Value>,
    motors: &[String],
    poses: &[NamedPose],
    robot: &Robot,
) -> Result<Roadmap, KindError> {
    let each = poses.iter().enumerate();
    let positions = KindError::gather(each.map(|(i, pose)| {
        let q_deg = joint_values(&format!("poses[{i}]"), pose.q_deg.as_ref(), pose.hand_at.as_ref())?;
        group::positions(&format!("poses[{i}].q_deg"), q_deg, robot)
    }))?;
    let named: BTreeSet<usize> = positions.iter().flatten().map(|(m, _)| *m).collect();
    let mut map = match given {
        Some(value) => {
            let mut map = Roadmap::import(value, robot).map_err(|e| e.under("map"))?;
            // Discard its notes: the map's file already records them, and a journal could not take
            // fifty thousand edges at once.
            map.notes();
            map
        }
        None if motors.is_empty() => Roadmap::new(named.iter().copied().collect(), robot),
        None => Roadmap::new(group::motors("motors", motors, robot)?, robot),
    };
    if let Some(stranger) = named.iter().find(|m| !map.motors().contains(m)) {
        let name = robot.motors.get(*stranger).map_or("?", |m| m.name.as_str());
        let help = "add it to `motors`, or remove it from the poses";
        return Err(KindError::new("poses", format!("the roadmap does not move {name}"), help));
    }
    for (i, (pose, q)) in poses.iter().zip(positions).enumerate() {
        if map.vertices().any(|(_, v)| v.name.as_deref() == Some(pose.name.as_str())) {
            let what = format!("two poses are named {:?}", pose.name);
            return Err(KindError::new(format!("poses[{i}].name"), what, "give every pose a name of its own"));
        }
        let mut whole = group::home(robot);
        for (m, value) in q {
            if let Some(slot) = whole.get_mut(m) {
                *slot = value;
            }
        }
        map.add(Vertex { name: Some(pose.name.clone()), q: whole, at: [0.0; 3] });
    }
    Ok(map)
}

/// Returns the motors of a map, and those of its vertices that the settings name.
pub(super) fn requirements(map: &Roadmap, own: Range<usize>) -> Requirements {
    let poses = map.vertices().skip(own.start).take(own.len()).enumerate();
    let poses = poses.map(|(i, (_, v))| SetPose { path: format!("poses[{i}]"), q: v.q.clone(), optional: false });
    Requirements { motors: map.motors().to_vec(), poses: poses.collect() }
}

/// Looks up the vertices of the goals.
///
/// # Errors
/// Names that the map does not have, or an empty list.
pub(super) fn goals(map: &Roadmap, goals: &[String]) -> Result<Vec<u32>, KindError> {
    let goals = KindError::gather(goals.iter().enumerate().map(|(i, g)| find(map, &format!("goals[{i}]"), g)))?;
    if goals.is_empty() {
        return Err(KindError::new("goals", "there is no goal", "name at least one pose to go to"));
    }
    Ok(goals)
}

/// Looks up the vertex of this name.
///
/// # Errors
/// An unknown name, with the most similar one that exists.
pub(super) fn find(map: &Roadmap, path: &str, name: &str) -> Result<u32, KindError> {
    map.find(name).ok_or_else(|| {
        let known: Vec<&str> = map.vertices().filter_map(|(_, v)| v.name.as_deref()).collect();
        KindError::new(path, format!("there is no pose {name:?}"), suggestion(name, "pose", &known))
    })
}
