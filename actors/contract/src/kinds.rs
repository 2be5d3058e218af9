//! Context and errors of building a kind; and the hardware that a kind of driver builds. The registry: `registry.rs`.

use crate::{Answer, Driver, DriverFault};
use mobee_model::{Robot, Scene};
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::sync::Arc;
use std::time::Duration;

/// Context in which a kind is built.
#[derive(Clone, Debug)]
pub struct Context {
    /// Robot that it is built for.
    pub robot: Arc<Robot>,
    /// Seed of its own, derived from the run's.
    pub seed: u64,
}

/// Error: a setting that can't be used, with its place, the problem and the remedy.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{what}")]
pub struct KindError {
    /// Path of the setting within the kind's table, such as `poses[3].torso_yaw_deg`; empty for the whole table.
    pub path: String,
    /// Problem.
    pub what: String,
    /// Remedy.
    pub help: String,
    /// Further errors in the same table.
    pub more: Vec<KindError>,
}

impl KindError {
    /// Creates an error at `path`.
    pub fn new(path: impl Into<String>, what: impl Into<String>, help: impl Into<String>) -> KindError {
        KindError { path: path.into(), what: what.into(), help: help.into(), more: Vec::new() }
    }

    /// Moves the error into a table named `prefix`.
    #[must_use]
    pub fn under(mut self, prefix: &str) -> KindError {
        let dot = if self.path.is_empty() || self.path.starts_with('[') { "" } else { "." };
        self.path = format!("{prefix}{dot}{}", self.path);
        self.more = self.more.into_iter().map(|e| e.under(prefix)).collect();
        self
    }

    /// This error and all errors in `more`.
    pub fn all(mut self) -> Vec<KindError> {
        let mut all = vec![];
        let more = std::mem::take(&mut self.more);
        all.push(self);
        all.extend(more.into_iter().flat_map(KindError::all));
        all
    }

    /// Collects all values, or all errors as one.
    ///
    /// # Errors
    /// The first error, with the others in it.
    pub fn gather<T>(results: impl IntoIterator<Item = Result<T, KindError>>) -> Result<Vec<T>, KindError> {
        let mut good: Vec<T> = Vec::new();
        let mut first: Option<KindError> = None;
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

/// Configuration named in settings, so that it can be checked against robots and world before any motion.
#[derive(Clone, Debug, PartialEq)]
pub struct SetPose {
    /// Path of the setting within the kind's table, such as `poses[3]`.
    pub path: String,
    /// Configuration of the whole robot, rad.
    pub q: Vec<f64>,
    /// True if the robot can do without it: if it is in collision, there is only a warning.
    pub optional: bool,
}

/// Properties of hardware that are available before a connection.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Known {
    /// Initial configuration, if the settings define it.
    pub start: Option<SetPose>,
    /// Time between two readings.
    pub period: Option<Duration>,
    /// Motors that have a board; `None`: all.
    pub motors: Option<Vec<usize>>,
}

/// Hardware that outlives its drivers. It creates a driver at the start and after every restart of the driver actor.
pub trait Hardware: Send + Sync {
    /// Creates a new driver for the same board.
    ///
    /// # Errors
    /// [`DriverFault::Lost`] if the board can't be reached now; a later attempt may succeed.
    fn connect(&self) -> Result<Box<dyn Driver>, DriverFault>;

    /// Creates a driver that only reads: it describes its board and provides readings, and sends nothing to the robot
    /// until the next [`Hardware::connect`]. A run looks first, and connects once nothing prevents it. `None`:
    /// connecting sends nothing either.
    fn look(&self) -> Option<Result<Box<dyn Driver>, DriverFault>> {
        None
    }

    /// Returns whether it may run in virtual time: it uses no time but that of its driver's calls, and nothing
    /// outside the run. Other hardware is not connected before the run, either.
    fn runs_in_virtual_time(&self) -> bool {
        false
    }

    /// Receives the scene and the index of its robot, once before the first connection: a simulation with forces
    /// needs the objects.
    ///
    /// # Errors
    /// If a setting does not fit the scene.
    fn place(&self, _scene: &Scene, _robot: usize) -> Result<(), KindError> {
        Ok(())
    }

    /// Releases the board to another driver: from now on nothing may be written to it, not even a stop at the end.
    fn let_go(&self) {}

    /// Properties that are available before a connection: used to check a configuration without accessing a robot.
    fn known(&self) -> Known {
        Known::default()
    }

    /// Receives the original state of the motors, as found by an earlier process that may have died in the middle of
    /// a motion: the board is restored to it at the end. Called before the first connection.
    fn was_found(&self, _found: &[crate::AsFound]) {}

    /// Measured speeds of joints relative to the commanded ones, as far as available: one entry per board.
    fn paces(&self) -> Vec<crate::Paces> {
        Vec::new()
    }

    /// Passes a request through to a part's board, and returns its answer, both in the board's own protocol, so that
    /// a proxy can be transparent. `None`: the board has no protocol of its own. Queries only: only the driver may
    /// change the board's motion.
    fn passthrough(&self, _part: &str, _request: NativeMessage) -> Option<Answer<Result<NativeMessage, DriverFault>>> {
        None
    }

    /// Newest state of a part's board in the board's own protocol, complete, so that a proxy can be transparent.
    /// `None`: the board has no protocol of its own, or has not sent a state yet.
    fn native_state(&self, _part: &str) -> Option<NativeState> {
        None
    }
}

/// Message in the protocol of a board, byte for byte. Opaque to all components but the driver of that board and a
/// bridge with the same protocol.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NativeMessage(pub Vec<u8>);

/// State as sent by a board.
#[derive(Clone, Debug, PartialEq)]
pub struct NativeState {
    /// Number, increasing with every state.
    pub seq: u64,
    /// Stamp of the board, if there is one: its number, and the time by the board's clock, s.
    pub stamp: Option<(u32, f64)>,
    /// The state.
    pub message: NativeMessage,
}

/// Deserializes a kind's settings; an error has the path of the first one that does not fit.
///
/// # Errors
/// A [`KindError`] with the path and the expected value.
pub fn settings<T: DeserializeOwned>(value: &Value) -> Result<T, KindError> {
    serde_path_to_error::deserialize(value).map_err(|e| {
        let path = e.path().to_string();
        let path = if path == "." { String::new() } else { path };
        KindError::new(path, e.inner().to_string(), "see `mobee kinds` for the settings of every kind")
    })
}
