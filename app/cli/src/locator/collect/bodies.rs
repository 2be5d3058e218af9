//! A robot's measured configurations at any time of a run, from its track, which is read once, forward.

use mobee_compose::config::ConfigError;
use mobee_contract::Time;
use mobee_journal::track::{self, Readings, TrackReading};
use std::path::Path;
use std::time::Duration;

/// Maximum gap between readings for an interpolation; a robot at rest has one reading per second.
const MAX_GAP: Duration = Duration::from_millis(1500);

/// A robot's configurations; times must be requested in order.
pub(super) struct TrackInterpolator {
    readings: Readings,
    before: Option<TrackReading>,
    after: Option<TrackReading>,
}

/// A configuration between two readings, and its speed.
pub(super) struct MeasuredConfiguration {
    /// Motor positions, rad.
    pub q: Vec<f64>,
    /// Maximum speed of any motor, rad/s.
    pub speed: f64,
}

impl TrackInterpolator {
    /// Opens the track of a robot with `motors` motors in a run's folder.
    ///
    /// # Errors
    /// If the track is missing, or belongs to another robot.
    pub fn open(run: &Path, robot: &str, motors: usize) -> Result<TrackInterpolator, ConfigError> {
        let path = track::file(run, robot);
        let help = "give the folder of a run as it was written";
        let readings = track::read(&path).map_err(|what| ConfigError::plain(what, help))?.ok_or_else(|| {
            ConfigError::plain(format!("there are no measured poses of {robot} at {}", path.display()), help)
        })?;
        if readings.motors() != motors {
            let what = format!("{}: of {} motors, and {robot} has {motors}", path.display(), readings.motors());
            return Err(ConfigError::plain(what, help));
        }
        Ok(TrackInterpolator { readings, before: None, after: None })
    }

    /// The configuration at this time; `None` if the readings do not cover it.
    pub fn at(&mut self, time: Time) -> Option<MeasuredConfiguration> {
        while self.after.as_ref().is_none_or(|after| after.at < time) {
            let next = self.readings.next()?;
            self.before = self.after.replace(next);
        }
        let before = self.before.as_ref()?;
        let after = self.after.as_ref()?;
        let span = after.at.since(before.at);
        let since = time.since(before.at);
        if !after.follows || span > MAX_GAP || span.is_zero() || before.q.len() != after.q.len() {
            return None;
        }
        let span = span.as_secs_f64();
        let share = since.as_secs_f64() / span;
        let both = || before.q.iter().zip(after.q.iter());
        let speed = both().map(|(b, a)| (a - b).abs() / span).fold(0.0, f64::max);
        Some(MeasuredConfiguration { q: both().map(|(b, a)| b + share * (a - b)).collect(), speed })
    }
}
