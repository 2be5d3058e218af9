//! A robot's controller in the configuration: the settings that all kinds share, and those of its kind in the same
//! table.

use mobee_contract::{AnyKind, Kind, KindError, kinds};
use mobee_controller::{ControllerSettings, DEFAULT_KIND, Drive, FRESH_PERIODS};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// Maximum period of controllers under forces, milliseconds.
const MAX_FORCE_PERIOD_MS: f64 = 50.0;

/// History, Supervise and Reflex of one robot. Two settings are required; the others have defaults.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
pub struct Controller {
    /// The kind of controller; see `mobee kinds`.
    #[serde(default = "kind")]
    pub kind: String,
    /// Control period, milliseconds.
    pub period_ms: f64,
    /// Number of poses in the history.
    pub history: usize,
    /// The reflex acts when anything gets closer than this, millimeters.
    #[serde(default = "margin")]
    pub margin_mm: f64,
    /// Braking clearance, millimeters. The reflex looks ahead: it acts when the robot's braking path leads closer to
    /// anything than this, so that fast robots stop before they touch. Default: the possible error of the predicted
    /// stop, from the motors' speeds and accelerations, the period and the board's latency; at least 2 mm, at most the
    /// margin. 0: the reflex does not look ahead (the paper's Algorithm 6), and only the margin counts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reserve_mm: Option<f64>,
    /// A motor stalls if it lags its command by more than this, degrees, and by more than twice its lag in free
    /// motions. Something unmodelled is assumed to hold it, and the motion is rolled back as after a contact. Absent:
    /// stalls are not detected.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stall_deg: Option<f64>,
    /// An external torque above this, N m (N for prismatic joints), is a contact with something unmodelled: the motion
    /// is rolled back. Default: the driver's value per motor, if its board reports torque, load or current. 0: not
    /// watched.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contact_nm: Option<f64>,
    /// A pose counts as reached within this, degrees per motor.
    #[serde(default = "tolerance")]
    pub tolerance_deg: f64,
    /// Duration by which a stopped stream of setpoints is rolled back, seconds: the robot retreats to its configuration
    /// of that time before, or farther, until it touches nothing. 0: it stops in front of the obstacle, which
    /// `reserve_mm` makes safe. Moves to a target are rolled back completely.
    #[serde(default = "undo", skip_serializing_if = "is_default")]
    pub undo_s: f64,
    /// A reading older than this, milliseconds, is stale and closes the filter. Default: five control periods. A longer
    /// time tolerates a slow network or a busy machine, but during it a board may continue its last command
    /// unsupervised.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stale_ms: Option<f64>,
    /// The settings of the kind.
    #[serde(flatten)]
    #[schemars(skip)]
    pub own: Map<String, Value>,
}

/// The keys of the settings that all kinds have.
pub(super) const SHARED: &[&str] = &[
    "period_ms",
    "history",
    "margin_mm",
    "reserve_mm",
    "stall_deg",
    "contact_nm",
    "tolerance_deg",
    "undo_s",
    "stale_ms",
];

fn kind() -> String {
    DEFAULT_KIND.into()
}
fn margin() -> f64 {
    10.0
}
fn tolerance() -> f64 {
    0.1
}

fn undo() -> f64 {
    ControllerSettings::default().undo_s
}
/// True for the default, which is not serialized, so that journals record only values that a file sets.
fn is_default(undo_s: &f64) -> bool {
    *undo_s == undo()
}

fn find(name: &str) -> Option<&'static Kind<Drive>> {
    kinds::<Drive>().into_iter().find(|k| k.name == name)
}

/// The settings of a kind and of all controllers, as one schema.
pub fn schema(kind: &dyn AnyKind) -> Value {
    let mut own = kind.schema().to_value();
    let mut all = schemars::schema_for!(Controller).to_value();
    if let (Some(Value::Object(all)), Some(own)) = (all.get_mut("properties"), own["properties"].as_object_mut()) {
        all.remove("kind");
        all.append(own);
    }
    if let Some(own) = own["required"].as_array_mut()
        && let Some(all) = all["required"].as_array_mut()
    {
        all.append(own);
    }
    let definitions = own["$defs"].as_object().cloned().unwrap_or_default();
    (all["$defs"], all["additionalProperties"]) = (Value::Object(definitions), false.into());
    all
}

impl Controller {
    /// Age at which a reading is stale, milliseconds.
    pub fn stale_after_ms(&self) -> f64 {
        self.stale_ms.unwrap_or(self.period_ms * f64::from(FRESH_PERIODS))
    }

    /// The drive of motions that the kind builds.
    ///
    /// # Errors
    /// The first of its settings that can't be used; its path starts at the controller's table.
    pub fn drive(&self) -> Result<Drive, KindError> {
        let unknown = || KindError::new("kind", format!("there is no kind `{}`", self.kind), "see `mobee kinds`");
        let drive = (find(&self.kind).ok_or_else(unknown)?.build)(&Value::Object(self.own.clone()), &())?;
        // forces that act at long intervals make a motion oscillate
        if !drive.is_straight() && self.period_ms > MAX_FORCE_PERIOD_MS {
            let what = format!("{} ms is too long a period for forces", self.period_ms);
            return Err(KindError::new("period_ms", what, format!("give 1 to {MAX_FORCE_PERIOD_MS} ms")));
        }
        Ok(drive)
    }

    /// The settings as the actors' type.
    ///
    /// # Errors
    /// As for [`Controller::drive`].
    pub fn settings(&self) -> Result<ControllerSettings, KindError> {
        Ok(ControllerSettings {
            period_s: self.period_ms * 1e-3,
            history: self.history,
            margin_m: self.margin_mm * 1e-3,
            reserve_m: self.reserve_mm.map(|mm| mm * 1e-3),
            stall_deg: self.stall_deg,
            contact_nm: self.contact_nm,
            tolerance_deg: self.tolerance_deg,
            undo_s: self.undo_s,
            stale_s: self.stale_ms.map(|ms| ms * 1e-3),
            drive: self.drive()?,
            ..ControllerSettings::default()
        })
    }
}
