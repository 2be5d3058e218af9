//! A robot's measured poses at any time of a run, from its track, which is read once and forward.

use crate::config::ConfigError;
use mobee_actors::record::track::{self, Readings, TrackReading};
use mobee_contract::Time;
use std::path::Path;
use std::time::Duration;

/// Readings that are farther apart say nothing of what was between them: a robot at rest has one a second.
const GAP: Duration = Duration::from_millis(1500);

/// A robot's poses; times must be asked for in order.
pub(super) struct Body {
    readings: Readings,
    before: Option<TrackReading>,
    after: Option<TrackReading>,
}

/// A pose between two readings, and how it moved there.
pub(super) struct Posture {
    /// The motors, rad.
    pub q: Vec<f64>,
    /// The greatest speed of any motor, rad/s.
    pub speed: f64,
}

impl Body {
    /// The poses of a robot with so many motors in a run's folder.
    ///
    /// # Errors
    /// A track that is not there, or another robot's.
    pub fn open(run: &Path, robot: &str, motors: usize) -> Result<Body, ConfigError> {
        let path = track::file(run, robot);
        let help = "give the folder of a run as it was written";
        let readings = track::read(&path).map_err(|what| ConfigError::plain(what, help))?.ok_or_else(|| {
            ConfigError::plain(format!("there are no measured poses of {robot} at {}", path.display()), help)
        })?;
        if readings.motors() != motors {
            let what = format!("{}: of {} motors, and {robot} has {motors}", path.display(), readings.motors());
            return Err(ConfigError::plain(what, help));
        }
        Ok(Body { readings, before: None, after: None })
    }

    /// Where it was at this time; `None` if its readings don't tell.
    pub fn at(&mut self, time: Time) -> Option<Posture> {
        while self.after.as_ref().is_none_or(|after| after.at < time) {
            let next = self.readings.next()?;
            self.before = self.after.replace(next);
        }
        let before = self.before.as_ref()?;
        let after = self.after.as_ref()?;
        let span = after.at.since(before.at);
        let since = time.since(before.at);
        if !after.follows || span > GAP || span.is_zero() || before.q.len() != after.q.len() {
            return None;
        }
        let span = span.as_secs_f64();
        let share = since.as_secs_f64() / span;
        let both = || before.q.iter().zip(after.q.iter());
        let speed = both().map(|(b, a)| (a - b).abs() / span).fold(0.0, f64::max);
        Some(Posture { q: both().map(|(b, a)| b + share * (a - b)).collect(), speed })
    }
}
