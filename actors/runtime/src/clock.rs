//! The clock handle, the only source of time.
//!
//! A virtual clock is tokio's paused clock on one thread: when every task waits, it jumps to the next timer.
//! Hours of simulated time pass in seconds, and two runs with the same seed are equal message by message. A
//! real clock is the monotonic clock of the machine. Both return [`Time`] since the handle was created.

use mobee_contract::Time;
use rustix::time::{ClockId, clock_gettime};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::time::{Duration, SystemTime};
use tokio::runtime::{Builder, Runtime};
use tokio::time::Instant;

/// Kind of a run's clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum ClockKind {
    /// As fast as the computation allows, and the same in every run.
    #[default]
    Virtual,
    /// In real time.
    Real,
}

impl fmt::Display for ClockKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ClockKind::Virtual => "virtual",
            ClockKind::Real => "real",
        })
    }
}

/// Creates a single-threaded runtime whose time passes as `kind` defines.
///
/// # Errors
/// If the operating system gives no timer or poller.
pub fn runtime(kind: ClockKind) -> std::io::Result<Runtime> {
    Builder::new_current_thread().enable_all().start_paused(kind == ClockKind::Virtual).build()
}

/// Processor time of this thread so far.
pub(crate) fn processor_time() -> Duration {
    spent(ClockId::ThreadCPUTime)
}

/// Processor time of the whole process so far.
pub fn processor_time_of_all() -> Duration {
    spent(ClockId::ProcessCPUTime)
}

fn spent(clock: ClockId) -> Duration {
    let time = clock_gettime(clock);
    Duration::new(u64::try_from(time.tv_sec).unwrap_or(0), u32::try_from(time.tv_nsec).unwrap_or(0))
}

/// Measures the time since the start of the run, and sleeps. Cheap to clone.
///
/// Use it inside the runtime in which it was created: a virtual clock does not advance outside.
#[derive(Clone, Debug)]
pub struct Clock {
    kind: ClockKind,
    start: Instant,
    begun: Time,
}

impl Clock {
    /// Creates a clock that starts at [`Time::ZERO`] now. Call it inside the runtime.
    pub fn new(kind: ClockKind) -> Clock {
        Clock::from(kind, Time::ZERO)
    }

    /// Creates a clock that starts at `begun` now, for a run that is resumed.
    #[allow(clippy::disallowed_methods)]
    pub fn from(kind: ClockKind, begun: Time) -> Clock {
        Clock { kind, start: Instant::now(), begun }
    }

    /// Kind of the clock.
    pub fn kind(&self) -> ClockKind {
        self.kind
    }

    /// Time since the start of the run.
    #[allow(clippy::disallowed_methods)]
    pub fn now(&self) -> Time {
        self.begun + Instant::now().duration_since(self.start)
    }

    /// Time of day at which this clock shows `at`, seconds since 1970, by the machine's present clock setting.
    /// A virtual clock returns its own time.
    #[allow(clippy::disallowed_methods)]
    pub fn time_of_day(&self, at: Time) -> f64 {
        if self.kind == ClockKind::Virtual {
            return at.secs();
        }
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default().as_secs_f64();
        now - (self.now().secs() - at.secs())
    }

    /// Sleeps until `at`; returns immediately if that is past. The resolution is that of tokio's timers: one
    /// millisecond.
    pub async fn sleep_until(&self, at: Time) {
        tokio::time::sleep_until(self.start + at.since(self.begun)).await;
    }

    /// Advances a virtual clock without running any task, as while a process is suspended. No-op for a real
    /// clock.
    pub async fn suspend(&self, time: Duration) {
        if self.kind == ClockKind::Virtual {
            tokio::time::advance(time).await;
        }
    }

    /// Sleeps for a duration.
    pub async fn sleep(&self, time: Duration) {
        tokio::time::sleep(time).await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn virtual_hours_pass_at_once_and_exactly() {
        let now = runtime(ClockKind::Virtual).unwrap().block_on(async {
            let clock = Clock::new(ClockKind::Virtual);
            for k in 1..=5400_u64 {
                clock.sleep_until(Time(k * 1_000_000_000)).await;
                assert_eq!(clock.now(), Time(k * 1_000_000_000));
            }
            clock.now()
        });
        assert_eq!(now, Time(5_400_000_000_000));
    }

    #[test]
    fn the_time_of_day_goes_with_the_clock() {
        let shown = |kind| {
            runtime(kind).unwrap().block_on(async {
                let clock = Clock::from(kind, Time::from_secs(50.0));
                [50.0, 51.5].map(|at| clock.time_of_day(Time::from_secs(at)))
            })
        };
        assert_eq!(shown(ClockKind::Virtual), [50.0, 51.5]);
        let [first, second] = shown(ClockKind::Real);
        assert!((second - first - 1.5).abs() < 0.5 && first > 1.7e9, "{first} {second}");
    }

    #[test]
    fn a_past_time_is_not_waited_for() {
        runtime(ClockKind::Virtual).unwrap().block_on(async {
            let clock = Clock::new(ClockKind::Virtual);
            clock.sleep(Duration::from_secs(3)).await;
            clock.sleep_until(Time(1)).await;
            assert_eq!(clock.now(), Time(3_000_000_000));
        });
    }

    #[test]
    fn a_real_clock_does_not_run_backwards() {
        runtime(ClockKind::Real).unwrap().block_on(async {
            let clock = Clock::new(ClockKind::Real);
            let before = clock.now();
            clock.sleep(Duration::from_millis(2)).await;
            assert!(clock.now() >= before + Duration::from_millis(2));
        });
    }
}
