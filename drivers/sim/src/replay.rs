//! A recorded run as a robot: its encoders follow a table of configurations, independent of commands.

mod table;

pub use table::PoseTable;

use crate::SimSettings;
use mobee_contract as contract;
use mobee_contract::{
    Axis, Board, Command, Context, ControlMode, Driver, DriverFault, Hardware, Kind, KindError, Known, Registered,
    Sample, SetPose, Time,
};
use mobee_model::file::{MIB, read_text};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// Greatest size of a table, bytes: more than two hours of a humanoid at twenty rows a second.
const MAX_TABLE_BYTES: u64 = 64 * MIB;

inventory::submit! {
    Registered(&Kind::<dyn Hardware> {
        name: "replay",
        doc: "Plays recorded poses as a robot, to show what the model, the reflex or a sensor would have seen. The table comes from `mobee inspect RUN --poses FILE`, \
              or from any encoder log. The robot moves on its own: it answers commands like a board, but does not obey them. Use it without an agent.",
        schema: || schemars::schema_for!(ReplaySettings),
        example: |_| Err("it needs the table of a recorded run"),
        build: |settings, context| Ok(Arc::new(ReplayHardware::build(settings, context)?)),
    })
}

/// Settings of the driver kind `replay`.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReplaySettings {
    /// Table of configurations, relative to the configuration file: columns `t_s` (s of the run, increasing)
    /// and `PART.MOTOR` (degrees). Motors without a column stay at home; between two rows configurations are
    /// interpolated.
    #[schemars(extend("format" = "path"))]
    pub file: PathBuf,
    /// Readings per second.
    #[serde(default = "rate")]
    pub encoder_hz: f64,
}

fn rate() -> f64 {
    100.0
}

/// A recorded robot.
#[derive(Clone, Debug)]
pub struct ReplayHardware {
    table: Arc<PoseTable>,
    board: Board,
}

impl ReplayHardware {
    /// Reads the table of the settings in a config file.
    ///
    /// # Errors
    /// The first setting that can't be used, or the first error in the table, with its line.
    pub fn build(settings: &Value, context: &Context) -> Result<ReplayHardware, KindError> {
        let settings: ReplaySettings = contract::settings(settings)?;
        if !(1.0..=1000.0).contains(&settings.encoder_hz) {
            let what = format!("{} readings per second can't be played", settings.encoder_hz);
            return Err(KindError::new("encoder_hz", what, "give a number from 1 to 1000"));
        }
        let name = settings.file.display();
        let text = read_text(&settings.file, MAX_TABLE_BYTES).map_err(|e| {
            let help =
                "make the table by `mobee inspect RUN --poses FILE`; its path is relative to the configuration file";
            KindError::new("file", format!("{name} can't be read: {e}"), help)
        })?;
        let table = PoseTable::parse(&text, &context.robot)
            .map_err(|(line, what, help)| KindError::new("file", format!("{name}:{line}: {what}"), help))?;
        Ok(ReplayHardware::new(table, SimSettings::ideal().axes(&context.robot), settings.encoder_hz))
    }

    /// Creates a robot with these axes that follows the table, with this number of readings per second: from 1 to
    /// 1000, and 1 instead of NaN.
    pub fn new(table: PoseTable, axes: Vec<Axis>, encoder_hz: f64) -> ReplayHardware {
        let encoder_hz = if encoder_hz.is_nan() { 1.0 } else { encoder_hz.clamp(1.0, 1000.0) };
        let period = Duration::from_secs_f64(1.0 / encoder_hz);
        let board = Board { axes, period, latency: Duration::ZERO, position_direct: true };
        ReplayHardware { table: Arc::new(table), board }
    }
}

impl Hardware for ReplayHardware {
    fn connect(&self) -> Result<Box<dyn Driver>, DriverFault> {
        Ok(Box::new(ReplayDriver { played: self.clone(), given: None }))
    }

    fn runs_in_virtual_time(&self) -> bool {
        true
    }

    fn known(&self) -> Known {
        let start = SetPose { path: "file".into(), q: self.table.at(Time::ZERO), optional: true };
        Known { start: Some(start), period: Some(self.board.period), motors: None }
    }
}

/// Connection to a recorded robot.
#[derive(Debug)]
pub struct ReplayDriver {
    played: ReplayHardware,
    /// Number of the newest reading fetched.
    given: Option<u64>,
}

impl ReplayDriver {
    fn period(&self) -> u64 {
        u64::try_from(self.played.board.period.as_nanos()).unwrap_or(u64::MAX).max(1)
    }
}

impl Driver for ReplayDriver {
    fn board(&self) -> &Board {
        &self.played.board
    }

    fn command(&mut self, _now: Time, _command: &Command) -> Result<(), DriverFault> {
        Ok(())
    }

    fn sample(&mut self, now: Time) -> Result<Option<Sample>, DriverFault> {
        let seq = now.0 / self.period();
        if self.given.is_some_and(|given| seq <= given) {
            return Ok(None);
        }
        self.given = Some(seq);
        let at = Time(seq * self.period());
        let q = self.played.table.at(at);
        let next = self.played.table.at(at + self.played.board.period);
        let done = q.iter().zip(&next).map(|(q, next)| q == next).collect();
        Ok(Some(Sample { seq, at, q: q.into(), done, ..Sample::default() }))
    }

    fn next_sample(&self, now: Time) -> Time {
        let next = self.given.map_or(0, |given| given.saturating_add(1));
        Time(next.saturating_mul(self.period())).max(now)
    }

    fn lease(&mut self, _now: Time, _until: Time) {}

    fn modes(&self) -> Vec<ControlMode> {
        vec![ControlMode::Position; self.played.board.axes.len()]
    }
}

#[cfg(test)]
mod tests;
