//! The line to a driver in Python, as its thread uses it.

use crate::arrays::{array, vector};
use crate::callback_line::{CallbackAxis, CallbackLine, CallbackSpec, LineCall, LineReading};
use crate::failure::Failure;
use crate::intent::type_name;
use crate::serve::in_words;
use mobee_model::JointMotion;
use numpy::PyArrayDyn;
use pyo3::exceptions::PyBaseException;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyString, PyType};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// Axes of a driver at most.
const MAX_AXES: usize = 1024;
/// Greatest speed, acceleration, limit or effort of an axis.
const MAX_NUMBER: f64 = 1e6;

static CLASSES: PyOnceLock<[Py<PyType>; 2]> = PyOnceLock::new();

/// The classes `Axis` and `Sample`.
fn classes(py: Python<'_>) -> PyResult<&[Py<PyType>; 2]> {
    CLASSES.get_or_try_init(py, || {
        let module = py.import("mobee._driver")?;
        let class = |name| Ok::<_, PyErr>(module.getattr(name)?.cast_into::<PyType>().map_err(PyErr::from)?.unbind());
        Ok([class("Axis")?, class("Sample")?])
    })
}

/// The positions for a driver's motors, or none, and whether they are to be stopped afterwards.
type LineReply<'py> = (Option<Bound<'py, PyArrayDyn<f64>>>, bool);
/// Cycles, those that were late, and of the last thousand the median, the 99th percentile and the greatest duration, s.
type CycleParts = (u64, u64, f64, f64, f64);

/// The line between the driver of a run and the thread of a driver in Python.
#[pyclass(name = "DriverLine", module = "mobee._native", frozen)]
pub(crate) struct PyDriverLine {
    pub line: Arc<CallbackLine>,
    pid: u32,
}

impl PyDriverLine {
    /// # Errors
    /// A process that was forked from that of the line.
    pub fn own(&self) -> Result<&Arc<CallbackLine>, Failure> {
        if std::process::id() == self.pid {
            return Ok(&self.line);
        }
        let what = "the driver belongs to the process from which this one was forked";
        Err(Failure::new("fork", what, "make the driver in this process, or start it by spawn"))
    }
}

#[pymethods]
impl PyDriverLine {
    #[new]
    #[pyo3(signature = (class_, axes, *, period, latency, connect_s))]
    fn new(
        class_: String,
        axes: &Bound<'_, PyAny>,
        period: &Bound<'_, PyAny>,
        latency: &Bound<'_, PyAny>,
        connect_s: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let seconds = |what: &str, value: &Bound<'_, PyAny>, bounds: [f64; 2]| {
            let place = format!("{class_}.{what}");
            Ok::<_, PyErr>(Duration::from_secs_f64(number(&place, value, bounds)?))
        };
        let period = seconds("period", period, [0.002, 0.1])?;
        let latency = seconds("latency", latency, [0.0, 10.0])?;
        let patience = seconds("connect_s", connect_s, [0.0, 600.0])?;
        let axes = read_axes(&class_, axes)?;
        let spec = CallbackSpec { class: class_, axes, period, latency, patience };
        Ok(Self { line: Arc::new(CallbackLine::new(spec)), pid: std::process::id() })
    }

    /// Waits for the next call to make, for a tenth of a second at most: ``connect``, ``cycle``, ``again``; None at the end.
    fn wait(&self, py: Python<'_>) -> PyResult<Option<&'static str>> {
        let line = self.own()?;
        let call = py.detach(|| line.wait());
        py.check_signals()?;
        Ok(match call {
            LineCall::Connect => Some("connect"),
            LineCall::Cycle => Some("cycle"),
            LineCall::Again => Some("again"),
            LineCall::End => None,
        })
    }

    /// Passes a sample on, or None if it was lost: the positions for the motors, rad or m, or None while they are only read; and whether to stop them afterwards.
    fn reply<'py>(&self, py: Python<'py>, sample: &Bound<'py, PyAny>) -> PyResult<LineReply<'py>> {
        let line = self.own()?;
        let spec = &line.spec;
        let (place, n) = (format!("{}.read", spec.class), spec.axes.len());
        let [_, class] = classes(py)?;
        if !sample.is_none() && !sample.is_instance(class.bind(py))? {
            let message = format!("read returned {}", type_name(sample));
            return Err(Failure::new("type", message, "return mobee.Sample(q), or None for a reading that was lost")
                .at(place)
                .into());
        }
        let remedy = format!("give ({n},): one number for each of axes, in their order");
        let numbers = |what: &str| {
            let value = sample.getattr(what)?;
            if value.is_none() && what != "q" {
                return Ok(Vec::new());
            }
            vector(&format!("{place}: {what}"), &value, n, &remedy)
        };
        let reading = match sample.is_none() {
            true => None,
            false => Some(LineReading { q: numbers("q")?, external: numbers("external")?, held: numbers("held")? }),
        };
        let targets = line.reply(reading.as_ref()).map_err(|what| {
            let (what, remedy) = what.split_once(": ").unwrap_or((&what, ""));
            PyErr::from(Failure::new("limits", what, remedy).at(place))
        })?;
        let q = targets.q.map(|q| array(py, q, &[n])).transpose()?;
        Ok((q, targets.stop))
    }

    /// Reports an exception of the driver.
    fn fail(&self, py: Python<'_>, error: Bound<'_, PyBaseException>) -> PyResult<()> {
        let line = self.own()?;
        let text = in_words(py, &PyErr::from_value(error.into_any()));
        line.fail(last_line(&text), &text);
        Ok(())
    }

    /// Brakes the arm; `wait` then returns None.
    fn end(&self) {
        if let Ok(line) = self.own() {
            line.end();
        }
    }

    /// Reports that the thread of the driver has ended.
    fn leave(&self) {
        if let Ok(line) = self.own() {
            line.leave();
        }
    }

    /// Cycles, late ones, and of the last thousand the median, the 99th percentile and the greatest duration, s.
    fn cycles(&self) -> CycleParts {
        let c = self.line.cycles();
        (c.cycles, c.lost, c.median.as_secs_f64(), c.p99.as_secs_f64(), c.most.as_secs_f64())
    }
}

/// The lines of a run's drivers, by robot.
///
/// # Errors
/// A driver that belongs to another process.
pub(crate) fn drivers_of(given: &Bound<'_, PyDict>) -> PyResult<BTreeMap<String, Arc<CallbackLine>>> {
    let mut all = BTreeMap::new();
    for (robot, line) in given.iter() {
        let line = line.cast::<PyDriverLine>().map_err(PyErr::from)?;
        all.insert(robot.extract()?, line.get().own()?.clone());
    }
    Ok(all)
}

/// The line of a traceback that has the exception, with what is indented below it.
fn last_line(text: &str) -> String {
    let lines: Vec<&str> = text.lines().filter(|line| !line.trim().is_empty()).collect();
    let last = lines.iter().rposition(|line| !line.starts_with(' ')).unwrap_or_default();
    lines.get(last..).unwrap_or_default().iter().map(|line| line.trim()).collect::<Vec<_>>().join("; ")
}

fn read_axes(class: &str, axes: &Bound<'_, PyAny>) -> PyResult<Vec<CallbackAxis>> {
    let py = axes.py();
    let [base, _] = classes(py)?;
    let place = format!("{class}.axes");
    let wrong = |what: String| PyErr::from(Failure::new("axes", what, "give a list of mobee.Axis").at(place.clone()));
    let items = axes.try_iter().map_err(|_| wrong(format!("axes is {}", type_name(axes))))?;
    let mut all: Vec<CallbackAxis> = Vec::new();
    for item in items.take(MAX_AXES + 1) {
        let item = item?;
        if !item.is_instance(base.bind(py))? {
            return Err(wrong(format!("axes has {}", type_name(&item))));
        }
        let axis = read_axis(&format!("{place}[{}]", all.len()), &item)?;
        if all.iter().any(|other| other.name == axis.name) {
            return Err(wrong(format!("axes has {:?} twice", axis.name)));
        }
        all.push(axis);
    }
    match all.len() {
        0 => Err(wrong("axes is empty".into())),
        n if n > MAX_AXES => Err(wrong(format!("axes has more than {MAX_AXES} axes"))),
        _ => Ok(all),
    }
}

fn read_axis(place: &str, item: &Bound<'_, PyAny>) -> PyResult<CallbackAxis> {
    let wrong = |what: &str, remedy: &str| PyErr::from(Failure::new("axes", what, remedy).at(place.to_owned()));
    let name = item.getattr("name")?;
    let name = name.cast::<PyString>().map_err(|_| wrong("its name is no string", "give the name of a joint"))?;
    let unit = item.getattr("unit")?;
    let motion = match unit.cast::<PyString>().map(|unit| unit.to_string_lossy().into_owned()).as_deref() {
        Ok("rad") => JointMotion::Turn,
        Ok("m") => JointMotion::Slide,
        _ => {
            return Err(wrong(
                "its unit is neither \"rad\" nor \"m\"",
                "give \"rad\", or \"m\" for a joint that slides",
            ));
        }
    };
    let at = |what: &str, bounds| number(&format!("{place}.{what}"), &item.getattr(what)?, bounds);
    let limit = |what: &str| {
        let value = item.getattr(what)?;
        let read = || number(&format!("{place}.{what}"), &value, [-MAX_NUMBER, MAX_NUMBER]);
        if value.is_none() { Ok::<_, PyErr>(None) } else { read().map(Some) }
    };
    let (lower, upper) = (limit("lower")?, limit("upper")?);
    if lower.zip(upper).is_some_and(|(lower, upper)| lower >= upper) {
        return Err(wrong("its lower limit is not below its upper one", "correct lower and upper"));
    }
    Ok(CallbackAxis {
        name: name.to_string_lossy().into_owned(),
        lower,
        upper,
        max_speed: at("max_speed", [1e-4, MAX_NUMBER])?,
        max_acceleration: at("max_acceleration", [1e-3, MAX_NUMBER])?,
        motion,
        resolution: at("resolution", [0.0, 1.0])?,
        hold_error: at("hold_error", [0.0, 1.0])?,
        contact_effort: at("contact_effort", [0.0, MAX_NUMBER])?,
    })
}

/// A number within bounds.
fn number(place: &str, value: &Bound<'_, PyAny>, [low, high]: [f64; 2]) -> PyResult<f64> {
    let remedy = format!("give a number from {low} to {high}");
    let number: f64 = value.extract().map_err(|_| {
        let message = format!("it is no number, but {}", type_name(value));
        PyErr::from(Failure::new("type", message, remedy.clone()).at(place))
    })?;
    if !(low..=high).contains(&number) {
        return Err(Failure::new("bounds", format!("it is {number}"), remedy).at(place).into());
    }
    Ok(number)
}
