//! The rest pose of a robot in the configuration: the target of the motion when a run ends.

use super::check::Checks;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::BTreeMap;

/// The rest pose of a robot: a name, or a table.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(untagged)]
pub enum RestConfig {
    /// `home`, or the name of a pose of the robot's agent.
    Name(String),
    /// With settings of its own.
    Table(RestTable),
}

/// The rest pose of a robot, and the motion to it.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RestTable {
    /// `home`, the pose of the robot's file, or the name of a pose of the robot's agent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose: Option<String>,
    /// Instead of `pose`: motor positions in degrees, such as `{ elbow = 40 }`; the other motors at home.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub q_deg: Option<BTreeMap<String, f64>>,
    /// Share of each motor's maximum speed, above 0 and up to 1. Default: the agent's `speed`, or 0.1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed: Option<f64>,
    /// Time limit of the motion, seconds of the run's clock.
    #[serde(default = "within_s")]
    pub within_s: f64,
}

fn within_s() -> f64 {
    60.0
}

impl RestConfig {
    /// All of its settings.
    pub fn table(&self) -> RestTable {
        match self {
            RestConfig::Name(name) => {
                RestTable { pose: Some(name.clone()), q_deg: None, speed: None, within_s: within_s() }
            }
            RestConfig::Table(table) => table.clone(),
        }
    }

    pub(super) fn check(&self, at: &str, c: &mut Checks<'_>) {
        let table = self.table();
        if let Some(speed) = table.speed.filter(|speed| !(*speed > 0.0 && *speed <= 1.0)) {
            c.complain(&format!("{at}.speed"), format!("{speed} is out of range"), "give a share above 0 and up to 1");
        }
        c.range(&format!("{at}.within_s"), table.within_s, 0.1, 3600.0, "s");
        if table.pose.is_some() == table.q_deg.is_some() {
            let what =
                if table.pose.is_some() { "a rest pose has two positions" } else { "a rest pose has no position" };
            c.complain(at, what, "give either `pose` or `q_deg`, such as rest = \"home\"");
        }
    }
}

impl JsonSchema for RestConfig {
    fn schema_name() -> Cow<'static, str> {
        "Rest".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let mut schema = RestTable::json_schema(generator);
        schema.insert("type".into(), serde_json::json!(["string", "object"]));
        schema
    }
}
