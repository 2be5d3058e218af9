//! Controller settings of a config file: the names, units and defaults that a user sees. A change here changes the
//! schema and `docs/configuration.md`.

use crate::fields::FieldsSettings;
use crate::kinds::DEFAULT_KIND;
use serde::{Deserialize, Serialize};

/// Controller settings of one robot, as in its config file. Two settings are required; the others have defaults.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ControllerSettings {
    /// Control period, seconds: the interval between set-points of a retreat.
    pub period_s: f64,
    /// Length of the history, in recorded configurations. If a motion lasts longer than the history, its safe pose
    /// moves.
    pub history: usize,
    /// Distance below which two shapes count as touching, meters.
    #[serde(default = "margin")]
    pub margin_m: f64,
    /// Braking clearance, meters. The reflex looks ahead, and this distance must remain when the robot has braked. By
    /// default the clearance is computed by [`braking_clearance`](crate::look_ahead::braking_clearance). With zero,
    /// the reflex does not look ahead (the paper's Algorithm 6).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reserve_m: Option<f64>,
    /// Lag, degrees, from which a motor counts as stalled: the lag beyond that of a motor that follows at half the
    /// commanded speed. Without it, stalls are not detected.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stall_deg: Option<f64>,
    /// External torque, N m (N for a prismatic joint), from which a motor counts as pushed. By default the board's
    /// own value is used ([`Axis::contact_effort`](mobee_contract::Axis::contact_effort)). With zero, torques are not
    /// watched.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("expert" = true))]
    pub contact_nm: Option<f64>,
    /// Greatest distance per motor at which a configuration counts as reached, degrees.
    #[serde(default = "tolerance")]
    pub tolerance_deg: f64,
    /// Speed below which a motor counts as at rest, degrees per second.
    #[serde(default = "rest_speed")]
    pub rest_speed_deg: f64,
    /// Greatest share of full speed for an escape from a hold: slow enough to stop within a millimeter.
    #[serde(default = "escape_speed")]
    pub escape_speed: f64,
    /// Time without a set-point after which a stream has ended, seconds: the robot brakes and rests where it is.
    #[serde(default = "stream_quiet")]
    pub stream_quiet_s: f64,
    /// Time by which a stream of set-points is undone after a stop, seconds: the robot returns to where it was this
    /// long before. With 0 it stops where it is, which is safe only with a braking clearance.
    #[serde(default = "undo")]
    #[schemars(extend("expert" = true))]
    pub undo_s: f64,
    /// Age at which a reading is stale, and the length of a lease, seconds. The default is five control periods.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stale_s: Option<f64>,
    /// Drive of the motions, by the controller's kind.
    #[serde(default)]
    pub drive: Drive,
}

/// Drive of the motions that agents commit.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Drive {
    /// Straight to the target, by position moves of the board.
    #[default]
    Straight,
    /// Straight to the target, and the reflex does not stop anything.
    Blind,
    /// Attracted by the target and repelled by fields.
    Fields(FieldsSettings),
}

impl Drive {
    /// Name of the controller kind with this drive.
    pub fn kind(&self) -> &'static str {
        match self {
            Drive::Straight | Drive::Blind => DEFAULT_KIND,
            Drive::Fields(_) => "fields",
        }
    }

    /// Returns whether motions go straight to their target in joint space, so that their path is known before they
    /// begin.
    pub fn is_straight(&self) -> bool {
        match self {
            Drive::Straight | Drive::Blind => true,
            Drive::Fields(_) => false,
        }
    }

    /// Returns whether the reflex stops the robot and retreats when a pair gets too close.
    pub fn has_reflex(&self) -> bool {
        match self {
            Drive::Straight => true,
            Drive::Blind => false,
            Drive::Fields(fields) => fields.reflex,
        }
    }
}

/// One centimeter. The hysteresis of contacts (2 mm) and the tolerance for deeper contact (1 mm) are small beside it.
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
