//! The kind `python` of agents: its settings in a configuration, and the place in which its code is passed. No Python here.

use mobee::kinds::PYTHON;
use mobee_contract::{
    Agent, Intent, Kind, KindError, MotionEnd, Refusal, Registered, Snapshot, Summary, View, settings,
};
use std::cell::RefCell;
use std::collections::BTreeSet;

thread_local! {
    /// Robots with an agent in Python, in the configuration that this thread builds.
    static PASSED: RefCell<BTreeSet<String>> = const { RefCell::new(BTreeSet::new()) };
}

/// Builds a configuration in which these robots have agents that are passed.
pub(crate) fn with_passed<T>(robots: &BTreeSet<String>, build: impl FnOnce() -> T) -> T {
    let before = PASSED.with(|passed| passed.replace(robots.clone()));
    let built = build();
    PASSED.with(|passed| passed.replace(before));
    built
}

/// An agent that is Python code.
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
            if PASSED.with(|passed| passed.borrow().contains(name)) {
                return Ok(Box::new(Stand));
            }
            let what = format!("the agent of {name} is Python code, and none was passed");
            Err(KindError::new("kind", what, format!("pass it: mobee.run(file, agents={{\"{name}\": MyAgent()}})")))
        },
    })
}
