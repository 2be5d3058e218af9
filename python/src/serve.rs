//! Agents in Python: the questions of a run put to them, in the thread that started it.

use crate::given::{Given, PartBase};
use crate::intent::{AnsweringRobot, intent, state, type_name};
use crate::relay::{AgentQuestion, AgentReply, PendingQuestion};
use crate::view::{PyView, RunRobots};
use mobee_contract::MotionEnd;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyType};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Characters of a traceback in the journal at most: its end, where the exception is.
const MAX_TRACEBACK: usize = 8000;

const AGENT: PartBase = PartBase { module: "mobee._agent", class: "Agent", argument: "agents", of: "robot" };

/// The agents of a run, by robot.
pub(crate) struct PyAgents(BTreeMap<String, Given>);

impl PyAgents {
    /// Reads the argument `agents`.
    ///
    /// # Errors
    /// A value that is not an agent.
    pub fn read(agents: &Bound<'_, PyDict>) -> PyResult<Self> {
        Ok(Self(AGENT.read(agents)?))
    }

    /// The names of their classes, by robot.
    pub fn classes(&self) -> BTreeMap<String, String> {
        self.0.iter().map(|(robot, given)| (robot.clone(), given.class.clone())).collect()
    }

    /// Puts a question to its agent and sends the reply. An exception of the agent is its death.
    ///
    /// # Errors
    /// Ctrl-C, exit: what is no `Exception`. The question then has no reply.
    pub fn serve(&mut self, py: Python<'_>, robots: &Arc<RunRobots>, pending: PendingQuestion) -> PyResult<()> {
        let PendingQuestion { question, view, life, reply } = pending;
        let answer = reply_of(py, self.answer(py, robots, question, view, life))?;
        // fails if the run ends
        let _ = reply.try_send(answer);
        Ok(())
    }

    fn answer(
        &mut self,
        py: Python<'_>,
        robots: &Arc<RunRobots>,
        question: AgentQuestion,
        view: mobee_contract::View,
        life: u32,
    ) -> PyResult<AgentReply> {
        let name = robots.names.get(view.robot).cloned().unwrap_or_default();
        let joints = robots.joints.get(view.robot).cloned().ok_or_else(crate::wait::internal)?;
        let given = self.0.get_mut(&name).ok_or_else(crate::wait::internal)?;
        let agent = given.of_life(py, &AGENT, &name, life)?;
        let pose = view.pose().to_vec();
        let seen = Bound::new(py, PyView { view, robots: Arc::clone(robots) })?;
        let standing =
            |call: &str| AnsweringRobot { joints: &joints, pose: &pose, place: format!("{}.{call}", given.class) };
        match question {
            AgentQuestion::Next { last, import } => {
                if let Some(import) = import {
                    let text = py.import("json")?.call_method1("loads", (import.to_string(),))?;
                    agent.call_method1("import_", (text,))?;
                }
                let last = last.map(|last| match last {
                    MotionEnd::Reached => "reached",
                    MotionEnd::Failed => "failed",
                });
                let answer = agent.call_method1("next", (last, seen))?;
                let intent = intent(&answer, &standing("next"))?;
                let state = state(&agent.call_method0("export")?, &format!("{}.export", given.class))?;
                Ok(AgentReply { intent: Some(intent), state: Some(state) })
            }
            AgentQuestion::Revise => {
                let answer = agent.call_method1("revise", (seen,))?;
                let intent = if answer.is_none() { None } else { Some(intent(&answer, &standing("revise"))?) };
                Ok(AgentReply { intent, state: None })
            }
        }
    }
}

/// The reply of Python code, where an exception is its death, in words.
///
/// # Errors
/// Ctrl-C, exit: what is no `Exception`.
pub(crate) fn reply_of<T>(py: Python<'_>, answer: PyResult<T>) -> PyResult<Result<T, String>> {
    match answer {
        Ok(answer) => Ok(Ok(answer)),
        Err(e) if e.is_instance_of::<PyException>(py) => Ok(Err(in_words(py, &e))),
        Err(e) => Err(e),
    }
}

/// The name of a class, or of an object's class, with its module.
pub(crate) fn class_name(given: &Bound<'_, PyAny>) -> String {
    let class = match given.cast::<PyType>() {
        Ok(class) => class.clone(),
        Err(_) => given.get_type(),
    };
    let module: String = class.getattr("__module__").and_then(|m| m.extract()).unwrap_or_default();
    format!("{module}.{}", class.qualname().map(|n| n.to_string()).unwrap_or_default())
}

/// An exception with its traceback, without addresses in memory, which differ from run to run.
pub(crate) fn in_words(py: Python<'_>, e: &PyErr) -> String {
    let words = || {
        let parts = (e.get_type(py), e.value(py), e.traceback(py));
        let lines: Vec<String> = py.import("traceback")?.call_method1("format_exception", parts)?.extract()?;
        Ok::<_, PyErr>(lines.concat())
    };
    let text = words().unwrap_or_else(|_| format!("{}, which can't be printed", type_name(e.value(py).as_any())));
    let text = without_addresses(text.trim_end());
    let skipped = text.chars().count().saturating_sub(MAX_TRACEBACK);
    text.chars().skip(skipped).collect()
}

/// Replaces the digits of ` at 0x7f2c...`.
fn without_addresses(text: &str) -> String {
    const SIGN: &str = " at 0x";
    let mut pieces = text.split(SIGN);
    let mut plain = pieces.next().unwrap_or_default().to_owned();
    for piece in pieces {
        plain.push_str(" at 0x...");
        plain.push_str(piece.trim_start_matches(|c: char| c.is_ascii_hexdigit()));
    }
    plain
}
