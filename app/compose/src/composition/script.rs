//! The script: steps of a configuration as edits of the scene, each tried on it first.

use crate::config::{Complaints, Config, EditStep, Source, StepConfig, StepTrigger, suggestion};
use mobee_contract::Time;
use mobee_model::{Edit, Scene};
use mobee_runtime::system::ScriptStep;
use nalgebra::{Isometry3, Translation3};

/// All steps; reports those that are not possible.
pub(super) fn steps(config: &Config, source: &Source, scene: &Scene, wrong: &mut Complaints) -> Vec<ScriptStep> {
    let names: Vec<&str> = scene.objects().map(|(_, o)| o.name.as_str()).collect();
    let mut steps = Vec::new();
    for (i, s) in config.script.iter().enumerate() {
        let EditStep { object, class, position_m, remove } = &s.edit;
        let at = format!("script[{i}].edit");
        let Some((_, found)) = scene.object(object) else {
            let what = format!("there is no object `{object}` in the world");
            wrong.push(source.error(&format!("{at}.object"), what, suggestion(object, "object", &names)));
            continue;
        };
        let mut edits = Vec::new();
        if let Some([x, y, z]) = position_m {
            let pose = Isometry3::from_parts(Translation3::new(*x, *y, *z), found.pose.rotation);
            edits.push(Edit::Move { name: object.clone(), pose });
        }
        if let Some(class) = class {
            edits.push(Edit::Class { name: object.clone(), class: *class });
        }
        if *remove {
            edits.push(Edit::Remove { name: object.clone() });
        }
        if let Some(Err(e)) = edits.iter().map(|e| scene.edit(e)).find(Result::is_err) {
            wrong.push(source.error(&at, e.to_string(), "change the step, or the object in the world's file"));
        }
        let when = when(s);
        steps.extend(edits.into_iter().map(|edit| ScriptStep { when: when.clone(), edit }));
    }
    steps
}

fn when(step: &StepConfig) -> mobee_runtime::system::CueTrigger {
    match &step.when {
        StepTrigger::AtS(t) => mobee_runtime::system::CueTrigger::At(Time::from_secs(*t)),
        StepTrigger::AfterOutcomes { robot, count } => {
            mobee_runtime::system::CueTrigger::AfterOutcomes { robot: robot.clone(), n: *count }
        }
    }
}
