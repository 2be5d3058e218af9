//! Rules for pairs, as settings and arguments have them: pairs that may touch, and pairs with a clearance of their own.

use mobee_contract::KindError;
use mobee_model::{PairRule, Scene, SceneError};
use serde_json::Value;
use std::collections::BTreeMap;

/// Maximum clearance of a pair, mm.
const MAX_CLEARANCE_MM: f64 = 1000.0;
/// Settings of an agent with rules for pairs.
const MAY_TOUCH: &str = "may_touch";
const PAIR_CLEARANCE: &str = "pair_clearance_mm";

/// Converts the settings to rules.
///
/// # Arguments
/// * `may_touch`: pairs `A:B` that may touch.
/// * `clearances_mm`: pairs `A:B` with a clearance of their own, mm.
///
/// # Errors
/// A pair that is not two names, and a clearance out of bounds, each with its path.
pub fn pair_rules(may_touch: &[String], clearances_mm: &BTreeMap<String, f64>) -> Result<Vec<PairRule>, KindError> {
    let pair = |path: String, names: &str, rule: Option<PairRule>| {
        let what = format!("{names:?} is not a pair");
        let help = "give two names of links, parts, markers or objects, such as \"gripper:cup\"";
        rule.ok_or_else(|| KindError::new(path, what, help))
    };
    let touching = may_touch.iter().enumerate();
    let touching = touching.map(|(i, names)| pair(format!("{MAY_TOUCH}[{i}]"), names, PairRule::may_touch(names)));
    let near = clearances_mm.iter().map(|(names, mm)| {
        let path = format!("{PAIR_CLEARANCE}.{names}");
        if !(0.0..=MAX_CLEARANCE_MM).contains(mm) {
            let help = format!("give mm from 0 to {MAX_CLEARANCE_MM}; `{MAY_TOUCH}` is for pairs that may touch");
            return Err(KindError::new(path, format!("{mm} is out of bounds"), help));
        }
        pair(path, names, PairRule::near(names, mm / 1e3))
    });
    KindError::gather(touching.chain(near))
}

/// Applies the rules of an agent's settings to a scene; `None` if there are none.
///
/// # Errors
/// As [`pair_rules`], and names that do not exist, with the known ones.
pub(crate) fn ruled_scene(agent: &Value, scene: &Scene, robot: usize) -> Result<Option<Scene>, KindError> {
    fn read<T: Default + serde::de::DeserializeOwned>(agent: &Value, key: &str) -> Result<T, KindError> {
        match agent.get(key).filter(|value| !value.is_null()) {
            Some(value) => mobee_contract::settings(value).map_err(|e: KindError| e.under(key)),
            None => Ok(T::default()),
        }
    }
    let rules = pair_rules(&read::<Vec<String>>(agent, MAY_TOUCH)?, &read(agent, PAIR_CLEARANCE)?)?;
    if rules.is_empty() {
        return Ok(None);
    }
    scene.with_pair_rules(robot, &rules).map(Some).map_err(|e| rule_error(&e))
}

/// Describes a rule that a scene refuses.
pub fn rule_error(error: &SceneError) -> KindError {
    match error {
        SceneError::PairRule { what, help } => KindError::new("", what.clone(), help.clone()),
        other => KindError::new("", other.to_string(), "correct the pair"),
    }
}
