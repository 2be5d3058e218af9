//! A controller's settings, and what they mean for a given board.

mod fields;
mod kinds;

pub use fields::{FieldRules, FieldsSettings};
pub use kinds::{ControllerKind, DEFAULT_KIND, RollbackSettings, controller_kinds};

use mobee_contract::{Axis, Board, Event, Pose};
use mobee_model::{Clause, Robot};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Duration;

/// A robot's controller as its config file sets it: two required settings, the rest has defaults.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Controller {
    /// Control period, seconds: the retreat's set-points are this far apart.
    pub period_s: f64,
    /// Length of the history: how many poses it keeps. A motion that outlasts it moves its safe pose.
    pub history: usize,
    /// Distance below which two shapes count as touching, metres.
    #[serde(default = "margin")]
    pub margin_m: f64,
    /// Greatest distance per motor at which a pose counts as reached, degrees.
    #[serde(default = "tolerance")]
    pub tolerance_deg: f64,
    /// Speed below which a motor counts as at rest, degrees per second.
    #[serde(default = "rest_speed")]
    pub rest_speed_deg: f64,
    /// Greatest share of full speed for an escape from a hold: so slow that it can be stopped within a millimetre.
    #[serde(default = "escape_speed")]
    pub escape_speed: f64,
    /// A stream of set-points that is quiet for so long, seconds, has ended: the robot brakes, and rests where it is.
    #[serde(default = "stream_quiet")]
    pub stream_quiet_s: f64,
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
    /// Drawn and pushed by forces.
    Fields(FieldsSettings),
}

impl Drive {
    /// The name of the kind that drives so.
    pub fn kind(&self) -> &'static str {
        match self {
            Drive::Straight => DEFAULT_KIND,
            Drive::Fields(_) => "fields",
        }
    }

    /// Whether the reflex stops and takes back what comes too near.
    pub fn has_reflex(&self) -> bool {
        match self {
            Drive::Straight => true,
            Drive::Fields(fields) => fields.reflex,
        }
    }
}

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

impl Default for Controller {
    fn default() -> Controller {
        Controller {
            period_s: 0.02,
            history: 3000,
            margin_m: margin(),
            tolerance_deg: tolerance(),
            rest_speed_deg: rest_speed(),
            escape_speed: escape_speed(),
            stream_quiet_s: stream_quiet(),
            stale_s: None,
            drive: Drive::default(),
        }
    }
}

/// What a contact must exceed beyond the margin to end, metres.
pub const RELEASE: f64 = 0.002;
/// What counts as deeper, metres.
pub const DEEPER: f64 = 0.001;
/// How many control periods a reading stays fresh, and a lease lasts, unless the settings say otherwise.
pub const FRESH_PERIODS: u32 = 5;

/// Settings and board in the units of the inside: what the cores go by.
#[derive(Clone, Debug, PartialEq)]
pub struct Rules {
    /// The robot's name, as events carry it.
    pub robot: String,
    /// The names of the body parts.
    pub parts: Vec<String>,
    /// The board's motors.
    pub axes: Arc<[Axis]>,
    /// Control period.
    pub period: Duration,
    /// Greatest age of a reading that is still fresh, and the length of a lease.
    pub fresh: Duration,
    /// Greatest delay from a command to its effect.
    pub latency: Duration,
    /// Whether the board follows set-points directly.
    pub position_direct: bool,
    /// Margin of the reflex, metres.
    pub margin: f64,
    /// Greatest distance per motor at which a pose counts as reached, rad.
    pub tolerance: f64,
    /// Speed below which a motor counts as at rest, rad/s.
    pub rest_speed: f64,
    /// Greatest share of full speed for an escape.
    pub escape_speed: f64,
    /// For how long a stream may be quiet.
    pub stream_quiet: Duration,
    /// The kind of the controller.
    pub kind: &'static str,
    /// Whether the reflex acts. If not, contacts are told and counted, and stop nothing but a way back.
    pub reflex: bool,
    /// Set if motions are driven by forces.
    pub fields: Option<Arc<FieldRules>>,
}

impl Rules {
    /// The rules for a board under these settings.
    pub fn new(robot: &str, parts: Vec<String>, controller: &Controller, board: &Board) -> Rules {
        let period = Duration::from_secs_f64(controller.period_s.clamp(1e-3, 1e3));
        let stale = controller.stale_s.map(|s| Duration::from_secs_f64(s.clamp(1e-3, 1e3)));
        Rules {
            robot: robot.to_string(),
            parts,
            axes: board.axes.clone().into(),
            period,
            fresh: stale.unwrap_or(period * FRESH_PERIODS),
            latency: board.latency,
            position_direct: board.position_direct,
            margin: controller.margin_m,
            tolerance: controller.tolerance_deg.to_radians(),
            rest_speed: controller.rest_speed_deg.to_radians(),
            escape_speed: controller.escape_speed,
            stream_quiet: Duration::from_secs_f64(controller.stream_quiet_s.clamp(1e-2, 1e2)),
            kind: controller.drive.kind(),
            reflex: controller.drive.has_reflex(),
            fields: None,
        }
    }

    /// The same with what drives a robot of this model under forces, if anything does.
    #[must_use]
    pub fn driving(mut self, drive: &Drive, robot: &Robot) -> Rules {
        if let Drive::Fields(settings) = drive {
            self.fields = Some(Arc::new(FieldRules::new(settings, robot, &self)));
        }
        self
    }

    /// The robot of this model as the journal's readers know it.
    pub fn described(&self, robot: &Robot) -> [Event; 2] {
        let constraints = robot.parts.iter().flat_map(|part| &part.clauses);
        let members = |clause: &Clause| clause.0.iter().map(|half| (half.terms.clone(), half.b)).collect();
        let constraints = constraints.map(members).collect();
        let of = |f: fn(&Axis) -> f64| self.axes.iter().map(f).collect();
        let robot = Event::Robot {
            robot: self.robot.clone(),
            motors: self.axes.iter().map(|a| a.name.clone()).collect(),
            min: of(|a| a.min),
            max: of(|a| a.max),
            max_speed: of(|a| a.max_speed),
            period: self.period.as_secs_f64(),
            fresh: self.fresh.as_secs_f64(),
            margin: self.margin,
            tolerance: self.tolerance,
            rest_speed: self.rest_speed,
            constraints,
        };
        let (name, kind) = (self.robot.clone(), self.kind.to_owned());
        [robot, Event::Controller { robot: name, kind, reflex: self.reflex }]
    }

    /// How long after a command its effect is surely in the readings.
    pub fn reaction(&self) -> Duration {
        self.latency + self.period * 2
    }
}

/// The greatest difference of any motor between two poses, rad. Infinite if they don't belong to one robot.
pub fn distance(a: &[f64], b: &[f64]) -> f64 {
    if a.len() != b.len() {
        return f64::INFINITY;
    }
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Readings near a limit may lie beyond it by the noise; commands never do (I5).
pub fn clamped(q: &[f64], rules: &Rules) -> Pose {
    q.iter().zip(rules.axes.iter()).map(|(q, axis)| within(*q, axis)).collect()
}

/// The same of one motor.
pub fn within(q: f64, axis: &Axis) -> f64 {
    q.clamp(axis.min.min(axis.max), axis.max.max(axis.min))
}
