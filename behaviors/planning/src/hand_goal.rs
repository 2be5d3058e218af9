//! Poses given in settings by the position of the hand instead of joint values. Inverse kinematics
//! computes the joint values before anything moves.
//!
//! ```text
//! poses[i] = { hand_at = { position_m, rpy_deg } } ──HandGoals::resolve──> poses[i] = { q_deg } ──> the agent
//! ```
//!
//! Agents take joint values and have no scene when they are built; therefore an agent that is
//! restarted has the same poses. Equal settings, seed, robot and world give equal joint values.

mod search;

use crate::group;
use crate::inverse_kinematics::MotorGroup;
use crate::pair_rules::ruled_scene;
use crate::table_map::HandChain;
use mobee_contract::{KindError, settings};
use mobee_model::{Robot, Scene};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use schemars::JsonSchema;
use search::{Goal, HandPosture, HandSearch, Orientation, Shortfall};
use serde::Deserialize;
use serde_json::Value;
use std::fmt;

/// Maximum absolute coordinate of a hand, meters: detects values in millimeters.
const MAX_COORDINATE_M: f64 = 10.0;
/// Maximum number of poses by the hand: a search that fails takes most of a second.
const MAX_GOALS: usize = 200;

/// Goal pose of a hand.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HandGoal {
    /// Marker that represents the hand; default: the agent's `hand`, or the marker that most of its
    /// `motors` move, or the robot's only one.
    #[serde(default)]
    pub hand: Option<String>,
    /// Position of the marker in `frame`: x, y, z in meters.
    pub position_m: [f64; 3],
    /// Orientation of the marker in `frame`: roll, pitch and yaw in degrees, about the fixed axes
    /// x, y and z in this order, as in a URDF; default: any orientation.
    #[serde(default)]
    pub rpy_deg: Option<[f64; 3]>,
    /// Direction of the marker's normal (the palm) in `frame`, instead of `rpy_deg`, such as
    /// `[0, 0, -1]` for down; the rotation about it is free.
    #[serde(default)]
    pub palm_toward: Option<[f64; 3]>,
    /// Reference frame of position and orientation: `world`, or `base`, the robot's root frame.
    #[serde(default)]
    pub frame: GoalFrame,
}

/// Reference frame of a goal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GoalFrame {
    /// World frame.
    #[default]
    World,
    /// Root frame of the robot.
    Base,
}

/// Joint values found for a pose.
#[derive(Clone, Debug, PartialEq)]
pub struct ResolvedGoal {
    /// Path of the pose within the agent's settings, such as `poses[3]`.
    pub path: String,
    /// Name of the pose, if it has one.
    pub name: Option<String>,
    /// Marker that represents the hand.
    pub hand: String,
    /// Motors that move the hand, and their positions in degrees (millimeters for prismatic
    /// joints).
    pub q_deg: Vec<(String, f64)>,
    /// Distance of the hand from its goal at these positions, meters.
    pub off_m: f64,
    /// Orientation error at these positions, rad.
    pub off_rad: f64,
}

/// A line for people, with joint values in the syntax of a settings file.
impl fmt::Display for ResolvedGoal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = self.name.as_ref().map_or_else(|| self.path.clone(), |name| format!("pose {name:?}"));
        // Adding 0.0 removes the sign of a rounded zero.
        let rounded = |q: f64| (q * 1e4).round() / 1e4 + 0.0;
        let values = self.q_deg.iter().map(|(motor, q)| format!("{} = {:.4}", key(motor), rounded(*q)));
        let values: Vec<String> = values.collect();
        write!(f, "{name} by {}: q_deg = {{ {} }}", self.hand, values.join(", "))
    }
}

/// Formats a motor's name as a TOML key.
fn key(name: &str) -> String {
    let bare = !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-');
    if bare { name.to_owned() } else { format!("{name:?}") }
}

/// Returns whether an agent's settings contain a pose that is given by the hand.
pub fn is_given(settings: &Value) -> bool {
    poses(settings).iter().any(is_by_hand)
}

fn poses(settings: &Value) -> &[Value] {
    settings.get("poses").and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

/// Returns whether a pose is given by the hand alone. The agent rejects one that also has joint
/// values.
fn is_by_hand(pose: &Value) -> bool {
    let has = |key: &str| pose.get(key).is_some_and(|v| !v.is_null());
    has("hand_at") && !has("q_deg")
}

/// Returns the joint values of a pose that is given by them or by the hand.
///
/// # Errors
/// A pose given by both, by neither, or by the hand and not resolved.
pub fn joint_values<'a, T>(path: &str, q_deg: Option<&'a T>, hand_at: Option<&HandGoal>) -> Result<&'a T, KindError> {
    match (q_deg, hand_at) {
        (Some(q_deg), None) => Ok(q_deg),
        (Some(_), Some(_)) => {
            let what = "this pose is given by joint values and by the hand, which may contradict each other";
            Err(KindError::new(path, what, "remove `q_deg` or `hand_at`"))
        }
        (None, Some(_)) => {
            let what = "the joint values of this pose, which is given by the hand, have not been searched for";
            Err(KindError::new(path, what, "call `HandGoals::resolve` on the settings before the agent is built"))
        }
        (None, None) => {
            let help = "add joint values, such as q_deg = { r_elbow = 40 }, or a place of the hand, such as hand_at = { position_m = [0.3, 0.1, 0.2] }";
            Err(KindError::new(path, "this pose has no joint values and no place of the hand", help))
        }
    }
}

/// Scene in which goal poses of a robot's hand are resolved.
#[derive(Clone, Copy, Debug)]
pub struct HandGoals<'a> {
    /// Robots and objects. The other robots are at home.
    pub scene: &'a Scene,
    /// The robot, an index into the scene's robots.
    pub robot: usize,
    /// Minimum distance between all shapes in a pose, meters: the planning clearance.
    pub clearance: f64,
    /// Seed of the search's start configurations.
    pub seed: u64,
}

impl HandGoals<'_> {
    /// Replaces the hand goals of an agent's settings by joint values. Rules for pairs in the settings (`may_touch`,
    /// `pair_clearance_mm`) apply to these.
    ///
    /// # Errors
    /// Unknown names, numbers out of bounds, and positions that the hand can't reach or not without
    /// a collision, each with its path.
    pub fn resolve(&self, agent: &mut Value) -> Result<Vec<ResolvedGoal>, KindError> {
        if let Some(ruled) = ruled_scene(agent, self.scene, self.robot)? {
            return HandGoals { scene: &ruled, ..*self }.resolve_in_scene(agent);
        }
        self.resolve_in_scene(agent)
    }

    fn resolve_in_scene(&self, agent: &mut Value) -> Result<Vec<ResolvedGoal>, KindError> {
        if !is_given(agent) {
            return Ok(Vec::new());
        }
        let Some(robot) = self.scene.robots().get(self.robot) else {
            return Err(KindError::new("poses", "there is no robot", "name a robot of the scene"));
        };
        let count = poses(agent).iter().filter(|pose| is_by_hand(pose)).count();
        if count > MAX_GOALS {
            let what = format!("{count} poses are given by the hand, more than {MAX_GOALS}");
            return Err(KindError::new(
                "poses",
                what,
                "copy the joint values that `mobee check` prints for a part of them",
            ));
        }
        let motors = agents_motors(agent, robot)?;
        let hand = agent.get("hand").and_then(Value::as_str);
        let hand = group::marker("hand", hand, robot)?;
        let hand = hand.or_else(|| motors.as_ref().and_then(|motors| group::hand(robot, motors)));
        let by_hand = poses(agent).iter().enumerate().filter(|(_, pose)| is_by_hand(pose));
        let found = KindError::gather(by_hand.map(|(i, pose)| {
            let path = format!("poses[{i}]");
            let at = format!("{path}.hand_at");
            let goal: HandGoal = settings(&pose["hand_at"]).map_err(|e| e.under(&at))?;
            let name = pose["name"].as_str().map(str::to_owned);
            let prepared = self.prepare(&goal, hand, motors.as_deref(), robot);
            let mut found = prepared.and_then(|search| search.first(self, &goal)).map_err(|e| e.under(&at))?;
            found.path = path;
            found.name = name;
            Ok((i, found))
        }))?;
        for (i, pose) in &found {
            let table = agent.get_mut("poses").and_then(|all| all.get_mut(*i)).and_then(Value::as_object_mut);
            let Some(table) = table else { continue };
            table.remove("hand_at");
            let values = pose.q_deg.iter().map(|(motor, q)| (motor.clone(), Value::from(*q))).collect();
            table.insert("q_deg".to_owned(), Value::Object(values));
        }
        Ok(found.into_iter().map(|(_, pose)| pose).collect())
    }

    /// Returns different joint values for a goal of the hand, nearest to home first, at least one: a planner can take
    /// any of them as its goal.
    ///
    /// # Arguments
    /// * `motors`: those that may move, indices into `Robot::motors`.
    ///
    /// # Errors
    /// As for [`HandGoals::resolve`].
    pub fn solutions(&self, goal: &HandGoal, motors: &[usize]) -> Result<Vec<ResolvedGoal>, KindError> {
        let Some(robot) = self.scene.robots().get(self.robot) else {
            return Err(KindError::new("", "there is no robot", "name a robot of the scene"));
        };
        let prepared = self.prepare(goal, group::hand(robot, motors), Some(motors), robot)?;
        let found = prepared.search.all(&prepared.place).map_err(|why| self.refusal(&why, goal, &prepared.hand))?;
        Ok(found.iter().map(|posture| prepared.resolved(posture)).collect())
    }

    /// Prepares the search for a goal of the hand.
    fn prepare<'a>(
        &'a self,
        goal: &HandGoal,
        default: Option<usize>,
        motors: Option<&[usize]>,
        robot: &'a Robot,
    ) -> Result<PreparedGoal<'a>, KindError> {
        let marker = group::marker("hand", goal.hand.as_deref(), robot);
        let place = goal.place(&self.scene.base(self.robot));
        KindError::gather([marker.clone().map(drop), place.clone().map(drop)])?;
        let marker = marker?.or(default);
        let place = place?;
        let only = if let [_] = robot.markers.as_slice() { Some(0) } else { None };
        let (marker, hand) = marker.or(only).and_then(|i| Some((i, robot.markers.get(i)?))).ok_or_else(|| {
            let names: Vec<&str> = robot.markers.iter().map(|m| m.name.as_str()).collect();
            let help = match names.as_slice() {
                [] => "add a <marker> to the hand in the robot's file".to_owned(),
                names => format!("add hand = \"...\"; the robot's markers are: {}", names.join(", ")),
            };
            KindError::new("", "the pose does not name the hand", help)
        })?;
        let mut chain: Vec<usize> = group::movers(robot, hand.node).collect();
        chain.sort_unstable();
        chain.dedup();
        chain.retain(|m| motors.is_none_or(|motors| motors.contains(m)));
        if chain.is_empty() {
            let what = match motors {
                Some(_) => format!("no motor of the agent moves {}", hand.name),
                None => format!("no motor moves {}", hand.name),
            };
            let help = "name another hand, or add the motors of its arm to `motors`";
            return Err(KindError::new(if goal.hand.is_some() { "hand" } else { "" }, what, help));
        }
        let limits = chain.iter().filter_map(|m| robot.motors.get(*m)).map(mobee_model::Motor::range).collect();
        let search = HandSearch {
            scene: self.scene,
            robot: self.robot,
            chain: HandChain::of_robot(self.scene, self.robot, marker, hand.normal),
            group: MotorGroup { motors: chain, limits },
            clearance: self.clearance,
            seed: self.seed,
        };
        Ok(PreparedGoal { search, place, hand: hand.name.clone(), robot })
    }

    /// Describes why there are no joint values.
    fn refusal(&self, why: &Shortfall, goal: &HandGoal, hand: &str) -> KindError {
        let is_oriented = goal.rpy_deg.is_some() || goal.palm_toward.is_some();
        match why {
            Shortfall::OutOfReach { off, position_alone } => {
                let mm = off.0 * 1e3;
                let deg = off.1.to_degrees();
                let by = if is_oriented { format!("{mm:.1} mm and {deg:.1} deg") } else { format!("{mm:.1} mm") };
                let what = format!("{hand} can't get there: the nearest pose within the limits misses it by {by}");
                let help = if *position_alone {
                    "the position alone can be reached: choose another orientation, or leave it out"
                } else {
                    "choose a place nearer to the robot, or let more motors move (`motors`); positions are meters in `frame`"
                };
                KindError::new(if *position_alone { goal.orientation_key() } else { "position_m" }, what, help)
            }
            Shortfall::NotFree { contact } => {
                let mm = self.clearance * 1e3;
                let why = match contact {
                    Some((a, b, distance)) => {
                        let a = self.scene.label(*a);
                        let b = self.scene.label(*b);
                        let near = distance * 1e3;
                        let place = if near < 0.0 { "deep in" } else { "from" };
                        format!("at best {a} is {:.1} mm {place} {b}, and poses keep {mm:.1} mm", near.abs())
                    }
                    None => "the poses that were found break a constraint of the robot's file".to_owned(),
                };
                let what = format!("{hand} can get there, but no free pose was found: {why}");
                let help = "choose another place or orientation, or move the object";
                KindError::new("position_m", what, help)
            }
        }
    }
}

/// A goal of the hand whose joint values can be searched.
struct PreparedGoal<'a> {
    search: HandSearch<'a>,
    place: Goal,
    hand: String,
    robot: &'a Robot,
}

impl PreparedGoal<'_> {
    /// Returns the joint values nearest to home.
    fn first(&self, goals: &HandGoals, goal: &HandGoal) -> Result<ResolvedGoal, KindError> {
        let found = self.search.run(&self.place).map_err(|why| goals.refusal(&why, goal, &self.hand))?;
        Ok(self.resolved(&found))
    }

    fn resolved(&self, found: &HandPosture) -> ResolvedGoal {
        let named = |(m, q): (&usize, &f64)| Some((self.robot.motors.get(*m)?.name.clone(), q.to_degrees()));
        ResolvedGoal {
            path: String::new(),
            name: None,
            hand: self.hand.clone(),
            q_deg: self.search.group.motors.iter().zip(&found.q).filter_map(named).collect(),
            off_m: found.off.0,
            off_rad: found.off.1,
        }
    }
}

impl HandGoal {
    /// Returns the key of the orientation, or of the position if the goal has none.
    fn orientation_key(&self) -> &'static str {
        match (self.rpy_deg, self.palm_toward) {
            (Some(_), _) => "rpy_deg",
            (None, Some(_)) => "palm_toward",
            (None, None) => "position_m",
        }
    }

    /// Converts the goal to the world frame.
    fn place(&self, base: &Isometry3<f64>) -> Result<Goal, KindError> {
        let within = |path: &str, values: [f64; 3], most: f64, help: &str| {
            let what = format!("[{}, {}, {}] is out of bounds", values[0], values[1], values[2]);
            // NaN is out of bounds as well.
            if values.iter().all(|x| x.abs() <= most) { Ok(()) } else { Err(KindError::new(path, what, help)) }
        };
        let position = within(
            "position_m",
            self.position_m,
            MAX_COORDINATE_M,
            "give meters (not millimeters), each from -10 to 10, such as [0.3, 0.1, 0.2]",
        );
        let rpy = self.rpy_deg.unwrap_or_default();
        let turn = within("rpy_deg", rpy, 360.0, "give roll, pitch and yaw in degrees, each from -360 to 360");
        let palm = self.palm_toward.map(|v| group::direction("palm_toward", v)).transpose();
        let one = match (self.rpy_deg, self.palm_toward) {
            (Some(_), Some(_)) => {
                let what = "the orientation is given twice";
                Err(KindError::new("palm_toward", what, "remove `palm_toward` or `rpy_deg`"))
            }
            _ => Ok(()),
        };
        KindError::gather([position, turn, palm.clone().map(drop), one])?;
        let base = if self.frame == GoalFrame::Base { *base } else { Isometry3::identity() };
        let [roll, pitch, yaw] = rpy.map(f64::to_radians);
        let orientation = match (self.rpy_deg, palm?) {
            (Some(_), _) => Orientation::Full(base.rotation * UnitQuaternion::from_euler_angles(roll, pitch, yaw)),
            (None, Some(palm)) => Orientation::Palm(base.rotation * palm),
            (None, None) => Orientation::Any,
        };
        let at = base * nalgebra::Point3::from(Vector3::from(self.position_m));
        Ok(Goal { at: at.coords, orientation })
    }
}

/// Returns the motors that an agent moves, if its settings contain them: those of its map, or
/// `motors`.
fn agents_motors(agent: &Value, robot: &Robot) -> Result<Option<Vec<usize>>, KindError> {
    if let Some(map) = agent.get("map").filter(|map| map.is_object()) {
        let names = map.get("motors").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
        let index = |name: &Value| robot.motors.iter().position(|m| Some(m.name.as_str()) == name.as_str());
        return Ok(Some(names.iter().filter_map(index).collect()));
    }
    match agent.get("motors").filter(|m| m.as_array().is_some_and(|m| !m.is_empty())) {
        Some(names) => {
            let names: Vec<String> = settings(names).map_err(|e| e.under("motors"))?;
            group::motors("motors", &names, robot).map(Some)
        }
        None => Ok(None),
    }
}
