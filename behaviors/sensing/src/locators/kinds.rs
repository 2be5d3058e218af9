//! The kinds of trained locators, created from a locator file.

use super::file::{LocatorFile, LocatorKind};
use super::head::JOINTS;
use super::learned::{EyeNames, LearnedLocator};
use super::standing::Standing;
use mobee_contract::*;
use mobee_model::Robot;
use mobee_model::file::{MIB, read_text};
use schemars::JsonSchema;
use serde::Deserialize;
use serde_json::{Value, json};
use std::path::PathBuf;

/// Settings of the kinds `triangulate`, `network`, `ensemble` and `calibrated`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LearnedLocatorSettings {
    /// Locator file, as `mobee locator train` wrote it.
    #[schemars(extend("format" = "path"))]
    pub file: PathBuf,
    /// Name of the left camera; default: the camera with a name that ends in `left`.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub left: Option<String>,
    /// Name of the right camera; default: the camera with a name that ends in `right`.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub right: Option<String>,
    /// The nine motors of torso and head, in the order torso pitch, roll and yaw, neck pitch, roll
    /// and yaw, eyes' tilt, version and vergence; default: their names in the supplied iCub.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub motors: Option<[String; 9]>,
    /// Combine the views of an object that rests; default: true.
    #[serde(default = "yes")]
    #[schemars(extend("expert" = true))]
    pub track: bool,
    /// Support plane of the objects, such as a table; default: none.
    #[serde(default)]
    pub stands: Option<Standing>,
}

fn yes() -> bool {
    true
}

/// Looks up the indices of the nine joints in the robot's configuration.
fn joints(robot: &Robot, names: &[&str; 9]) -> Result<[usize; 9], KindError> {
    let mut found = [0; 9];
    for (place, name) in found.iter_mut().zip(names) {
        *place = robot.motor_index(name).ok_or_else(|| {
            let help =
                "name the nine motors of torso and head in `motors`, or give the sensor to a robot that has them";
            KindError::new("motors", format!("{} has no motor {name:?}", robot.name), help)
        })?;
    }
    Ok(found)
}

fn build(value: &Value, robot: &Robot, kind: LocatorKind) -> Result<Box<dyn Locator>, KindError> {
    let settings: LearnedLocatorSettings = settings(value)?;
    let joints = match &settings.motors {
        Some(names) => joints(robot, &names.each_ref().map(String::as_str))?,
        None => joints(robot, &JOINTS)?,
    };
    settings.stands.iter().try_for_each(Standing::check)?;
    if settings.left.is_some() && settings.left == settings.right {
        return Err(KindError::new("right", "the same camera is both eyes", "give two cameras"));
    }
    let at = settings.file.display();
    let text = read_text(&settings.file, 16 * MIB)
        .map_err(|e| KindError::new("file", format!("can't read {at}: {e}"), "give a file of `mobee locator train`"))?;
    let file = LocatorFile::parse(&text).map_err(|e| KindError::new("file", format!("{at}: {}", e.what), e.help))?;
    if file.kind() != kind {
        let help = "name the kind that it was trained as, or train it again with --kind";
        return Err(KindError::new("file", format!("{at} is a locator of the kind {}", file.kind().name()), help));
    }
    let eyes = EyeNames { left: settings.left, right: settings.right };
    Ok(Box::new(LearnedLocator::new(&file, joints, eyes, settings.track).standing(settings.stands)))
}

inventory::submit! {
    Registered(&Kind::<dyn Locator> {
        name: "triangulate",
        doc: "Locates objects by triangulation of the rays of two eyes, with the nominal kinematics of an \
              iCub's head (`mobee locator train --kind triangulate`).",
        schema: || schemars::schema_for!(LearnedLocatorSettings),
        example: |_| Ok(json!({ "file": "drawings.locator.json" })),
        build: |value, context| build(value, &context.robot, LocatorKind::Triangulate),
    })
}

inventory::submit! {
    Registered(&Kind::<dyn Locator> {
        name: "network",
        doc: "Locates objects by networks that were trained on both eyes' pixels and the joint positions, \
              as published with the paper (`mobee locator train --kind network`).",
        schema: || schemars::schema_for!(LearnedLocatorSettings),
        example: |_| Ok(json!({ "file": "learned.locator.json" })),
        build: |value, context| build(value, &context.robot, LocatorKind::Network),
    })
}

inventory::submit! {
    Registered(&Kind::<dyn Locator> {
        name: "ensemble",
        doc: "Locates objects by several networks. Their inputs are pixels, joint positions and the \
              triangulated position (`mobee locator train --kind ensemble`).",
        schema: || schemars::schema_for!(LearnedLocatorSettings),
        example: |_| Ok(json!({ "file": "learned.locator.json" })),
        build: |value, context| build(value, &context.robot, LocatorKind::Ensemble),
    })
}

inventory::submit! {
    Registered(&Kind::<dyn Locator> {
        name: "calibrated",
        doc: "Locates objects by a model of an iCub's head. Its deviations from the nominal kinematics are \
              fitted to training data (`mobee locator train --kind calibrated`).",
        schema: || schemars::schema_for!(LearnedLocatorSettings),
        example: |_| Ok(json!({ "file": "head.locator.json", "left": "left", "right": "right" })),
        build: |value, context| build(value, &context.robot, LocatorKind::Calibrated),
    })
}
