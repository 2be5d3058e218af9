//! The kinds `python` of agents and drivers: their settings in a configuration, and the place in which their code is passed. No Python here.

use crate::callback_line::CallbackLine;
use mobee::kinds::PYTHON;
use mobee_contract::{
    Agent, Hardware, Intent, Kind, KindError, MotionEnd, Refusal, Registered, Snapshot, Summary, View, settings,
};
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Parts in Python of the configuration that a thread builds.
#[derive(Clone, Default)]
pub(crate) struct PassedParts {
    /// Robots with an agent.
    pub agents: BTreeSet<String>,
    /// Drivers by robot.
    pub drivers: BTreeMap<String, Arc<CallbackLine>>,
}

thread_local! {
    static PASSED: RefCell<PassedParts> = RefCell::default();
}

/// Builds a configuration with parts that are passed.
pub(crate) fn with_passed<T>(parts: &PassedParts, build: impl FnOnce() -> T) -> T {
    let before = PASSED.with(|passed| passed.replace(parts.clone()));
    let built = build();
    PASSED.with(|passed| passed.replace(before));
    built
}

/// An agent or a driver that is Python code.
#[derive(serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
struct PythonSettings {
    /// Name of its class, for readers of the journal.
    #[serde(default)]
    #[expect(dead_code, reason = "read in the journal alone")]
    class: String,
}

/// Stands for the code while a configuration is checked.
struct Stand;

impl Agent for Stand {
    fn next(&mut self, _last: Option<MotionEnd>, _view: &View) -> Intent {
        Intent::Done(Summary { text: "no code was passed".into(), figures: Vec::new() })
    }

    fn export(&self) -> Snapshot {
        Snapshot { kind: PYTHON.into(), version: 1, state: serde_json::Value::Null }
    }

    fn import(&mut self, _from: Snapshot) -> Result<(), Refusal> {
        Ok(())
    }
}

inventory::submit! {
    Registered(&Kind::<dyn Agent> {
        name: PYTHON,
        doc: "Python code, which is passed to `mobee.run`.",
        schema: || schemars::schema_for!(PythonSettings),
        example: |_| Err("its code is passed to `mobee.run`"),
        build: |value, context| {
            let PythonSettings { .. } = settings(value)?;
            let name = &context.robot.name;
            if PASSED.with(|passed| passed.borrow().agents.contains(name)) {
                return Ok(Box::new(Stand));
            }
            let what = format!("the agent of {name} is Python code, and none was passed");
            Err(KindError::new("kind", what, format!("pass it: mobee.run(file, agents={{\"{name}\": MyAgent()}})")))
        },
    })
}

inventory::submit! {
    Registered(&Kind::<dyn Hardware> {
        name: PYTHON,
        doc: "Python code, which is passed to `mobee.run`.",
        schema: || schemars::schema_for!(PythonSettings),
        example: |_| Err("its code is passed to `mobee.run`"),
        build: |value, context| {
            let PythonSettings { .. } = settings(value)?;
            let name = &context.robot.name;
            if let Some(line) = PASSED.with(|passed| passed.borrow().drivers.get(name).cloned()) {
                return Ok(Arc::new(line.attach(&context.robot)?));
            }
            let what = format!("the driver of {name} is Python code, and none was passed");
            Err(KindError::new("kind", what, format!("pass it: mobee.run(file, driver={{\"{name}\": MyArm()}})")))
        },
    })
}
