//! A controller's settings, as its config file has them: the names, units and defaults that a user sees. Changed here,
//! they change the schema, and `docs/configuration.md` with it.

use crate::fields::FieldsSettings;
use crate::kinds::DEFAULT_KIND;
use serde::{Deserialize, Serialize};

/// A robot's controller as its config file sets it: two required settings, the rest has defaults.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ControllerSettings {
    /// Control period, seconds: the retreat's set-points are this far apart.
    pub period_s: f64,
    /// Length of the history: how many poses it keeps. A motion that outlasts it moves its safe pose.
    pub history: usize,
    /// Distance below which two shapes count as touching, meters.
    #[serde(default = "margin")]
    pub margin_m: f64,
    /// Braking clearance, meters: the reflex looks ahead, and this distance must be left when the robot has braked. Without it the
    /// clearance is [`braking_clearance`](crate::look_ahead::braking_clearance); zero: the reflex does not look ahead (the paper's
    /// Algorithm 6).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reserve_m: Option<f64>,
    /// How far a motor may lag behind one that follows half as fast as it was told, degrees, before it counts as held by
    /// something; without it nobody looks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stall_deg: Option<f64>,
    /// The torque from outside from which on something pushes a motor, N m (N where it slides); without it the board's own
    /// ([`Axis::contact_effort`](mobee_contract::Axis::contact_effort)); zero: not watched.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contact_nm: Option<f64>,
    /// Greatest distance per motor at which a pose counts as reached, degrees.
    #[serde(default = "tolerance")]
    pub tolerance_deg: f64,
    /// Speed below which a motor counts as at rest, degrees per second.
    #[serde(default = "rest_speed")]
    pub rest_speed_deg: f64,
    /// Greatest share of full speed for an escape from a hold: so slow that it can be stopped within a millimeter.
    #[serde(default = "escape_speed")]
    pub escape_speed: f64,
    /// A stream of set-points that is quiet for so long, seconds, has ended: the robot brakes, and rests where it is.
    #[serde(default = "stream_quiet")]
    pub stream_quiet_s: f64,
    /// By how much a stream of set-points is undone that is stopped by something, seconds: the robot goes back to where it was
    /// so long before. With 0 it stops where it is, which only a braking clearance makes safe.
    #[serde(default = "undo")]
    pub undo_s: f64,
    /// Age at which a reading is stale, and the length of a lease, seconds; five control periods if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stale_s: Option<f64>,
    /// How motions are driven, by the controller's kind.
    #[serde(default)]
    pub drive: Drive,
}

/// How a controller drives the motions that agents commit.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Drive {
    /// Straight to the target, by the board's own position moves.
    #[default]
    Straight,
    /// The same, and the reflex stops nothing.
    Blind,
    /// Drawn and pushed by forces.
    Fields(FieldsSettings),
}

impl Drive {
    /// The name of the kind that drives so.
    pub fn kind(&self) -> &'static str {
        match self {
            Drive::Straight | Drive::Blind => DEFAULT_KIND,
            Drive::Fields(_) => "fields",
        }
    }

    /// Whether motions go straight to their target in joint space, so that their path is known before they begin.
    pub fn is_straight(&self) -> bool {
        match self {
            Drive::Straight | Drive::Blind => true,
            Drive::Fields(_) => false,
        }
    }

    /// Whether the reflex stops and takes back what comes too near.
    pub fn has_reflex(&self) -> bool {
        match self {
            Drive::Straight => true,
            Drive::Blind => false,
            Drive::Fields(fields) => fields.reflex,
        }
    }
}

/// A centimeter: the hysteresis of contacts (2 mm) and what counts as deeper (1 mm) are small beside it.
fn margin() -> f64 {
    0.010
}
fn tolerance() -> f64 {
    0.1
}
fn rest_speed() -> f64 {
    0.5
}
fn escape_speed() -> f64 {
    0.02
}

fn stream_quiet() -> f64 {
    0.1
}

fn undo() -> f64 {
    0.5
}

impl Default for ControllerSettings {
    fn default() -> ControllerSettings {
        ControllerSettings {
            period_s: 0.02,
            history: 3000,
            margin_m: margin(),
            reserve_m: None,
            stall_deg: None,
            contact_nm: None,
            tolerance_deg: tolerance(),
            rest_speed_deg: rest_speed(),
            escape_speed: escape_speed(),
            stream_quiet_s: stream_quiet(),
            undo_s: undo(),
            stale_s: None,
            drive: Drive::default(),
        }
    }
}
