//! Time of a run: relative to its beginning, never the time of day.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::{Add, Sub};
use std::time::Duration;

/// Instant: nanoseconds since the run began. Only the clock handle creates instants from the passage of time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Time(pub u64);

impl Time {
    /// Beginning of the run.
    pub const ZERO: Time = Time(0);

    /// Converts seconds since the beginning; negative values and NaN give zero.
    pub fn from_secs(secs: f64) -> Time {
        Time((secs * 1e9).round() as u64)
    }

    /// Seconds since the beginning.
    pub fn secs(self) -> f64 {
        self.0 as f64 * 1e-9
    }

    /// Duration since `earlier`; zero if `earlier` is not before this.
    pub fn since(self, earlier: Time) -> Duration {
        Duration::from_nanos(self.0.saturating_sub(earlier.0))
    }
}

impl Add<Duration> for Time {
    type Output = Time;
    fn add(self, d: Duration) -> Time {
        Time(self.0.saturating_add(u64::try_from(d.as_nanos()).unwrap_or(u64::MAX)))
    }
}

impl Sub<Duration> for Time {
    type Output = Time;
    fn sub(self, d: Duration) -> Time {
        Time(self.0.saturating_sub(u64::try_from(d.as_nanos()).unwrap_or(u64::MAX)))
    }
}

impl fmt::Display for Time {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.3} s", self.secs())
    }
}
