//! Problem files: planning problems of one robot, scene by scene, as the data of MotionBenchMaker are shipped (`"format": "mbm 1"`).

use mobee_model::file::read_text;
use mobee_model::{Object, ObjectClass, Primitive, Shape};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use serde::de::{Error as _, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;
use std::fmt::{self, Display};
use std::marker::PhantomData;
use std::path::Path;

/// The format that is read.
const FORMAT: &str = "mbm 1";
/// The largest file that is read, bytes: thirty times the public ones.
const MAX_FILE_BYTES: u64 = 20_000_000;
/// The most obstacles of a problem.
const MAX_OBSTACLES: usize = 10_000;
/// No position or size is larger, meters.
const MAX_M: f64 = 1e3;
/// The scene whose cylinders count as boxes, as in the published figures; elsewhere they count as capsules.
const BOX_SCENE: &str = "box";

/// A fault of an input: its place and kind, and the remedy.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct InputFault {
    pub text: String,
    pub help: String,
}

impl InputFault {
    pub fn new(text: impl Display, help: impl Display) -> InputFault {
        InputFault { text: text.to_string(), help: help.to_string() }
    }
}

/// A file of problems.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ProblemFile {
    format: String,
    /// Stem of the robot's files in `robots/`.
    pub robot: String,
    /// Joints that are planned for, in the order of start and goal.
    pub joints: Vec<String>,
    /// Joints that stand still, rad or meters.
    #[serde(default, deserialize_with = "unique")]
    pub others: BTreeMap<String, f64>,
    /// Pairs that may touch in all problems, `A:B`: links, parts and markers.
    #[serde(default)]
    pub may_touch: Vec<String>,
    /// Clearances of pairs in all problems where they are lower than that of all others, mm.
    #[serde(default, deserialize_with = "unique")]
    pub pair_clearance_mm: BTreeMap<String, f64>,
    /// Problems by scene.
    #[serde(deserialize_with = "unique")]
    pub scenes: BTreeMap<String, Vec<Problem>>,
}

/// A problem: a start, a goal, and what stands about the robot.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Problem {
    /// Its number in the scene.
    pub index: u32,
    /// Whether start and goal are free by the judge of the data set.
    pub valid: bool,
    /// Rad, or meters where a joint slides.
    pub start: Vec<f64>,
    /// As `start`.
    pub goal: Vec<f64>,
    /// More pairs that may touch in this problem, `A:B`: also obstacles, `obstacle0` and so on, counted through boxes,
    /// cylinders and spheres in this order.
    #[serde(default)]
    pub may_touch: Vec<String>,
    /// Position, quaternion (x, y, z, w), full size.
    #[serde(default)]
    boxes: Vec<[f64; 10]>,
    /// Position, quaternion, radius, length; along local z.
    #[serde(default)]
    cylinders: Vec<[f64; 9]>,
    /// Position, radius.
    #[serde(default)]
    spheres: Vec<[f64; 4]>,
}

/// Reads a map and refuses a key that is there twice: the last one would replace the others silently.
fn unique<'de, D, T>(from: D) -> Result<BTreeMap<String, T>, D::Error>
where
    D: Deserializer<'de>,
    T: Deserialize<'de>,
{
    struct UniqueKeys<T>(PhantomData<T>);
    impl<'de, T: Deserialize<'de>> Visitor<'de> for UniqueKeys<T> {
        type Value = BTreeMap<String, T>;

        fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
            f.write_str("a map with each key once")
        }

        fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
            let mut all = BTreeMap::new();
            while let Some(key) = map.next_key::<String>()? {
                // Before the value is read: the error's place is that of the key.
                if all.contains_key(&key) {
                    return Err(A::Error::custom(format!("the key `{key}` is there twice")));
                }
                let value = map.next_value()?;
                all.insert(key, value);
            }
            Ok(all)
        }
    }
    from.deserialize_map(UniqueKeys(PhantomData))
}

/// Reads a file of problems.
///
/// # Errors
/// If it can't be read or is not one, with place and remedy.
pub(crate) fn read_problems(path: &Path) -> Result<ProblemFile, InputFault> {
    let help = "give problem files such as panda.json, with the robot's files in robots/ beside them";
    let named = |what: &dyn Display| format!("{}: {what}", path.display());
    let text = read_text(path, MAX_FILE_BYTES).map_err(|e| InputFault::new(named(&e), help))?;
    let file: ProblemFile = serde_json::from_str(&text).map_err(|e| InputFault::new(named(&e), help))?;
    file.check().map_err(|fault| InputFault::new(named(&fault.text), fault.help))?;
    Ok(file)
}

impl ProblemFile {
    fn check(&self) -> Result<(), InputFault> {
        if self.format != FORMAT {
            let text = format!("the format {:?} is unknown", self.format);
            return Err(InputFault::new(text, format!("give a file whose `format` is {FORMAT:?}")));
        }
        let plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
        if self.robot.is_empty() || !self.robot.chars().all(plain) {
            let text = format!("`robot` is {:?}, which names no file", self.robot);
            return Err(InputFault::new(text, "give the name of the robot's files in robots/, of letters and digits"));
        }
        if self.joints.is_empty() {
            return Err(InputFault::new("`joints` is empty", "name the joints that are planned for"));
        }
        for (scene, problems) in &self.scenes {
            for (i, problem) in problems.iter().enumerate() {
                problem
                    .check(self.joints.len())
                    .map_err(|fault| InputFault::new(format!("scenes.{scene}[{i}].{}", fault.text), fault.help))?;
            }
        }
        if let Some((joint, _)) = self.others.iter().find(|(_, q)| !q.is_finite()) {
            return Err(InputFault::new(format!("others.{joint} is not finite"), "give a number, rad or meters"));
        }
        Ok(())
    }
}

impl Problem {
    fn check(&self, joints: usize) -> Result<(), InputFault> {
        for (end, q) in [("start", &self.start), ("goal", &self.goal)] {
            if q.len() != joints {
                let text = format!("{end} has {} numbers", q.len());
                return Err(InputFault::new(text, format!("give one for each of the {joints} joints")));
            }
            if q.iter().any(|q| !q.is_finite()) {
                return Err(InputFault::new(
                    format!("{end} is not finite"),
                    "give rad, or meters where a joint slides",
                ));
            }
        }
        let count = self.boxes.len() + self.cylinders.len() + self.spheres.len();
        if count > MAX_OBSTACLES {
            let text = format!("boxes, cylinders and spheres are {count}");
            return Err(InputFault::new(text, format!("give at most {MAX_OBSTACLES}")));
        }
        for (i, row) in self.boxes.iter().enumerate() {
            check_row(row, row.get(7..), true).map_err(|fault| at("boxes", i, fault))?;
        }
        for (i, row) in self.cylinders.iter().enumerate() {
            check_row(row, row.get(7..), true).map_err(|fault| at("cylinders", i, fault))?;
        }
        for (i, row) in self.spheres.iter().enumerate() {
            check_row(row, row.get(3..), false).map_err(|fault| at("spheres", i, fault))?;
        }
        Ok(())
    }

    /// What stands about the robot. Cylinders are capsules whose ends' centers are `length` apart, or boxes in the scene `box`: the
    /// questions that published figures answer.
    pub fn objects(&self, scene: &str) -> Vec<Object> {
        let boxes = self.boxes.iter().map(|&[x, y, z, i, j, k, w, a, b, c]| {
            (placed([x, y, z], [i, j, k, w]), Shape::Box { size: Vector3::new(a, b, c) })
        });
        let cylinders = self.cylinders.iter().map(|&[x, y, z, i, j, k, w, radius, length]| {
            let pose = placed([x, y, z], [i, j, k, w]);
            if scene == BOX_SCENE {
                (pose, Shape::Box { size: Vector3::new(2.0 * radius, 2.0 * radius, length) })
            } else {
                // capsules lie along y
                (pose * Isometry3::rotation(Vector3::x() * FRAC_PI_2), Shape::Capsule { radius, height: length })
            }
        });
        let spheres =
            self.spheres.iter().map(|&[x, y, z, radius]| (Isometry3::translation(x, y, z), Shape::Sphere { radius }));
        let all = boxes.chain(cylinders).chain(spheres).enumerate();
        all.map(|(i, (pose, shape))| Object {
            name: format!("obstacle{i}"),
            class: ObjectClass::Obstacle,
            persistent: false,
            pose,
            shapes: vec![Primitive { shape, pose: Isometry3::identity() }],
            color: None,
        })
        .collect()
    }
}

fn at(list: &str, index: usize, fault: InputFault) -> InputFault {
    InputFault::new(format!("{list}[{index}] {}", fault.text), fault.help)
}

fn check_row(row: &[f64], sizes: Option<&[f64]>, turned: bool) -> Result<(), InputFault> {
    if !row.iter().all(|x| x.abs() <= MAX_M) {
        return Err(InputFault::new(format!("has a number beyond {MAX_M} m"), "give meters"));
    }
    if !sizes.is_some_and(|sizes| sizes.iter().all(|size| *size > 0.0)) {
        return Err(InputFault::new("has a size that is not positive", "give sizes in meters, each greater than 0"));
    }
    let norm = row.get(3..7).map(|q| q.iter().map(|x| x * x).sum::<f64>().sqrt());
    if turned && !norm.is_some_and(|n| (n - 1.0).abs() < 1e-3) {
        return Err(InputFault::new("has a quaternion whose length is not 1", "give x, y, z, w of a unit quaternion"));
    }
    Ok(())
}

fn placed([x, y, z]: [f64; 3], [i, j, k, w]: [f64; 4]) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k)))
}
