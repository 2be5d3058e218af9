//! Changes to a run from a given time on, as controls of the running system.

use mobee_compose::Composition;
use mobee_compose::config::{ConfigError, differences};
use mobee_contract::Time;
use mobee_model::{Edit, Object, Scene};
use mobee_runtime::swap::SwapPolicy;
use mobee_runtime::system::{Control, NewPart, PartOffer};
use mobee_runtime::wiring::{Maker, SwapRequest};
use serde_json::Value;

/// The controls that change `old` into `new` at the time `at`. The caller applies the script and the time limit.
///
/// # Errors
/// If something differs that can't be changed during a run, or nothing differs.
pub(super) fn changes(old: &Composition, new: &Composition, at: Time) -> Result<Vec<(Time, Control)>, ConfigError> {
    fixed(&values(old), &values(new))?;
    let mut controls: Vec<Control> = world(&old.scene, &new.scene).into_iter().map(Control::Edit).collect();
    let what = "from the replay's settings";
    for (i, (was, is)) in old.config.robot.iter().zip(&new.config.robot).enumerate() {
        if values_of(&was.controller) != values_of(&is.controller)
            && let Some(setup) = new.robots.get(i)
        {
            let part = NewPart::Controller(Box::new(setup.controller.clone()));
            let offer = PartOffer { part, what: what.into(), terms: SwapPolicy::default() };
            let (reply, _) = tokio::sync::oneshot::channel();
            controls.push(Control::SwapPart { robot: was.name.clone(), offer, reply });
        }
        if was.agent == is.agent {
            continue;
        }
        let maker = new.robots.get(i).and_then(|r| r.agent.clone()).filter(|_| was.agent.is_some());
        let Some(maker) = maker else {
            let what = format!("robot {}: an agent can be swapped, but not added or removed", was.name);
            return Err(ConfigError::plain(what, "run the changed file from its beginning"));
        };
        let kind = |agent: &Option<Value>| agent.as_ref().and_then(|a| a.get("kind")).cloned();
        let offer = SwapRequest {
            maker: Maker(maker),
            what: what.into(),
            // an agent of another kind can't use this one's state
            fresh: kind(&was.agent) != kind(&is.agent),
            terms: SwapPolicy::default(),
        };
        let (reply, _) = tokio::sync::oneshot::channel();
        controls.push(Control::SwapAgent { robot: was.name.clone(), offer, reply });
    }
    let same_script = values_of(&old.config.script) == values_of(&new.config.script);
    if controls.is_empty() && same_script && old.config.for_s == new.config.for_s {
        return Err(ConfigError::plain(
            "nothing is changed",
            "change an agent, a controller, the world, the script or `for_s`",
        ));
    }
    Ok(controls.into_iter().map(|control| (at, control)).collect())
}

fn values_of(what: &impl serde::Serialize) -> Value {
    serde_json::to_value(what).unwrap_or_default()
}

/// The configuration without the values that may change.
fn values(composition: &Composition) -> Value {
    let mut value = values_of(&composition.config);
    for key in ["world", "script", "for_s", "record", "name"] {
        value.as_object_mut().and_then(|map| map.remove(key));
    }
    for robot in value["robot"].as_array_mut().into_iter().flatten() {
        for part in ["agent", "controller"] {
            robot.as_object_mut().and_then(|map| map.remove(part));
        }
    }
    value
}

fn fixed(old: &Value, new: &Value) -> Result<(), ConfigError> {
    let Some(key) = differences(old, new).into_iter().next().map(|d| d.key) else { return Ok(()) };
    let help = "agents, controllers, the world, the script and `for_s` can; for anything else run the changed file from its beginning";
    Err(ConfigError::plain(format!("{key} can't change during a run"), help))
}

/// The edits that change one world into the other.
fn world(old: &Scene, new: &Scene) -> Vec<Edit> {
    let remove = |o: &Object| Edit::Remove { name: o.name.clone() };
    let mut edits = Vec::new();
    for (_, was) in old.objects() {
        if new.object(&was.name).is_none() {
            edits.push(remove(was));
        }
    }
    for (_, is) in new.objects() {
        let Some((_, was)) = old.object(&is.name) else {
            edits.push(Edit::Add((**is).clone()));
            continue;
        };
        let changed = Object { pose: is.pose, class: is.class, ..(**was).clone() };
        if changed != **is {
            // another shape: replace the object by one of the same name
            edits.extend([remove(was), Edit::Add((**is).clone())]);
            continue;
        }
        if was.pose != is.pose {
            edits.push(Edit::Move { name: is.name.clone(), pose: is.pose });
        }
        if was.class != is.class {
            edits.push(Edit::Class { name: is.name.clone(), class: is.class });
        }
    }
    edits
}
