//! History (Algorithm 4): a ring buffer of configurations and the period between them.
//!
//! The retreat follows the recorded path. The paper needs the configurations and their period. Here the ring also
//! marks gaps, across which the path is unknown and must *not* be used, and provides the robot's speed, by which all
//! components detect rest.
//!
//! Times are those at which readings were taken, not those at which they arrived.

mod at;
mod bridge;

pub use at::Unrecorded;
pub use bridge::{BridgedGap, CommandedPath};

use crate::pulse::Pulse;
use mobee_contract::{Axis, MAX_BRIDGED_TIME, Pose, Sample, Time, distance};
use std::collections::VecDeque;
use std::time::Duration;

/// Number of readings in a speed estimate: the means of two halves are compared, which averages encoder noise. At the
/// usual rate they span 70 ms: a longer window would detect rest too late, a shorter one would take noise for motion.
const WINDOW: usize = 8;
/// Usual period of readings, s. At a shorter period the window has proportionally more readings, since the effect of
/// noise depends on its duration.
const USUAL_PERIOD: f64 = 0.01;
/// Greatest factor on the number of readings: beyond 1600 readings per second, noise has more effect again.
const MAX_DENSITY: f64 = 16.0;
/// Greatest number of missing readings, at the usual rate, that is no gap, as after a late thread: the robot cannot
/// go far in that time.
const MAX_MISSING: u64 = 8;
/// Greatest spread of the readings of a motor at rest, in counts of its encoder.
const REST_COUNTS: f64 = 1.5;
/// Longest time, s, over which that spread is evaluated, for any encoder.
const MAX_REST_TIME: f64 = 0.5;

/// Greatest motion of any motor during missing readings, rad, for the path to have no gap there: the retreat between
/// two configurations this close is monitored like any other.
const MAX_BRIDGED_MOTION: f64 = 5.0 * std::f64::consts::PI / 180.0;

/// Recorded configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct Recorded {
    /// Time of the reading.
    pub at: Time,
    /// Positions of the motors, rad.
    pub q: Pose,
    /// Greatest motor speed about then, rad/s; infinite if unknown.
    pub speed: f64,
    /// True if the path from the previous configuration is unknown.
    pub after_gap: bool,
    /// True if the path from the previous configuration was commanded and not measured.
    pub bridged: bool,
    /// True if more than a few readings are missing before this one: no speed is estimated across that.
    after_pause: bool,
}

impl Recorded {
    /// Next configuration on the path, without a gap; rad, rad/s.
    pub fn next(at: Time, q: Pose, speed: f64) -> Recorded {
        Recorded { at, q, speed, after_gap: false, bridged: false, after_pause: false }
    }
}

/// Error: the recording does not reach back that far without a gap.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the history reaches back to {oldest} without a gap, not to {requested}")]
pub struct HistoryTooShort {
    /// Time of the oldest usable configuration.
    pub oldest: Time,
    /// Requested time.
    pub requested: Time,
}

/// Ring buffer. It is part of the ledger, so that it outlives its actor.
#[derive(Clone, Debug)]
pub struct HistoryCore {
    /// Configurations, oldest first.
    ring: VecDeque<Recorded>,
    /// Capacity.
    length: usize,
    /// Estimated period between readings, s; zero before the first estimate.
    period: f64,
    /// Number of the newest reading: missing readings show in the numbers, not in the times.
    seq: u64,
    /// Time of the first of the newest readings that are equal bit for bit.
    unchanged: Time,
    /// True if there is a gap after the newest configuration, whatever the next one is.
    cut: bool,
    /// True if the newest configuration was recorded by an earlier process.
    restored: bool,
    /// Rest detection of each motor with a coarse encoder.
    coarse: Vec<Coarse>,
    /// Recent set-points, to bridge gaps.
    setpoints: bridge::RecentSetpoints,
}

/// Rest detection of a motor whose encoder is too coarse to show rest within the window.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Coarse {
    /// Greatest spread of the readings at rest, rad; zero: the window is used.
    band: f64,
    /// Time over which the spread is evaluated, s: in less time a moving motor might not leave the band.
    secs: f64,
}

impl Coarse {
    /// Returns `None` if the encoder is fine enough for the window.
    fn new(resolution: f64, rest_speed: f64) -> Option<Coarse> {
        let band = REST_COUNTS * resolution;
        let secs = band / rest_speed.max(1e-6);
        (secs > USUAL_PERIOD * WINDOW as f64).then_some(Coarse { band, secs: secs.min(MAX_REST_TIME) })
    }
}

/// Returns whether an encoder of this resolution, rad, is too coarse to show within eight readings that a motor moves
/// at its rest speed, rad/s.
pub fn is_coarse(resolution: f64, rest_speed: f64) -> bool {
    Coarse::new(resolution, rest_speed).is_some()
}

impl HistoryCore {
    /// Creates an empty ring of this capacity (at least a few configurations).
    pub fn new(length: usize) -> HistoryCore {
        let length = length.max(2 * WINDOW);
        HistoryCore {
            ring: VecDeque::with_capacity(length),
            length,
            period: 0.0,
            seq: 0,
            unchanged: Time::ZERO,
            cut: false,
            restored: false,
            coarse: Vec::new(),
            setpoints: bridge::RecentSetpoints::default(),
        }
    }

    /// Sets the encoders for rest detection. Within the window, one count of a coarse encoder looks like several
    /// degrees per second. Such a motor is at rest if its readings stay within a count and a half for the time in
    /// which a motor at `rest_speed`, rad/s, passes them.
    pub fn set_encoders(&mut self, axes: &[Axis], rest_speed: f64) {
        self.coarse = axes.iter().map(|axis| Coarse::new(axis.resolution, rest_speed).unwrap_or_default()).collect();
    }

    /// Records a whole configuration that was commanded at `now`, rad.
    pub fn note_setpoint(&mut self, now: Time, q: Pose) {
        self.setpoints.note(now, q);
    }

    /// Records a pulse's configuration without a commanded path: see [`HistoryCore::record`].
    pub fn push(&mut self, pulse: &mut Pulse, stale: Duration) {
        self.record(pulse, stale, &CommandedPath::Unknown);
    }

    /// Records a pulse's configuration, and sets the pulse's speed. Skips readings that are not newer than the last.
    ///
    /// There is a gap before the reading if the previous reading was stale by then, or if more than a few readings
    /// are missing and the robot has moved on in that time. A gap within [`MAX_BRIDGED_TIME`] is bridged by the
    /// commanded path, if the robot is near it; the pulse then has the bridge.
    pub fn record(&mut self, pulse: &mut Pulse, stale: Duration, commanded: &CommandedPath) {
        let at = pulse.sample.at;
        let q = pulse.sample.q.clone();
        let mut after_gap = true;
        let mut after_pause = true;
        let mut bridge = Vec::new();
        if let Some(last) = self.ring.back() {
            if at <= last.at {
                return;
            }
            let pause = at.since(last.at).as_secs_f64();
            let near = |q: &Pose| distance(q, &last.q) <= MAX_BRIDGED_MOTION;
            let bridged = std::mem::take(&mut self.restored) && near(&q);
            // A restarted driver restarts its numbering: then the number of missing readings is unknown.
            let steps = pulse.sample.seq.checked_sub(self.seq).filter(|n| *n > 0);
            let few = MAX_MISSING * self.density() as u64;
            let late = self.period > 0.0 && pause > few as f64 * self.period;
            after_pause = late || steps.is_none_or(|n| n > few);
            let follows = steps.is_some() && at <= last.at + stale && (!after_pause || near(&q));
            let cut = std::mem::take(&mut self.cut);
            after_gap = !bridged && (cut || !follows || q.len() != last.q.len());
            let missed = steps.is_some() && !cut && at <= last.at + stale.min(MAX_BRIDGED_TIME);
            if after_gap && missed && q.len() == last.q.len() {
                let here = Recorded::next(at, q.clone(), f64::INFINITY);
                bridge = bridge::bridge((last, &here), commanded, &self.setpoints, self.period).unwrap_or_default();
                after_gap = bridge.is_empty();
            }
            pulse.bridged = (!bridge.is_empty()).then_some(BridgedGap { since: last.at, poses: bridge.len() });
            if let Some(steps) = steps.filter(|n| !after_gap && bridge.is_empty() && *n <= few) {
                // The period is a running mean, since the robot's own clock has jitter; after a burst of readings it
                // grows again.
                let pause = pause / steps as f64;
                self.period = if self.period > 0.0 { self.period + 0.05 * (pause - self.period) } else { pause };
            }
            if after_gap || *q != *last.q {
                self.unchanged = at;
            }
        } else {
            self.unchanged = at;
        }
        self.seq = pulse.sample.seq;
        self.setpoints.forget(at);
        let bridged = pulse.bridged.is_some();
        let reading = Recorded { at, q, speed: f64::INFINITY, after_gap, bridged, after_pause };
        for recorded in bridge.into_iter().chain([reading]) {
            if self.ring.len() == self.length {
                self.ring.pop_front();
            }
            self.ring.push_back(recorded);
        }
        pulse.speed = self.speed();
        pulse.unchanged = self.unchanged;
        if let Some(last) = self.ring.back_mut() {
            last.speed = pulse.speed;
        }
    }

    /// Sets the capacity (at least a few configurations); the newest ones stay.
    pub fn resize(&mut self, length: usize) {
        self.length = length.max(2 * WINDOW);
        self.ring.drain(..self.ring.len().saturating_sub(self.length));
    }

    /// Loads the recording of an earlier process, oldest first. The next reading continues the path if it is near its
    /// end, since a robot brakes when its program dies.
    pub fn restore(&mut self, poses: &[(Time, Pose)]) {
        for (k, (at, q)) in (1..).zip(poses) {
            let sample = Sample { seq: k, at: *at, q: q.clone(), done: vec![true; q.len()], ..Sample::default() };
            self.push(&mut Pulse::new(sample, &Vec::new().into()), Duration::MAX);
        }
        self.restored = !self.ring.is_empty();
    }

    /// Returns the recorded configuration nearest to `q` among those about the time `at`: the one that a safe pose
    /// was taken from.
    pub fn recorded_near(&self, at: Time, q: &[f64], within: Duration) -> Option<&Recorded> {
        let about = self.ring.iter().filter(|r| r.at <= at + within && at <= r.at + within);
        about.min_by(|a, b| distance(&a.q, q).total_cmp(&distance(&b.q, q)))
    }

    /// Marks a gap here, as after a restart or a pause: no retreat crosses it.
    pub fn mark_gap(&mut self) {
        self.cut = true;
    }

    /// Estimated period between configurations, seconds (Algorithm 4); zero before the first estimate.
    pub fn period(&self) -> f64 {
        self.period
    }

    /// Newest recorded configuration.
    pub fn newest(&self) -> Option<&Recorded> {
        self.ring.back()
    }

    /// Returns the recording since the last gap, oldest first, and the index of the configuration at `since`.
    ///
    /// # Errors
    /// If that configuration has left the ring, or there is a gap after it.
    pub fn past(&self, since: Time) -> Result<(Vec<Recorded>, usize), HistoryTooShort> {
        let start = self.ring.partition_point(|r| r.at < since);
        // The gap is before the marked configuration; a retreat to that configuration is possible.
        let usable = self.ring.iter().rposition(|r| r.after_gap).unwrap_or(0);
        let oldest = self.ring.get(usable).map_or(Time::ZERO, |r| r.at);
        match (self.ring.get(start), start.checked_sub(usable)) {
            (Some(r), Some(start)) if r.at == since => Ok((self.ring.range(usable..).cloned().collect(), start)),
            _ => Err(HistoryTooShort { oldest, requested: since }),
        }
    }

    /// Returns a later beginning if the configuration at `since` is about to leave the full ring: one that will stay
    /// for a while, a tenth of the ring after the oldest. Early, since this is called at each reading, and readings
    /// may be missing.
    pub fn later_start(&self, since: Time) -> Option<&Recorded> {
        let brink = self.ring.get(self.length / 50 + 1)?;
        (self.ring.len() == self.length && since <= brink.at).then(|| self.ring.get(self.length / 10 + 2)).flatten()
    }

    /// Greatest motor speed over the window, rad/s: by the means of its halves, and by the means of each half's own
    /// halves, so that a motor that reverses is not at rest. The latter are three times as noisy, and are weighted by
    /// two thirds. A ring shorter than the window bounds it: otherwise no speed would ever be known.
    fn speed(&self) -> f64 {
        let window = WINDOW * self.density().min(self.length / WINDOW);
        let half = window / 2;
        let Some(start) = self.ring.len().checked_sub(window) else { return f64::INFINITY };
        if self.ring.range(start + 1..).any(|r| r.after_gap || r.after_pause) {
            return f64::INFINITY;
        }
        let (Some(first), Some(last)) = (self.ring.get(start), self.ring.back()) else { return f64::INFINITY };
        let secs = last.at.since(first.at).as_secs_f64() * half as f64 / (window - 1) as f64;
        let sum = |range: std::ops::Range<usize>, motor: usize| -> f64 {
            self.ring.range(range).filter_map(|r| r.q.get(motor)).sum()
        };
        // Usually nothing has moved in the whole window: no sums are needed.
        if self.unchanged <= first.at {
            return 0.0;
        }
        let way = |from: usize, n: usize, m: usize| {
            (sum(from..from + n, m) - sum(from + n..from + 2 * n, m)).abs() / n as f64
        };
        let motors = (0..last.q.len()).filter(|m| !self.rests(*m, last.at));
        let turn = |m: usize| way(start, half / 2, m).max(way(start + half, half / 2, m));
        motors.map(|m| way(start, half, m).max(turn(m) * 2.0 / 3.0)).fold(0.0, f64::max) / secs
    }

    /// Returns whether a motor with a coarse encoder is at rest; false for other motors, to which the window applies.
    fn rests(&self, motor: usize, now: Time) -> bool {
        let Some(Coarse { band, secs }) = self.coarse.get(motor).copied().filter(|coarse| coarse.band > 0.0) else {
            return false;
        };
        let since = Duration::from_secs_f64(secs);
        let mut low = f64::INFINITY;
        let mut high = f64::NEG_INFINITY;
        for r in self.ring.iter().rev() {
            let q = r.q.get(motor).copied().unwrap_or(f64::NAN);
            low = low.min(q);
            high = high.max(q);
            if high - low > band {
                return false;
            }
            if r.at + since <= now {
                return true;
            }
            if r.after_gap || r.after_pause {
                return false;
            }
        }
        false
    }

    /// Number of readings in the time of a usual one: a board with a thousand readings per second has ten times as
    /// many in its window, since the speed would otherwise be mostly noise.
    fn density(&self) -> usize {
        if self.period > 0.0 { (USUAL_PERIOD / self.period).round().clamp(1.0, MAX_DENSITY) as usize } else { 1 }
    }

    /// Time span of the ring, with or without gaps.
    pub fn span(&self) -> Duration {
        match (self.ring.front(), self.ring.back()) {
            (Some(a), Some(b)) => b.at.since(a.at),
            _ => Duration::ZERO,
        }
    }
}

#[cfg(test)]
mod tests;
