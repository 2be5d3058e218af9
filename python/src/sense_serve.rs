//! Detectors and locators in Python: the calls of a run put to them, in the thread that started it.

use crate::arrays::{array, fixed};
use crate::failure::Failure;
use crate::given::{Given, PartBase};
use crate::intent::{state, type_name};
use crate::pose::{from_matrix, matrix};
use crate::sense_relay::{PendingSense, SenseFound, SenseQuestion, SenseReply};
use crate::sense_slots::SenseClasses;
use crate::serve::reply_of;
use crate::view::RunRobots;
use mobee_contract::{BodyState, Frame, Intrinsics, Located, Region, SeenPose, Sighting, check_object_name};
use nalgebra::Isometry3;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use std::collections::BTreeMap;
use std::time::Duration;

/// Regions or places of one call at most.
const MAX_FOUND: usize = 4096;
/// Longest simulated duration of a call, s: that of a frame.
const MAX_TAKES: f64 = 10.0;

const DETECTOR: PartBase = PartBase { module: "mobee._sense", class: "Detector", argument: "detectors", of: "camera" };
const LOCATOR: PartBase = PartBase { module: "mobee._sense", class: "Locator", argument: "locators", of: "sensor" };

/// The detectors and locators of a run, by their keys.
pub(crate) struct PySenses {
    detectors: BTreeMap<String, Given>,
    locators: BTreeMap<String, Given>,
}

impl PySenses {
    /// Reads the arguments `detectors` and `locators`.
    ///
    /// # Errors
    /// A value that is neither.
    pub fn read(detectors: &Bound<'_, PyDict>, locators: &Bound<'_, PyDict>) -> PyResult<Self> {
        Ok(Self { detectors: DETECTOR.read(detectors)?, locators: LOCATOR.read(locators)? })
    }

    /// The names of their classes, by key.
    pub fn classes(&self) -> SenseClasses {
        let [detectors, locators] = [&self.detectors, &self.locators]
            .map(|all| all.iter().map(|(key, given)| (key.clone(), given.class.clone())).collect());
        SenseClasses { detectors, locators }
    }

    /// Puts a call to its code and sends the reply. An exception is the death of the detector or locator.
    ///
    /// # Errors
    /// Ctrl-C, exit: what is no `Exception`. The call then has no reply.
    pub fn serve(&mut self, py: Python<'_>, robots: &RunRobots, pending: PendingSense) -> PyResult<()> {
        let PendingSense { question, name, life, import, reply } = pending;
        let (base, all) = match question {
            SenseQuestion::Detect(_) => (&DETECTOR, &mut self.detectors),
            SenseQuestion::Locate { .. } => (&LOCATOR, &mut self.locators),
        };
        let answer = || {
            let given = all.get_mut(&name.key).ok_or_else(crate::wait::internal)?;
            let code = given.of_life(py, base, &name.part, life)?;
            if let Some(import) = import {
                let value = py.import("json")?.call_method1("loads", (import.to_string(),))?;
                code.call_method1("import_", (value,))?;
            }
            let class = &given.class;
            let found = match question {
                SenseQuestion::Detect(frame) => {
                    let seen = frame_of(py, &name.part, &frame)?;
                    let answer = code.call_method1("detect", (seen,))?;
                    SenseFound::Regions(each(&answer, &format!("{class}.detect"), |one, place| {
                        region(one, place, frame.intrinsics.size)
                    })?)
                }
                SenseQuestion::Locate { seen, body, robot } => {
                    let seen = seen.iter().map(|s| sighting_of(py, s)).collect::<PyResult<Vec<_>>>()?;
                    let body = body_of(py, robots, &body, robot)?;
                    let answer = code.call_method1("locate", (seen, body))?;
                    SenseFound::Places(each(&answer, &format!("{class}.locate"), located)?)
                }
            };
            let takes = duration(&code.getattr("takes")?, class)?;
            let state = state(&code.call_method0("export")?, &format!("{class}.export"))?;
            Ok(SenseReply { found, takes, state })
        };
        // fails if the run ends
        let _ = reply.try_send(reply_of(py, answer())?);
        Ok(())
    }
}

fn class<'py>(py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    py.import("mobee._sense")?.getattr(name)
}

fn intrinsics_of<'py>(py: Python<'py>, of: &Intrinsics) -> PyResult<Bound<'py, PyAny>> {
    let Intrinsics { size, focal, center, distortion } = of;
    class(py, "Intrinsics")?.call1(((size[0], size[1]), tuple(focal), tuple(center), distortion.to_vec()))
}

fn tuple(pair: &[f64; 2]) -> (f64, f64) {
    (pair[0], pair[1])
}

fn frame_of<'py>(py: Python<'py>, camera: &str, frame: &Frame) -> PyResult<Bound<'py, PyAny>> {
    let [width, height] = frame.intrinsics.size;
    let flat = py.import("numpy")?.call_method1("frombuffer", (PyBytes::new(py, &frame.pixels), "uint8"))?;
    let pixels = flat.call_method1("reshape", ((height, width, 3),))?;
    let intrinsics = intrinsics_of(py, &frame.intrinsics)?;
    class(py, "Frame")?.call1((camera, frame.exposed.secs(), pixels, intrinsics))
}

fn sighting_of<'py>(py: Python<'py>, seen: &Sighting) -> PyResult<Bound<'py, PyAny>> {
    let Sighting { camera, intrinsics, region, at } = seen;
    let [left, top, right, bottom] = region.bounds;
    let pose = region.pose.as_ref().map(|pose| {
        let at = pose.position.into();
        let [w, i, j, k] = pose.rotation;
        let turn = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, i, j, k));
        let covariance: Vec<f64> = pose.covariance.iter().flatten().copied().collect();
        let pose = matrix(&Isometry3::from_parts(nalgebra::Translation3 { vector: at }, turn));
        Ok::<_, PyErr>((array(py, pose.to_vec(), &[4, 4])?, array(py, covariance, &[6, 6])?))
    });
    let (pose, covariance) = pose.transpose()?.unzip();
    let values = PyDict::new(py);
    values.set_item("center", tuple(&region.center))?;
    values.set_item("area", region.area)?;
    values.set_item("confidence", region.confidence)?;
    values.set_item("is_clipped", region.is_clipped)?;
    values.set_item("pose", pose)?;
    values.set_item("covariance", covariance)?;
    let region = class(py, "Region")?.call((&region.object, (left, top, right, bottom)), Some(&values))?;
    class(py, "Sighting")?.call1((&**camera, at.secs(), region, intrinsics_of(py, intrinsics)?))
}

fn body_of<'py>(py: Python<'py>, robots: &RunRobots, body: &BodyState, robot: usize) -> PyResult<Bound<'py, PyAny>> {
    let joints = robots.joints.get(robot).ok_or_else(crate::wait::internal)?;
    let q = joints.configuration(&body.q);
    let count = q.len();
    let base = array(py, matrix(&robots.start.base(robot)).to_vec(), &[4, 4])?;
    let model = robots.model(py, &robots.start, robot)?;
    class(py, "Body")?.call1((body.at.secs(), array(py, q, &[count])?, model, base))
}

/// Converts each item of a returned list.
fn each<T>(
    answer: &Bound<'_, PyAny>,
    place: &str,
    of: impl Fn(&Bound<'_, PyAny>, &str) -> PyResult<T>,
) -> PyResult<Vec<T>> {
    let Ok(items) = answer.try_iter() else {
        let what = format!("it returned {}", type_name(answer));
        return Err(Failure::new("type", what, "return a list, [] for nothing").at(place).into());
    };
    let mut all = Vec::new();
    for (i, item) in items.enumerate() {
        if i >= MAX_FOUND {
            let what = format!("it returned more than {MAX_FOUND} items");
            return Err(Failure::new("too_many", what, "return the most confident ones").at(place).into());
        }
        all.push(of(&item?, &format!("{place}[{i}]"))?);
    }
    Ok(all)
}

/// Tests the class of a returned item.
fn expect(item: &Bound<'_, PyAny>, name: &str, place: &str) -> PyResult<()> {
    if item.is_instance(&class(item.py(), name)?)? {
        return Ok(());
    }
    let what = format!("it is {}", type_name(item));
    Err(Failure::new("type", what, format!("return objects of mobee.{name}")).at(place).into())
}

fn object(item: &Bound<'_, PyAny>, place: &str) -> PyResult<String> {
    let name = item.getattr("object")?;
    let wrong = |what: String| PyErr::from(Failure::new("object", what, "give a name of the world").at(place));
    let name: String = name.extract().map_err(|_| wrong(format!("its object is {}", type_name(&name))))?;
    check_object_name(&name).map_err(|why| wrong(format!("the object's name {why}")))?;
    Ok(name)
}

/// An attribute that is an array of finite numbers.
fn numbers<const N: usize>(item: &Bound<'_, PyAny>, name: &str, shape: &[usize], place: &str) -> PyResult<[f64; N]> {
    let place = format!("{place}.{name}");
    let remedy = match shape {
        [] => "give a number".to_owned(),
        [n] => format!("give an array ({n},)"),
        many => format!("give an array {many:?}"),
    };
    let all = fixed::<N>(&place, &item.getattr(name)?, shape, &remedy)?;
    if let Some(x) = all.iter().find(|x| !x.is_finite()) {
        return Err(Failure::new("not_finite", format!("it has {x}"), "give finite numbers").at(place).into());
    }
    Ok(all)
}

fn region(item: &Bound<'_, PyAny>, place: &str, size: [u32; 2]) -> PyResult<Region> {
    expect(item, "Region", place)?;
    let wrong = |what: String, remedy: &str| PyErr::from(Failure::new("region", what, remedy).at(place));
    let bounds @ [left, top, right, bottom] = numbers::<4>(item, "bounds", &[4], place)?;
    if right < left || bottom < top {
        return Err(wrong(format!("its bounds are {bounds:?}"), "give left, top, right, bottom, pixels"));
    }
    let is_none = |name: &str| Ok::<_, PyErr>(item.getattr(name)?.is_none());
    let center = match is_none("center")? {
        true => [f64::midpoint(left, right), f64::midpoint(top, bottom)],
        false => numbers::<2>(item, "center", &[2], place)?,
    };
    let number = |name: &str| Ok::<_, PyErr>(numbers::<1>(item, name, &[], place)?[0]);
    let area = if is_none("area")? { (right - left) * (bottom - top) } else { number("area")? };
    let confidence = number("confidence")?;
    if !(0.0..=1.0).contains(&confidence) || area < 0.0 {
        let what = format!("its confidence is {confidence}, its area {area}");
        return Err(wrong(what, "give a confidence from 0 to 1, and an area from 0 on"));
    }
    let [width, height] = size.map(f64::from);
    let is_clipped = match is_none("is_clipped")? {
        true => left <= 0.0 || top <= 0.0 || right >= width || bottom >= height,
        false => item.getattr("is_clipped")?.is_truthy()?,
    };
    let pose = if is_none("pose")? { None } else { Some(seen_pose(item, place)?) };
    Ok(Region { object: object(item, place)?, center, bounds, area, is_clipped, confidence, pose })
}

fn seen_pose(item: &Bound<'_, PyAny>, place: &str) -> PyResult<SeenPose> {
    let pose = from_matrix(&format!("{place}.pose"), &numbers::<16>(item, "pose", &[4, 4], place)?)?;
    let covariance = numbers::<36>(item, "covariance", &[6, 6], place)?;
    let mut rows = [[0.0; 6]; 6];
    for (row, given) in rows.iter_mut().zip(covariance.chunks_exact(6)) {
        row.copy_from_slice(given);
    }
    let turn = pose.rotation;
    Ok(SeenPose {
        position: pose.translation.vector.into(),
        rotation: [turn.w, turn.i, turn.j, turn.k],
        covariance: rows,
    })
}

fn located(item: &Bound<'_, PyAny>, place: &str) -> PyResult<Located> {
    expect(item, "Located", place)?;
    let position = numbers::<3>(item, "position", &[3], place)?;
    let flat = numbers::<9>(item, "covariance", &[3, 3], place)?;
    let mut covariance = [[0.0; 3]; 3];
    for (row, given) in covariance.iter_mut().zip(flat.chunks_exact(3)) {
        row.copy_from_slice(given);
    }
    Ok(Located { object: object(item, place)?, position, covariance })
}

fn duration(takes: &Bound<'_, PyAny>, class: &str) -> PyResult<Duration> {
    let seconds = takes.extract::<f64>().ok().filter(|s| (0.0..=MAX_TAKES).contains(s));
    let wrong = || {
        let what = format!("takes is {}", takes.repr().map(|r| r.to_string()).unwrap_or_default());
        Failure::new("bounds", what, format!("give seconds, 0 to {MAX_TAKES}")).at(format!("{class}.takes"))
    };
    Ok(Duration::from_secs_f64(seconds.ok_or_else(wrong)?))
}
