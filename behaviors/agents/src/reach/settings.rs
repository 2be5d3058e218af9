//! Settings of the reaching agent.

use crate::tour::defaults::{half, tenth};
use mobee_contract::KindError;
use mobee_model::Robot;
use mobee_planning::group;
use mobee_planning::roadmap::validation::Validation;
use nalgebra::{Unit, Vector3};
use schemars::JsonSchema;
use serde::Deserialize;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// Settings of the kind `reach`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReachSettings {
    /// Name of the object to reach for, in the world.
    pub object: String,
    /// Roadmap of pre-grasp poses: a map file, its JSON, or the settings of `mobee roadmap build`
    /// (`.toml`), from which the map is built once and cached for the user; or a list of those, one
    /// for each arm. Without it every path is planned.
    #[serde(default)]
    #[schemars(extend("format" = "roadmap"))]
    pub map: Option<Value>,
    /// Names of parts or motors that move the hand; default: those of the map.
    #[serde(default)]
    pub motors: Vec<String>,
    /// Marker that represents the hand, or a list of markers, of which the one that gets closest is
    /// chosen for each reach; default: those of the maps, or the marker that most of the motors
    /// move.
    #[serde(default)]
    pub hand: Option<OneOrMore>,
    /// Direction out of the palm, in each marker's frame; default: the marker's normal.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub palm: Option<[f64; 3]>,
    /// Direction of the palm in the pre-grasp and grasp postures, world frame.
    #[serde(default = "down")]
    pub palm_toward: [f64; 3],
    /// Position of the hand before the grasp, relative to the object's center, world axes, mm.
    #[serde(default = "before")]
    pub pre_grasp_mm: [f64; 3],
    /// Position of the hand in the grasp posture, relative to the object's center, world axes, mm.
    #[serde(default = "at")]
    pub grasp_mm: [f64; 3],
    /// Rest posture of the arm before and after a reach: motor positions in degrees; motors that
    /// are not named are at home.
    #[serde(default)]
    pub rest_deg: BTreeMap<String, f64>,
    /// Motions of the eyes. Without it the robot does not search for the object.
    #[serde(default)]
    pub gaze: Option<GazeSettings>,
    /// Number of reaches, successful or not; 0: unlimited.
    #[serde(default)]
    pub repeat: u32,
    /// Time to stay in the grasp posture, seconds.
    #[serde(default)]
    pub wait_s: f64,
    /// Follow the object: if it is detected elsewhere during a reach, or something blocks the path,
    /// the motion is redirected or replanned. `false`: its position is taken once, and the path is
    /// driven as planned.
    #[serde(default = "yes")]
    pub follow: bool,
    /// Displacement of the object since the hand set out that causes a new choice of postures, mm.
    #[serde(default = "moved")]
    #[schemars(extend("expert" = true))]
    pub moved_mm: f64,
    /// Share of each motor's maximum speed, above 0 and up to 1.
    #[serde(default = "tenth")]
    pub speed: f64,
    /// Validation of edges: `optimistic` tries them without a check, `lazy` certifies them in the
    /// model before they are driven, `verified` before they are used in a plan. The last line to
    /// the pre-grasp posture, and the line from there to the grasp, are always certified.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub validation: Validation,
    /// Maximum number of straight lines between two poses that a planner may check if no path of
    /// the map leads to a goal.
    #[serde(default = "budget")]
    #[schemars(extend("expert" = true))]
    pub budget: u64,
    /// Maximum distance of every motor from a pose for the robot to count as at that pose, degrees.
    #[serde(default = "half")]
    #[schemars(extend("expert" = true))]
    pub tolerance_deg: f64,
    /// Seed of all randomness; default: derived from the run's seed.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub seed: Option<u64>,
}

/// A name, or a list of them.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum OneOrMore {
    /// One name.
    One(String),
    /// At least one.
    More(Vec<String>),
}

impl OneOrMore {
    /// Returns each name with the path of its setting.
    pub(super) fn named(&self, path: &str) -> Vec<(String, &str)> {
        match self {
            OneOrMore::One(name) => vec![(path.to_owned(), name)],
            OneOrMore::More(names) => {
                names.iter().enumerate().map(|(i, n)| (format!("{path}[{i}]"), n.as_str())).collect()
            }
        }
    }
}

/// Motions of the eyes.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GazeSettings {
    /// Names of parts or motors that turn the eyes.
    pub motors: Vec<String>,
    /// Markers of the eyes. The normal of each is its viewing direction.
    #[serde(default)]
    pub eyes: Vec<String>,
    /// Poses of the search while the object is not detected, in degrees; default: gaze targets
    /// around its estimated position.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub sweep_deg: Vec<BTreeMap<String, f64>>,
    /// Time to look at a gaze target before the eyes are turned to the next, seconds.
    #[serde(default = "half")]
    #[schemars(extend("expert" = true))]
    pub dwell_s: f64,
    /// Share of each motor's maximum speed, above 0 and up to 1.
    #[serde(default = "fifth")]
    pub speed: f64,
}

fn down() -> [f64; 3] {
    [0.0, 0.0, -1.0]
}
fn before() -> [f64; 3] {
    [0.0, 0.0, 150.0]
}
fn at() -> [f64; 3] {
    [0.0, 0.0, 120.0]
}
fn yes() -> bool {
    true
}
fn moved() -> f64 {
    20.0
}
fn fifth() -> f64 {
    0.2
}
fn budget() -> u64 {
    10_000
}

/// Maximum distance of a hand from an object, mm: detects values in the wrong unit.
const MAX_OFFSET_MM: f64 = 2000.0;

/// The gaze settings with all names resolved for a robot.
#[derive(Clone, Debug)]
pub(super) struct GazePlan {
    pub motors: Vec<usize>,
    /// Indices into `Robot::markers`.
    pub eyes: Vec<usize>,
    /// Positions of `motors` in each pose of the search, rad.
    pub sweep: Vec<Vec<f64>>,
    pub dwell: std::time::Duration,
    pub speed: f64,
}

impl GazeSettings {
    /// Resolves all names for a robot.
    ///
    /// # Errors
    /// All errors, each with the path of its setting.
    pub(super) fn plan(&self, robot: &Robot) -> Result<GazePlan, KindError> {
        let motors = group::motors("gaze.motors", &self.motors, robot);
        let eye = |(i, name): (usize, &String)| group::marker(&format!("gaze.eyes[{i}]"), Some(name), robot);
        let eyes = KindError::gather(self.eyes.iter().enumerate().map(eye));
        let pose = |(i, q): (usize, &BTreeMap<String, f64>)| {
            let path = format!("gaze.sweep_deg[{i}]");
            let named = group::positions(&path, q, robot)?;
            let motors = motors.as_ref().map_or(&[][..], Vec::as_slice);
            if let Some((stranger, _)) = named.iter().find(|(m, _)| !motors.is_empty() && !motors.contains(m)) {
                let name = robot.motors.get(*stranger).map_or("?", |m| m.name.as_str());
                let help = "add it to `gaze.motors`, or remove it from the pose";
                return Err(KindError::new(path, format!("the gaze does not move {name}"), help));
            }
            let home = |m: &usize| robot.motors.get(*m).map_or(0.0, |m| m.home);
            let at = |m: &usize| named.iter().find(|(n, _)| n == m).map_or_else(|| home(m), |(_, q)| *q);
            Ok(motors.iter().map(at).collect::<Vec<f64>>())
        };
        let sweep = KindError::gather(self.sweep_deg.iter().enumerate().map(pose));
        let dwell = group::seconds("gaze.dwell_s", self.dwell_s);
        let speed = group::speed("gaze.speed", self.speed);
        KindError::gather([
            motors.clone().map(drop),
            eyes.clone().map(drop),
            sweep.clone().map(drop),
            dwell.clone().map(drop),
            speed.clone().map(drop),
        ])?;
        let eyes = eyes?.into_iter().flatten().collect();
        Ok(GazePlan { motors: motors?, eyes, sweep: sweep?, dwell: dwell?, speed: speed? })
    }
}

impl ReachSettings {
    /// Returns the markers that represent the hands: those that are named, otherwise those of the
    /// maps.
    ///
    /// # Errors
    /// Markers that the robot does not have, an empty list, and duplicates.
    pub(super) fn hands(&self, robot: &Robot) -> Result<Vec<usize>, KindError> {
        let Some(named) = &self.hand else {
            let maps = self.map.iter().flat_map(|map| map.as_array().map_or(std::slice::from_ref(map), Vec::as_slice));
            let hands = maps.filter_map(|map| map.get("hand")?.as_str());
            let mut all: Vec<usize> =
                hands.filter_map(|name| robot.markers.iter().position(|m| m.name == name)).collect();
            let mut known = BTreeSet::new();
            all.retain(|hand| known.insert(*hand));
            return Ok(all);
        };
        let named = named.named("hand");
        if named.is_empty() {
            return Err(KindError::new("hand", "no hand is named", "name a marker of the robot, or leave `hand` out"));
        }
        let all = KindError::gather(named.iter().map(|(path, name)| group::marker(path, Some(name), robot)))?;
        let all: Vec<usize> = all.into_iter().flatten().collect();
        let twice = (1..all.len()).find(|i| all.iter().take(*i).any(|hand| Some(hand) == all.get(*i)));
        match twice.and_then(|i| named.get(i)) {
            Some((path, name)) => {
                Err(KindError::new(path.as_str(), format!("{name} is named twice"), "name each hand once"))
            }
            None => Ok(all),
        }
    }

    /// Checks numbers and directions; returns the direction of the palm.
    ///
    /// # Errors
    /// All errors, each with the path of its setting.
    pub(super) fn check(&self) -> Result<Unit<Vector3<f64>>, KindError> {
        let near = |path: &str, v: [f64; 3]| {
            let what = format!("[{}, {}, {}] is not a valid position of the hand", v[0], v[1], v[2]);
            let help = format!("give millimeters from the object's middle, each up to {MAX_OFFSET_MM}");
            if v.iter().all(|x| x.abs() <= MAX_OFFSET_MM) { Ok(()) } else { Err(KindError::new(path, what, help)) }
        };
        let toward = group::direction("palm_toward", self.palm_toward);
        let moved = self.moved_mm;
        let moved = if (1.0..=MAX_OFFSET_MM).contains(&moved) {
            Ok(())
        } else {
            let help = format!("give millimeters from 1 to {MAX_OFFSET_MM}, such as 20");
            Err(KindError::new("moved_mm", format!("{moved} is out of bounds"), help))
        };
        let budget = if (1..=10_000_000).contains(&self.budget) {
            Ok(())
        } else {
            let help = "give a number of straight lines, such as 10000";
            Err(KindError::new("budget", format!("{} is not from 1 to 10000000", self.budget), help))
        };
        KindError::gather([
            near("pre_grasp_mm", self.pre_grasp_mm),
            near("grasp_mm", self.grasp_mm),
            toward.clone().map(drop),
            self.palm.map_or(Ok(()), |palm| group::direction("palm", palm).map(drop)),
            moved,
            budget,
        ])?;
        toward
    }
}
