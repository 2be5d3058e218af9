//! What a user can tell the reaching agent.

use crate::agents::tour::defaults::{half, tenth};
use crate::group;
use crate::roadmap::validation::Validation;
use mobee_contract::KindError;
use mobee_model::Robot;
use nalgebra::{Unit, Vector3};
use schemars::JsonSchema;
use serde::Deserialize;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// Settings of the kind `reach`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReachSettings {
    /// The object to reach for, by its name in the world.
    pub object: String,
    /// The roadmap of pre-grasp poses: a map file, its JSON, or the settings that `mobee roadmap build` takes (`.toml`), of which the map
    /// is built once and kept in the user's cache; or a list of those, one for each arm. Without it every way is planned.
    #[serde(default)]
    #[schemars(extend("format" = "roadmap"))]
    pub map: Option<Value>,
    /// Names of parts or motors that move the hand; default: those of the map.
    #[serde(default)]
    pub motors: Vec<String>,
    /// The marker that stands for the hand, or a list of those, of which the one that gets there best is taken each time; default: those of
    /// the maps, or the one that most of the motors move.
    #[serde(default)]
    pub hand: Option<OneOrMore>,
    /// The direction out of the palm in each marker's frame; default: the marker's normal.
    #[serde(default)]
    pub palm: Option<[f64; 3]>,
    /// Where the palm points to in the pre-grasp and grasp postures, in the world.
    #[serde(default = "down")]
    pub palm_toward: [f64; 3],
    /// Where the hand is before the grasp, from the object's middle, in the world's directions, mm.
    #[serde(default = "before")]
    pub pre_grasp_mm: [f64; 3],
    /// Where the hand is in the grasp posture, from the object's middle, in the world's directions, mm.
    #[serde(default = "at")]
    pub grasp_mm: [f64; 3],
    /// Where the arm rests before it sets out, and after: positions in degrees; motors that are not named are at home.
    #[serde(default)]
    pub rest_deg: BTreeMap<String, f64>,
    /// How its eyes are turned. Without it the robot does not look about.
    #[serde(default)]
    pub gaze: Option<GazeSettings>,
    /// How often to reach, in vain or not; 0: forever.
    #[serde(default)]
    pub repeat: u32,
    /// How long to stay in the grasp posture, seconds.
    #[serde(default)]
    pub wait_s: f64,
    /// Whether the object is followed: if it is found elsewhere on the way, or something comes into the way, the motion is led or planned
    /// anew. `false`: its place is taken once, and the way is driven as it was planned.
    #[serde(default = "yes")]
    pub follow: bool,
    /// An object that is so far from where it was when the hand set out is reached for anew, mm.
    #[serde(default = "moved")]
    pub moved_mm: f64,
    /// Share of each motor's maximum speed, above 0 and up to 1.
    #[serde(default = "tenth")]
    pub speed: f64,
    /// Whether edges are just tried (`optimistic`), or certified in the model before they are driven (`lazy`) or planned over
    /// (`verified`). The last line to the pre-grasp posture, and from there to the grasp, is certified in any case.
    #[serde(default)]
    pub validation: Validation,
    /// The most straight lines between two poses that a planner may judge where no way leads over the map.
    #[serde(default = "budget")]
    pub budget: u64,
    /// How near every motor must be to a pose for the robot to count as at that pose, degrees.
    #[serde(default = "half")]
    pub tolerance_deg: f64,
    /// Seed of all randomness; default: derived from the run's seed.
    #[serde(default)]
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
    /// Each name with the path of its setting.
    pub(super) fn named(&self, path: &str) -> Vec<(String, &str)> {
        match self {
            OneOrMore::One(name) => vec![(path.to_owned(), name)],
            OneOrMore::More(names) => {
                names.iter().enumerate().map(|(i, n)| (format!("{path}[{i}]"), n.as_str())).collect()
            }
        }
    }
}

/// How the eyes are turned.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GazeSettings {
    /// Names of parts or motors that turn the eyes.
    pub motors: Vec<String>,
    /// The markers of the eyes, whose normals point to where they look.
    #[serde(default)]
    pub eyes: Vec<String>,
    /// Poses to look about in while the object is not seen, in degrees; default: about where it is thought to be.
    #[serde(default)]
    pub sweep_deg: Vec<BTreeMap<String, f64>>,
    /// How long to look before the eyes are turned elsewhere, seconds.
    #[serde(default = "half")]
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

/// The farthest that a hand may be from an object, mm: a typing error in meters would be seen.
const FARTHEST_MM: f64 = 2000.0;

/// How the eyes are turned, looked up in the robot.
#[derive(Clone, Debug)]
pub(super) struct GazePlan {
    pub motors: Vec<usize>,
    /// Indices into `Robot::markers`.
    pub eyes: Vec<usize>,
    /// Positions of `motors`, rad.
    pub sweep: Vec<Vec<f64>>,
    pub dwell: std::time::Duration,
    pub speed: f64,
}

impl GazeSettings {
    /// Looks up all names in the robot.
    ///
    /// # Errors
    /// All that is wrong, each with the path of its setting.
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
    /// The markers that stand for the hands: those that are named, or those of the maps.
    ///
    /// # Errors
    /// Markers that the robot does not have; none named, one named twice.
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

    /// Checks numbers and directions; answers where the palm is to point.
    ///
    /// # Errors
    /// All that is wrong, each with the path of its setting.
    pub(super) fn check(&self) -> Result<Unit<Vector3<f64>>, KindError> {
        let near = |path: &str, v: [f64; 3]| {
            let what = format!("[{}, {}, {}] is no place of a hand", v[0], v[1], v[2]);
            let help = format!("give millimeters from the object's middle, each up to {FARTHEST_MM}");
            if v.iter().all(|x| x.abs() <= FARTHEST_MM) { Ok(()) } else { Err(KindError::new(path, what, help)) }
        };
        let toward = group::direction("palm_toward", self.palm_toward);
        let moved = self.moved_mm;
        let moved = if (1.0..=FARTHEST_MM).contains(&moved) {
            Ok(())
        } else {
            let help = format!("give millimeters from 1 to {FARTHEST_MM}, such as 20");
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
