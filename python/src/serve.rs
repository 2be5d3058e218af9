//! Agents in Python: the questions of a run put to them, in the thread that started it.

use crate::failure::Failure;
use crate::intent::{AnsweringRobot, intent, state, type_name};
use crate::relay::{AgentQuestion, AgentReply, PendingQuestion};
use crate::view::{PyView, RunRobots};
use mobee_contract::MotionEnd;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString, PyType};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Characters of a traceback in the journal at most: its end, where the exception is.
const MAX_TRACEBACK: usize = 8000;
/// Robots with agents at most.
const MAX_AGENTS: usize = 64;

/// An agent that was passed: an object, or a class or function that makes one for each life.
struct Given {
    given: Py<PyAny>,
    is_maker: bool,
    class: String,
    instance: Option<(u32, Py<PyAny>)>,
}

/// The agents of a run, by robot.
pub(crate) struct PyAgents(BTreeMap<String, Given>);

impl PyAgents {
    /// Reads the argument `agents`.
    ///
    /// # Errors
    /// A value that is not an agent.
    pub fn read(agents: &Bound<'_, PyDict>) -> PyResult<Self> {
        let py = agents.py();
        let base = py.import("mobee._agent")?.getattr("Agent")?;
        let mut all = BTreeMap::new();
        for (name, given) in agents.iter().take(MAX_AGENTS + 1) {
            let wrong = |what: String, remedy: &str| PyErr::from(Failure::new("type", what, remedy).at("agents"));
            let Ok(name) = name.cast::<PyString>() else {
                return Err(wrong(
                    format!("a robot's name is {}", type_name(&name)),
                    "give the names of robots, as str",
                ));
            };
            let name = name.to_string_lossy().into_owned();
            let is_agent = given.is_instance(&base)?;
            let is_maker = !is_agent && given.is_callable();
            if !is_agent && !is_maker {
                let what = format!("the agent of {name} is {}", type_name(&given));
                return Err(wrong(what, "give an object of a class that derives from mobee.Agent, or such a class"));
            }
            let class = class_name(&given);
            all.insert(name, Given { given: given.unbind(), is_maker, class, instance: None });
        }
        if all.len() > MAX_AGENTS {
            return Err(Failure::new("too_many", "too many agents", "give fewer").at("agents").into());
        }
        Ok(Self(all))
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
        let answer = match self.answer(py, robots, question, view, life) {
            Ok(answer) => Ok(answer),
            Err(e) if e.is_instance_of::<PyException>(py) => Err(in_words(py, &e)),
            Err(e) => return Err(e),
        };
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
        let agent = given.of_life(py, life)?;
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

impl Given {
    /// The agent of a life.
    fn of_life<'py>(&mut self, py: Python<'py>, life: u32) -> PyResult<Bound<'py, PyAny>> {
        if let Some((of, instance)) = &self.instance
            && (*of == life || !self.is_maker)
        {
            return Ok(instance.bind(py).clone());
        }
        let made = if self.is_maker { self.given.bind(py).call0()? } else { self.given.bind(py).clone() };
        let base = py.import("mobee._agent")?.getattr("Agent")?;
        if !made.is_instance(&base)? {
            let what = format!("{} made {}, which is no mobee.Agent", self.class, type_name(&made));
            return Err(Failure::new("type", what, "return an object of a class that derives from mobee.Agent").into());
        }
        self.instance = Some((life, made.clone().unbind()));
        Ok(made)
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
