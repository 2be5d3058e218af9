//! The kinds `python` of agents, drivers, detectors and locators: their settings in a configuration, and the place in which their code is passed. No Python here.

use crate::callback_line::CallbackLine;
use mobee::kinds::PYTHON;
use mobee_contract::{
    Agent, BodyState, Detector, Frame, Hardware, Intent, Kind, KindError, Located, Locator, MotionEnd, Refusal, Region,
    Registered, Sighting, Snapshot, Summary, View, settings,
};
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

/// Parts in Python of the configuration that a thread builds.
#[derive(Clone, Default)]
pub(crate) struct PassedParts {
    /// Robots with an agent.
    pub agents: BTreeSet<String>,
    /// Drivers by robot.
    pub drivers: BTreeMap<String, Arc<CallbackLine>>,
    /// Admits detectors and locators: the session tests afterward that each was passed.
    pub senses: bool,
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

/// A part that is Python code.
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

impl Detector for Stand {
    fn detect(&mut self, _frame: &Frame) -> Vec<Region> {
        Vec::new()
    }

    fn takes(&self) -> Duration {
        Duration::ZERO
    }
}

impl Locator for Stand {
    fn locate(&mut self, _seen: &[Sighting], _body: &BodyState) -> Vec<Located> {
        Vec::new()
    }
}

/// Builds the stand-in of a detector or locator.
fn stand_of_sense(value: &serde_json::Value, argument: &str) -> Result<Box<Stand>, KindError> {
    let PythonSettings { .. } = settings(value)?;
    if PASSED.with(|passed| passed.borrow().senses) {
        return Ok(Box::new(Stand));
    }
    let what = "this is Python code, and only `mobee.run` can pass it";
    Err(KindError::new("kind", what, format!("pass it when the run starts: mobee.run(file, {argument}={{...}})")))
}

inventory::submit! {
    Registered(&Kind::<dyn Detector> {
        name: PYTHON,
        doc: "Python code, which is passed to `mobee.run`.",
        schema: || schemars::schema_for!(PythonSettings),
        example: |_| Err("its code is passed to `mobee.run`"),
        build: |value, _| Ok(stand_of_sense(value, "detectors")?),
    })
}

inventory::submit! {
    Registered(&Kind::<dyn Locator> {
        name: PYTHON,
        doc: "Python code, which is passed to `mobee.run`.",
        schema: || schemars::schema_for!(PythonSettings),
        example: |_| Err("its code is passed to `mobee.run`"),
        build: |value, _| Ok(stand_of_sense(value, "locators")?),
    })
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
