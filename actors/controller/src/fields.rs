//! The kind `fields`: the force-field controller of the later MoBeE.
//!
//! The settings have the original's names and units (degrees, seconds), so that its configurations can be reused. The
//! law itself is the model's ([`mobee_model::ForceLaw`]); this kind and the command port share it.

use crate::{Drive, Rules};
use mobee_contract::{Kind, KindError, Registered, settings};
use mobee_model::{ForceLaw, JointLaw, Robot};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::time::Duration;

inventory::submit! {
    Registered(&Kind::<Drive> {
        name: "fields",
        doc: "The force-field controller of later versions of MoBeE. A motion is streamed: its target attracts; joint limits, constraints and the fields around \
              the shapes push; the result is damped, limited in position, speed and acceleration, and written once per period. So the robot goes \
              around what is near instead of into it, but not always straight. Where the forces balance elsewhere for `patience_s`, the target counts \
              as missed, and the motion is rolled back. The reflex is the last resort, unless `reflex = false`: then contacts are recorded \
              and counted, but stop nothing.",
        schema: || schemars::schema_for!(FieldsSettings),
        example: |_| Ok(serde_json::json!({})),
        build: |value, ()| {
            let fields: FieldsSettings = settings(value)?;
            fields.check()?;
            Ok(Drive::Fields(fields))
        },
    })
}

/// Settings of the kind `fields`. Forces are accelerations, as in the original; all motors have the same.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FieldsSettings {
    /// True if the reflex stops the robot and retreats when a pair gets closer than the margin. With `false`, only
    /// the forces hold the robot off.
    pub reflex: bool,
    /// Range of the field about each shape, millimeters; for robots whose files define no field shapes.
    pub field_mm: f64,
    /// Stiffness of the attractor near the target, 1/s^2.
    #[schemars(extend("expert" = true))]
    pub spring_const: f64,
    /// Maximum pull of the attractor, deg/s^2.
    #[schemars(extend("expert" = true))]
    pub max_spring_force: f64,
    /// Share of its velocity that a motor always loses, 1/s.
    #[schemars(extend("expert" = true))]
    pub friction: f64,
    /// Additional damping while something pushes, 1/s.
    #[schemars(extend("expert" = true))]
    pub damping_const: f64,
    /// Distance from a limit at which its push begins, deg.
    #[schemars(extend("expert" = true))]
    pub limit_const: f64,
    /// The push at a limit, deg/s^2.
    #[schemars(extend("expert" = true))]
    pub max_limit_force: f64,
    /// Maximum push of the constraints, deg/s^2.
    #[schemars(extend("expert" = true))]
    pub max_constraint_force: f64,
    /// Rate at which a field's push approaches its maximum.
    #[schemars(extend("expert" = true))]
    pub field_const: f64,
    /// Maximum push of the fields, deg/s^2.
    #[schemars(extend("expert" = true))]
    pub max_field_force: f64,
    /// Time for which the robot may rest away from its target before the motion is rolled back, s.
    #[schemars(extend("expert" = true))]
    pub patience_s: f64,
}

impl Default for FieldsSettings {
    fn default() -> FieldsSettings {
        FieldsSettings {
            reflex: true,
            field_mm: 50.0,
            spring_const: 25.0,
            max_spring_force: 250.0,
            friction: 11.0,
            damping_const: 5.0,
            limit_const: 5.0,
            max_limit_force: 600.0,
            max_constraint_force: 600.0,
            field_const: 20.0,
            max_field_force: 1000.0,
            patience_s: 1.0,
        }
    }
}

impl FieldsSettings {
    /// Checks the range of each setting: outside of it, the law would not settle within a period, or not move at all.
    ///
    /// # Errors
    /// The first setting that is out of range, with its range.
    fn check(&self) -> Result<(), KindError> {
        let ranges = [
            ("field_mm", self.field_mm, 0.0, 500.0),
            ("spring_const", self.spring_const, 0.1, 100.0),
            ("max_spring_force", self.max_spring_force, 1.0, 1e5),
            ("friction", self.friction, 0.5, 100.0),
            ("damping_const", self.damping_const, 0.0, 20.0),
            ("limit_const", self.limit_const, 0.0, 90.0),
            ("max_limit_force", self.max_limit_force, 0.0, 1e5),
            ("max_constraint_force", self.max_constraint_force, 0.0, 1e5),
            ("field_const", self.field_const, 0.0, 1e6),
            ("max_field_force", self.max_field_force, 0.0, 1e5),
            ("patience_s", self.patience_s, 0.1, 60.0),
        ];
        match ranges.into_iter().find(|(_, x, low, high)| !(x >= low && x <= high)) {
            Some((name, x, low, high)) => {
                Err(KindError::new(name, format!("{x} is out of range"), format!("give {low} to {high}")))
            }
            None => Ok(()),
        }
    }
}

/// Field settings applied to a robot and board: one force law per body part.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldRules {
    /// Motor range and force law of each part.
    pub laws: Vec<(Range<usize>, ForceLaw)>,
    /// Range of the fields of shapes, meters.
    pub width: f64,
    /// Time for which the robot may rest away from its target.
    pub patience: Duration,
}

impl FieldRules {
    /// Applies the settings to a robot under these rules.
    pub fn new(settings: &FieldsSettings, robot: &Robot, rules: &Rules) -> FieldRules {
        // remaining share of a velocity after one period of friction
        let weight = (-settings.friction * rules.period.as_secs_f64()).exp();
        let joint = |axis: &mobee_contract::Axis| JointLaw {
            weight,
            spring_const: settings.spring_const,
            max_spring_force: settings.max_spring_force,
            damping_const: settings.damping_const,
            limit_const: (settings.limit_const, settings.limit_const),
            max_limit_force: settings.max_limit_force,
            max_constraint_force: settings.max_constraint_force,
            field_const: settings.field_const,
            max_field_force: settings.max_field_force,
            limits: (axis.min.to_degrees(), axis.max.to_degrees()),
            ..JointLaw::default()
        };
        let law = |part: &mobee_model::Part| {
            let axes = rules.axes.get(part.motors.clone()).unwrap_or_default();
            (part.motors.clone(), ForceLaw::new(axes.iter().map(joint).collect(), part, 0.0))
        };
        FieldRules {
            laws: robot.parts.iter().map(law).collect(),
            width: settings.field_mm * 1e-3,
            patience: Duration::from_secs_f64(settings.patience_s.clamp(0.1, 60.0)),
        }
    }
}
