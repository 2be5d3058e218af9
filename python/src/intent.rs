//! From what an agent in Python returns to an intent of the contract.

use crate::arrays::Rows;
use crate::failure::Failure;
use crate::joints::{Beyond, JointTable};
use mobee_contract::{Intent, Setpoints, Summary, Target, Values};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyMapping, PyString, PyType};
use std::time::Duration;

/// Longest pause, s: a hundred days.
const MAX_WAIT_S: f64 = 8_640_000.0;
/// Characters of a summary at most, and figures.
const MAX_TEXT: usize = 10_000;
const MAX_FIGURES: usize = 1000;
/// Names of joints in one answer at most.
const MAX_NAMES: usize = 4096;

static CLASSES: PyOnceLock<[Py<PyType>; 5]> = PyOnceLock::new();

/// The classes of answers, in the order `MoveTo`, `Stream`, `Wait`, `Stop`, `Done`.
fn classes(py: Python<'_>) -> PyResult<&[Py<PyType>; 5]> {
    CLASSES.get_or_try_init(py, || {
        let module = py.import("mobee._agent")?;
        let class = |name| Ok::<_, PyErr>(module.getattr(name)?.cast_into::<PyType>().map_err(PyErr::from)?.unbind());
        Ok([class("MoveTo")?, class("Stream")?, class("Wait")?, class("Stop")?, class("Done")?])
    })
}

/// A robot at a configuration, for which an answer is read.
pub(crate) struct AnsweringRobot<'a> {
    pub joints: &'a JointTable,
    /// Rad of encoder.
    pub pose: &'a [f64],
    /// The call, for messages: `MyAgent.next`.
    pub place: String,
}

/// Reads an answer.
///
/// # Errors
/// An object of another type, or values that no robot could do.
pub(crate) fn intent(answer: &Bound<'_, PyAny>, at: &AnsweringRobot<'_>) -> PyResult<Intent> {
    let py = answer.py();
    let [move_to, stream, wait, stop, done] = classes(py)?;
    let is = |class: &Py<PyType>| answer.is_instance(class.bind(py));
    if is(move_to)? {
        let (motors, q) = at.positions(&answer.getattr("q")?, &answer.getattr("joints")?)?;
        let speed = at.number("speed", &answer.getattr("speed")?)?;
        if !(speed > 0.0 && speed <= 1.0) {
            let message = format!("speed is {speed}");
            return Err(Failure::new("speed", message, "give a share of the greatest speed, above 0 and up to 1")
                .at(format!("{}: speed", at.place))
                .into());
        }
        return Ok(Intent::MoveTo(Target { motors, q, speed }));
    }
    if is(stream)? {
        let position = answer.getattr("position")?;
        let velocity = answer.getattr("velocity")?;
        let names = answer.getattr("joints")?;
        let (motors, values) = match (position.is_none(), velocity.is_none()) {
            (false, true) => {
                let (motors, q) = at.positions(&position, &names)?;
                (motors, Values::Position(q))
            }
            (true, false) => {
                let (motors, v) = at.velocities(&velocity, &names)?;
                (motors, Values::Velocity(v))
            }
            _ => {
                let message = "a Stream has either position or velocity";
                return Err(Failure::new("stream", message, "give one of the two").at(at.place.clone()).into());
            }
        };
        return Ok(Intent::Stream(Setpoints { motors, values }));
    }
    if is(wait)? {
        let seconds = at.number("seconds", &answer.getattr("seconds")?)?;
        if !(0.0..=MAX_WAIT_S).contains(&seconds) {
            let message = format!("Wait of {seconds} s");
            return Err(Failure::new("wait", message, format!("give seconds between 0 and {MAX_WAIT_S}"))
                .at(at.place.clone())
                .into());
        }
        return Ok(Intent::Wait(Duration::from_secs_f64(seconds)));
    }
    if is(stop)? {
        return Ok(Intent::Stop);
    }
    if is(done)? {
        return Ok(Intent::Done(summary(answer, at)?));
    }
    let name = type_name(answer);
    let message = format!("the agent returned {name}");
    let remedy = "return mobee.MoveTo, Stream, Wait, Stop or Done (an object, not the class)";
    Err(Failure::new("type", message, remedy).at(at.place.clone()).into())
}

/// The name of an object's type.
pub(crate) fn type_name(value: &Bound<'_, PyAny>) -> String {
    value.get_type().name().map(|name| name.to_string_lossy().chars().take(200).collect()).unwrap_or_default()
}

fn summary(answer: &Bound<'_, PyAny>, at: &AnsweringRobot<'_>) -> PyResult<Summary> {
    let wrong = |what: &str, remedy: &str| PyErr::from(Failure::new("type", what, remedy).at(at.place.clone()));
    let text = answer.getattr("text")?;
    let text = text.cast::<PyString>().map_err(|_| wrong("the text of Done is not a string", "give a str"))?;
    let text: String = text.to_string_lossy().chars().take(MAX_TEXT).collect();
    let figures = answer.getattr("figures")?;
    let mut all = Vec::new();
    if !figures.is_none() {
        let figures = figures
            .cast::<PyMapping>()
            .map_err(|_| wrong("the figures of Done are not a mapping", "give a dict of numbers by their names"))?;
        for item in figures.items()?.iter().take(MAX_FIGURES) {
            let (name, value): (Bound<'_, PyAny>, Bound<'_, PyAny>) = item.extract()?;
            let name = name.cast::<PyString>().map_err(|_| wrong("a figure's name is not a string", "give a str"))?;
            all.push((name.to_string_lossy().into_owned(), at.number("figures", &value)?));
        }
    }
    Ok(Summary { text, figures: all })
}

impl AnsweringRobot<'_> {
    /// A finite number.
    fn number(&self, what: &str, value: &Bound<'_, PyAny>) -> PyResult<f64> {
        let place = || format!("{}: {what}", self.place);
        let number: f64 = value.extract().map_err(|_| {
            let message = format!("{what} is no number, but {}", type_name(value));
            PyErr::from(Failure::new("type", message, "give a float").at(place()))
        })?;
        if !number.is_finite() {
            let message = format!("{what} is {number}");
            return Err(Failure::new("not_finite", message, "give a finite number").at(place()).into());
        }
        Ok(number)
    }

    /// Positions of joints, as indices and rad of encoder. What is beyond the limits is passed on: the controller refuses it.
    fn positions(&self, q: &Bound<'_, PyAny>, names: &Bound<'_, PyAny>) -> PyResult<(Vec<usize>, Vec<f64>)> {
        let (motors, given) = self.numbers("q", q, names)?;
        let mut whole = self.joints.configuration(self.pose);
        for (motor, value) in motors.iter().zip(&given) {
            if let Some(slot) = whole.get_mut(*motor) {
                *slot = *value;
            }
        }
        let place = format!("{}: q", self.place);
        self.joints.convert(&place, &mut whole, None, Beyond::Straight)?;
        let q = motors.iter().filter_map(|motor| whole.get(*motor).copied()).collect();
        Ok((motors, q))
    }

    /// Velocities of joints, as indices and rad of encoder per second.
    fn velocities(&self, v: &Bound<'_, PyAny>, names: &Bound<'_, PyAny>) -> PyResult<(Vec<usize>, Vec<f64>)> {
        let (motors, mut given) = self.numbers("velocity", v, names)?;
        for (motor, value) in motors.iter().zip(&mut given) {
            if !value.is_finite() {
                let message = format!("a velocity is {value}");
                let place = format!("{}: velocity", self.place);
                return Err(Failure::new("not_finite", message, "give finite numbers").at(place).into());
            }
            *value *= self.joints.scale(*motor);
        }
        Ok((motors, given))
    }

    /// Numbers of all joints, or of those that are named.
    fn numbers(
        &self,
        what: &'static str,
        values: &Bound<'_, PyAny>,
        names: &Bound<'_, PyAny>,
    ) -> PyResult<(Vec<usize>, Vec<f64>)> {
        let place = format!("{}: {what}", self.place);
        let motors = if names.is_none() { (0..self.joints.len()).collect() } else { self.indices(names)? };
        let named = self.joints.among(&motors);
        let rows = Rows::configurations(&place, values, &named)?;
        if !rows.single {
            let message = format!("{what} is a batch");
            return Err(Failure::new("shape", message, format!("give ({},)", motors.len())).at(place).into());
        }
        let mut given = Vec::with_capacity(motors.len());
        rows.load(0, 1, &mut given)?;
        Ok((motors, given))
    }

    fn indices(&self, names: &Bound<'_, PyAny>) -> PyResult<Vec<usize>> {
        indices(self.joints, names, &self.place)
    }
}

/// Indices of joints that are named, each once.
///
/// # Errors
/// A name that is unknown or given twice, no name, or something else than names.
pub(crate) fn indices(joints: &JointTable, names: &Bound<'_, PyAny>, place: &str) -> PyResult<Vec<usize>> {
    let place = || format!("{place}: joints");
    let wrong = |what: String, remedy: &str| PyErr::from(Failure::new("joints", what, remedy).at(place()));
    if names.is_instance_of::<PyString>() {
        return Err(wrong("joints is a string".to_owned(), "give a list of names"));
    }
    let mut all = Vec::new();
    for name in names.try_iter()?.take(MAX_NAMES) {
        let name = name?;
        let text = name
            .cast::<PyString>()
            .map_err(|_| wrong("joints has something else than names".to_owned(), "give names"))?;
        let text = text.to_string_lossy();
        let Some(joint) = joints.names.iter().position(|known| *known == text) else {
            let known: Vec<&str> = joints.names.iter().map(String::as_str).collect();
            let remedy = mobee_model::suggestion(&text, "joint", &known);
            return Err(wrong(format!("the robot has no joint {text:?}"), &remedy));
        };
        if all.contains(&joint) {
            return Err(wrong(format!("joint {text:?} is named twice"), "name each once"));
        }
        all.push(joint);
    }
    if all.is_empty() {
        return Err(wrong("joints is empty".to_owned(), "name a joint, or leave joints out for all of them"));
    }
    Ok(all)
}

/// The state of an agent as JSON.
///
/// # Errors
/// A state that is not JSON, or too long.
pub(crate) fn state(exported: &Bound<'_, PyAny>, place: &str) -> PyResult<serde_json::Value> {
    /// Length of a state at most, bytes.
    const MAX_STATE: usize = 4 << 20;
    if exported.is_none() {
        return Ok(serde_json::Value::Null);
    }
    let py = exported.py();
    let options = PyDict::new(py);
    options.set_item("allow_nan", false)?;
    let text: String = py.import("json")?.call_method("dumps", (exported,), Some(&options))?.extract()?;
    let wrong = |what: String, remedy: &str| PyErr::from(Failure::new("state", what, remedy).at(place.to_owned()));
    if text.len() > MAX_STATE {
        let what = format!("the state has {} bytes", text.len());
        return Err(wrong(what, &format!("export {MAX_STATE} bytes at most")));
    }
    serde_json::from_str(&text).map_err(|e| wrong(format!("the state can't be read back: {e}"), "export plain JSON"))
}
