//! A new agent from a configuration file, built and checked before it is offered.

use crate::compose::compose;
use crate::config::Config;
use mobee_actors::shell::{Maker, Offer};
use mobee_actors::swap::Terms;
use mobee_model::Robot;
use serde_json::json;
use std::path::Path;
use std::sync::Arc;

/// Reads and checks a whole file as `mobee check` does, and takes what it has for this robot.
///
/// # Errors
/// Everything that is wrong with it, as it would be printed.
pub(super) fn read(file: &Path, name: &str, model: &Arc<Robot>, fresh: bool, terms: Terms) -> Result<Offer, String> {
    let wrong = |report: miette::Report| format!("{report:?}");
    let (mut config, source) = Config::load(file, &[]).map_err(|e| wrong(e.into()))?;
    // the board that runs is not touched
    for robot in &mut config.robot {
        robot.driver = json!({ "kind": "sim" });
    }
    let mut index = config.robot.iter().position(|r| r.name == name);
    if index.is_none() && config.robot.len() == 1 {
        index = Some(0);
    }
    let Some(index) = index else {
        let names: Vec<&str> = config.robot.iter().map(|r| r.name.as_str()).collect();
        return Err(format!("there is no robot {name} in {}; there are: {}", file.display(), names.join(", ")));
    };
    let kind = config.robot.get(index).and_then(|r| r.agent.as_ref()?.get("kind")?.as_str().map(str::to_owned));
    let mut composition = compose(config, &source).map_err(wrong)?;
    let other = composition.scene.robots().get(index).cloned();
    let motors = |robot: &Robot| robot.motors.iter().map(|m| m.name.clone()).collect::<Vec<String>>();
    if other.is_none_or(|other| motors(&other) != motors(model)) {
        return Err(format!("the robot of {} has other motors than {name}; give a file of this robot", file.display()));
    }
    let setup = composition.robots.swap_remove(index);
    let what = format!("{} from {}", kind.unwrap_or_default(), file.display());
    let maker = setup.agent.ok_or("the robot of this file has no agent; add a table [robot.agent]")?;
    Ok(Offer { maker: Maker(maker), what, fresh, terms })
}
