//! A list of poses, visited in order: the shortest agent, and a template for new ones.

use super::{open, seal};
use mobee_contract::*;
use mobee_planning::group;
use mobee_planning::hand_goal::{HandGoal, joint_values};
use mobee_planning::short_way::nearest_target;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::time::Duration;

/// Settings of the kind `scripted`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ScriptedSettings {
    /// Poses, in order.
    pub poses: Vec<ScriptedPose>,
    /// Share of each motor's maximum speed, above 0 and up to 1.
    #[serde(default = "tenth")]
    pub speed: f64,
    /// Number of times to repeat the list; 0: unlimited.
    #[serde(default = "once")]
    pub repeat: u32,
}

/// A pose of the list.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ScriptedPose {
    /// Motor positions in degrees, such as `{ torso_yaw = 10, r_elbow = 40 }`; the other motors stay where they are.
    #[serde(default)]
    pub q_deg: Option<BTreeMap<String, f64>>,
    /// Goal pose of the hand, instead of `q_deg`. Joint values are searched for when the file is
    /// read, with all other motors at home: those of the motors that move the hand; the others stay
    /// where they are.
    #[serde(default)]
    pub hand_at: Option<HandGoal>,
    /// Time to rest at the pose, seconds.
    #[serde(default)]
    pub wait_s: f64,
}

fn tenth() -> f64 {
    0.1
}

fn once() -> u32 {
    1
}

/// Visits its poses. A motion that fails is counted, and the next pose is tried.
pub struct Scripted {
    poses: Vec<(Target, Duration)>,
    home: Vec<f64>,
    repeat: u32,
    state: ScriptedState,
}

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ScriptedState {
    /// Index of the next pose.
    next: usize,
    round: u32,
    reached: u32,
    failed: u32,
}

impl Scripted {
    /// Creates an agent from its settings.
    ///
    /// # Errors
    /// An unknown motor, a position outside its limits, an invalid speed or time, or an empty list,
    /// each with its path.
    pub fn new(settings: ScriptedSettings, context: &Context) -> Result<Scripted, KindError> {
        let speed = settings.speed;
        let poses = KindError::gather(settings.poses.iter().enumerate().map(|(i, pose)| {
            let q_deg = joint_values(&format!("poses[{i}]"), pose.q_deg.as_ref(), pose.hand_at.as_ref())?;
            let q = group::positions(&format!("poses[{i}].q_deg"), q_deg, &context.robot)?;
            let (motors, q) = q.into_iter().unzip();
            let wait = group::seconds(&format!("poses[{i}].wait_s"), pose.wait_s)?;
            Ok((Target { motors, q, speed }, wait))
        }));
        KindError::gather([group::speed("speed", speed).map(drop), poses.clone().map(drop)])?;
        let poses = poses?;
        if poses.is_empty() {
            return Err(KindError::new("poses", "the list of poses is empty", "give at least one pose"));
        }
        let home = group::home(&context.robot);
        Ok(Scripted { poses, home, repeat: settings.repeat, state: ScriptedState::default() })
    }
}

impl Agent for Scripted {
    fn next(&mut self, last: Option<MotionEnd>, view: &View) -> Intent {
        let state = &mut self.state;
        if let Some(end) = last {
            let here = self.poses.get(state.next);
            state.next += 1;
            match end {
                MotionEnd::Reached => state.reached += 1,
                MotionEnd::Failed => state.failed += 1,
            }
            match here {
                Some((_, wait)) if end == MotionEnd::Reached && !wait.is_zero() => return Intent::Wait(*wait),
                _ => {}
            }
        }
        if state.next >= self.poses.len() {
            (state.next, state.round) = (0, state.round.saturating_add(1));
        }
        match self.poses.get(state.next) {
            Some((target, _)) if self.repeat == 0 || state.round < self.repeat => {
                Intent::MoveTo(nearest_target(view, target.clone()))
            }
            _ => Intent::Done(Summary {
                text: format!("{} poses reached, {} missed", state.reached, state.failed),
                figures: vec![("reached".into(), state.reached.into()), ("missed".into(), state.failed.into())],
            }),
        }
    }

    /// Returns each configuration as it is if all previous poses were reached, starting from home.
    fn requirements(&self) -> Requirements {
        let mut q = self.home.clone();
        let mut means = Requirements::default();
        for (i, (target, _)) in self.poses.iter().enumerate() {
            q = target.pose(&q).to_vec();
            means.poses.push(SetPose { path: format!("poses[{i}]"), q: q.clone(), optional: true });
            means.motors.extend(&target.motors);
        }
        means
    }

    fn export(&self) -> Snapshot {
        seal("scripted", 1, &self.state)
    }

    fn import(&mut self, from: Snapshot) -> Result<(), Refusal> {
        self.state = open(&from, "scripted", 1)?;
        Ok(())
    }
}

fn build(value: &Value, context: &Context) -> Result<Box<dyn Agent>, KindError> {
    Ok(Box::new(Scripted::new(settings(value)?, context)?))
}

inventory::submit! {
    Registered(&Kind::<dyn Agent> {
        name: "scripted",
        doc: "Visits a list of poses with waits between them, once, several times or forever. A motion that \
              fails is counted, and the next pose is tried.",
        schema: || schemars::schema_for!(ScriptedSettings),
        example: |robot| {
            let pose = |share| json!({ "q_deg": group::example_pose(robot, share), "wait_s": 0.5 });
            Ok(json!({ "poses": [pose(0.2), pose(0.0)], "speed": 0.1, "repeat": 0 }))
        },
        build,
    })
}
