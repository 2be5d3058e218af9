//! What kinds are built from, and what may be wrong with it; and hardware, which a kind of driver builds. The registry: `registry.rs`.

use crate::{Answer, Driver, DriverFault};
use mobee_model::{Robot, Scene};
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::sync::Arc;
use std::time::Duration;

/// What is known when a kind is built.
#[derive(Clone, Debug)]
pub struct Context {
    /// The robot it is for.
    pub robot: Arc<Robot>,
    /// Its own seed, derived from the run's.
    pub seed: u64,
}

/// A setting that can't be used: where, what, and what to do.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{what}")]
pub struct KindError {
    /// The path of the setting within the kind's table, such as `poses[3].torso_yaw_deg`; empty for the whole table.
    pub path: String,
    /// What is wrong.
    pub what: String,
    /// What to do about it.
    pub help: String,
    /// What else is wrong in the same table.
    pub more: Vec<KindError>,
}

impl KindError {
    /// An error at `path`.
    pub fn new(path: impl Into<String>, what: impl Into<String>, help: impl Into<String>) -> KindError {
        KindError { path: path.into(), what: what.into(), help: help.into(), more: Vec::new() }
    }

    /// The same within a table called `prefix`.
    #[must_use]
    pub fn under(mut self, prefix: &str) -> KindError {
        let dot = if self.path.is_empty() || self.path.starts_with('[') { "" } else { "." };
        self.path = format!("{prefix}{dot}{}", self.path);
        self.more = self.more.into_iter().map(|e| e.under(prefix)).collect();
        self
    }

    /// This error and all that came with it.
    pub fn all(mut self) -> Vec<KindError> {
        let mut all = vec![];
        let more = std::mem::take(&mut self.more);
        all.push(self);
        all.extend(more.into_iter().flat_map(KindError::all));
        all
    }

    /// All results, or all errors as one.
    ///
    /// # Errors
    /// The first error, with the others in it.
    pub fn gather<T>(results: impl IntoIterator<Item = Result<T, KindError>>) -> Result<Vec<T>, KindError> {
        let (mut good, mut first): (Vec<T>, Option<KindError>) = (Vec::new(), None);
        for result in results {
            match (result, &mut first) {
                (Ok(value), _) => good.push(value),
                (Err(e), Some(first)) => first.more.push(e),
                (Err(e), None) => first = Some(e),
            }
        }
        first.map_or(Ok(good), Err)
    }
}

/// A pose that settings name, so that it can be checked against robots and world before anything moves.
#[derive(Clone, Debug, PartialEq)]
pub struct SetPose {
    /// The path of the setting within the kind's table, such as `poses[3]`.
    pub path: String,
    /// The whole robot's pose, rad.
    pub q: Vec<f64>,
    /// Whether the robot can do without it: a pose in collision is then only warned about.
    pub optional: bool,
}

/// What is known of hardware before it is connected to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Known {
    /// Where the motors are, if the settings say so.
    pub start: Option<SetPose>,
    /// The time between two readings.
    pub period: Option<Duration>,
    /// The motors that have a board; `None`: all.
    pub motors: Option<Vec<usize>>,
}

/// Hardware that outlives its drivers: asked for a new driver at the start and after every restart of the driver actor.
pub trait Hardware: Send + Sync {
    /// A new driver for the same board.
    ///
    /// # Errors
    /// [`DriverFault::Lost`] if the board can't be reached now; asking again later may help.
    fn connect(&self) -> Result<Box<dyn Driver>, DriverFault>;

    /// A driver that only reads: its board is described, its readings come, and nothing is sent to the robot until the next
    /// [`Hardware::connect`]. A run looks first, and connects once nothing stands against it. `None`: connecting sends nothing
    /// either.
    fn look(&self) -> Option<Result<Box<dyn Driver>, DriverFault>> {
        None
    }

    /// Whether it may run in virtual time: it knows no time but the one that its driver is told, and nothing outside of the run. What
    /// may not is not connected to before the run, either.
    fn runs_in_virtual_time(&self) -> bool {
        false
    }

    /// Where its robot stands, and among which objects, told once before the first connection: a simulation with forces touches them.
    ///
    /// # Errors
    /// A setting that does not fit the scene.
    fn place(&self, _scene: &Scene, _robot: usize) -> Result<(), KindError> {
        Ok(())
    }

    /// Another takes this board's place, and drives it: from now on write nothing to it, not even a stop at the end.
    fn let_go(&self) {}

    /// What is known before a connection: used to check a configuration without touching a robot.
    fn known(&self) -> Known {
        Known::default()
    }

    /// How an earlier process that may have died in the middle of a motion had found the motors: the board is given back so. Told before
    /// the first connection.
    fn was_found(&self, _found: &[crate::AsFound]) {}

    /// How fast joints were by what they were told, as far as that was measured: one entry per board.
    fn paces(&self) -> Vec<crate::Paces> {
        Vec::new()
    }

    /// Passes a request through to a part's board, and its answer back, both in the board's own protocol, so that a proxy
    /// can be transparent. `None`: the board has no protocol of its own. Questions only: whatever changes how the board
    /// moves is the driver's alone.
    fn passthrough(&self, _part: &str, _request: NativeMessage) -> Option<Answer<Result<NativeMessage, DriverFault>>> {
        None
    }

    /// The newest state of a part's board in the board's own protocol, with all that it carries, so that a proxy can be
    /// transparent. `None`: the board has no protocol of its own, or has said nothing yet.
    fn native_state(&self, _part: &str) -> Option<NativeState> {
        None
    }
}

/// A message in the protocol of a board, byte for byte. Opaque to all but the driver of that board and a bridge that speaks the same
/// protocol.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NativeMessage(pub Vec<u8>);

/// A state as a board told it.
#[derive(Clone, Debug, PartialEq)]
pub struct NativeState {
    /// Grows with every state.
    pub seq: u64,
    /// The board's own stamp, if it gives any: its number, and its time by the board's clock, s.
    pub stamp: Option<(u32, f64)>,
    /// The state.
    pub message: NativeMessage,
}

/// Reads a kind's typed settings, with the path of the first one that does not fit.
///
/// # Errors
/// A [`KindError`] that names the path and what was expected there.
pub fn settings<T: DeserializeOwned>(value: &Value) -> Result<T, KindError> {
    serde_path_to_error::deserialize(value).map_err(|e| {
        let path = e.path().to_string();
        let path = if path == "." { String::new() } else { path };
        KindError::new(path, e.inner().to_string(), "see `mobee kinds` for the settings of every kind")
    })
}
