//! History (Algorithm 4): a ring buffer of poses and the period between them.
//!
//! What the retreat goes back along. The paper needs the poses and their period; here the ring also says where it must
//! *not* be used (gaps, where nobody knows how the robot came from one pose to the next), and how fast the robot moves,
//! by which everybody judges rest.
//!
//! Times are those at which readings were taken, never when they came here.

mod at;

pub use at::Unrecorded;

use crate::distance;
use crate::pulse::Pulse;
use mobee_contract::{Axis, Pose, Sample, Time};
use std::collections::VecDeque;
use std::time::Duration;

/// How many readings the speed is estimated from: the means of two halves, so that encoder noise hardly counts. At the
/// usual rate they span 70 ms: a longer window would tell of rest too late, a shorter one would take noise for motion.
const WINDOW: usize = 8;
/// Of a board that tells more than one in so many seconds, so many times as many: noise counts by the time that it is
/// divided by.
const USUAL: f64 = 0.01;
/// At most so many times as many: beyond a rate of 1600 a second noise counts more again.
const FASTEST: f64 = 16.0;
/// So many readings may be missing, as they are when a thread comes late, without a gap: a robot can't go far
/// meanwhile.
const FEW: u64 = 8;
/// A motor whose readings differ by so many counts of its encoder stands.
const COUNTS: f64 = 1.5;
/// It is looked at for no longer than this, s, whatever its encoder shows.
const LONGEST: f64 = 0.5;

/// How far (rad, every motor) a robot may have gone on while nobody recorded it, for the path to have no gap there: the
/// way back between two poses so near each other is watched like any other.
const BRIDGE: f64 = 5.0 * std::f64::consts::PI / 180.0;

/// A recorded pose.
#[derive(Clone, Debug, PartialEq)]
pub struct Recorded {
    /// When it was read.
    pub at: Time,
    /// Where the motors were, rad.
    pub q: Pose,
    /// Greatest motor speed about then, rad/s; infinite if not known.
    pub speed: f64,
    /// Whether nobody knows how the robot came here from the pose before.
    pub after_gap: bool,
    /// Whether more than a few readings are missing before it: no speed is told across that.
    after_pause: bool,
}

impl Recorded {
    /// A pose that comes next on the way, without a gap; rad, rad/s.
    pub fn next(at: Time, q: Pose, speed: f64) -> Recorded {
        Recorded { at, q, speed, after_gap: false, after_pause: false }
    }
}

/// The recorded poses do not reach back that far without a gap.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the history reaches back to {oldest} without a gap, not to {asked}")]
pub struct HistoryTooShort {
    /// The oldest usable pose's time.
    pub oldest: Time,
    /// The time asked for.
    pub asked: Time,
}

/// The ring buffer. Lives in the ledger, so that it outlives its actor.
#[derive(Clone, Debug)]
pub struct HistoryCore {
    /// The poses, oldest first.
    ring: VecDeque<Recorded>,
    /// How many it holds.
    length: usize,
    /// The estimated period between readings, s; zero before there is one.
    period: f64,
    /// The number of the newest reading: what is missing between two shows in it, and not in their times.
    seq: u64,
    /// When the first was taken of the newest readings that are equal bit for bit.
    unchanged: Time,
    /// Set if readings are missing after the newest pose, whatever the next one is.
    cut: bool,
    /// Set while the newest pose was recorded by an earlier process.
    restored: bool,
    /// Per motor with a coarse encoder how rest is judged.
    coarse: Vec<Coarse>,
}

/// A motor whose encoder is too coarse to show within the window whether it rests.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Coarse {
    /// It stands while its readings differ by no more, rad; zero: it is judged by the window.
    band: f64,
    /// For so long, s: in less time a motor that counts as moving might not leave the band.
    secs: f64,
}

impl Coarse {
    /// `None`: the encoder is fine enough for the window.
    fn new(resolution: f64, rest_speed: f64) -> Option<Coarse> {
        let band = COUNTS * resolution;
        let secs = band / rest_speed.max(1e-6);
        (secs > USUAL * WINDOW as f64).then_some(Coarse { band, secs: secs.min(LONGEST) })
    }
}

/// Whether an encoder of this resolution, rad, is too coarse to show within eight readings whether a motor moves at its rest speed, rad/s.
pub fn is_coarse(resolution: f64, rest_speed: f64) -> bool {
    Coarse::new(resolution, rest_speed).is_some()
}

impl HistoryCore {
    /// An empty ring of this length (at least a few poses).
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
        }
    }

    /// Judges rest by these encoders from now on. Within the window a count of a coarse encoder looks like several degrees a second: such a
    /// motor stands if its readings stay within a count and a half for as long as one that moves at `rest_speed`, rad/s, takes to pass them.
    pub fn set_encoders(&mut self, axes: &[Axis], rest_speed: f64) {
        self.coarse = axes.iter().map(|axis| Coarse::new(axis.resolution, rest_speed).unwrap_or_default()).collect();
    }

    /// Records a pulse's pose and tells it the speed. Readings that are not newer than the last are passed over.
    ///
    /// There is a gap before it if it comes so late that the reading before was stale, or if more than a few readings
    /// are missing and the robot has gone on meanwhile.
    pub fn push(&mut self, pulse: &mut Pulse, stale: Duration) {
        let (at, q) = (pulse.sample.at, pulse.sample.q.clone());
        let (mut after_gap, mut after_pause) = (true, true);
        if let Some(last) = self.ring.back() {
            if at <= last.at {
                return;
            }
            let pause = at.since(last.at).as_secs_f64();
            let near = |q: &Pose| distance(q, &last.q) <= BRIDGE;
            let bridged = std::mem::take(&mut self.restored) && near(&q);
            // a driver that was restarted counts anew: then nobody knows what is missing
            let steps = pulse.sample.seq.checked_sub(self.seq).filter(|n| *n > 0);
            let few = FEW * self.crowd() as u64;
            let late = self.period > 0.0 && pause > few as f64 * self.period;
            after_pause = late || steps.is_none_or(|n| n > few);
            let follows = steps.is_some() && at <= last.at + stale && (!after_pause || near(&q));
            let cut = std::mem::take(&mut self.cut);
            after_gap = !bridged && (cut || !follows || q.len() != last.q.len());
            if let Some(steps) = steps.filter(|n| !after_gap && *n <= few) {
                // the estimated period: a running mean, as the robot's own clock has jitter; after a bunch of readings
                // it grows again
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
        if self.ring.len() == self.length {
            self.ring.pop_front();
        }
        self.ring.push_back(Recorded { at, q, speed: f64::INFINITY, after_gap, after_pause });
        pulse.speed = self.speed();
        pulse.unchanged = self.unchanged;
        if let Some(last) = self.ring.back_mut() {
            last.speed = pulse.speed;
        }
    }

    /// Holds this many poses from now on (at least a few), the newest of those recorded among them.
    pub fn resize(&mut self, length: usize) {
        self.length = length.max(2 * WINDOW);
        self.ring.drain(..self.ring.len().saturating_sub(self.length));
    }

    /// Takes up what an earlier process recorded, oldest first. The next reading continues the path if it is near its
    /// end: a robot brakes when its program dies.
    pub fn restore(&mut self, poses: &[(Time, Pose)]) {
        for (k, (at, q)) in (1..).zip(poses) {
            let sample = Sample { seq: k, at: *at, q: q.clone(), done: vec![true; q.len()], ..Sample::default() };
            self.push(&mut Pulse::new(sample, &Vec::new().into()), Duration::MAX);
        }
        self.restored = !self.ring.is_empty();
    }

    /// The recorded pose nearest to `q` of those about the time `at`: what a safe pose was taken from.
    pub fn recorded_near(&self, at: Time, q: &[f64], within: Duration) -> Option<&Recorded> {
        let about = self.ring.iter().filter(|r| r.at <= at + within && at <= r.at + within);
        about.min_by(|a, b| distance(&a.q, q).total_cmp(&distance(&b.q, q)))
    }

    /// Marks that readings are missing here, as after a restart or a pause: nothing leads back across it.
    pub fn mark_gap(&mut self) {
        self.cut = true;
    }

    /// The estimated period between poses, seconds (Algorithm 4); zero while there is none.
    pub fn period(&self) -> f64 {
        self.period
    }

    /// The newest recorded pose.
    pub fn newest(&self) -> Option<&Recorded> {
        self.ring.back()
    }

    /// All that was recorded without a gap, oldest first, and which of these is the pose at `since`.
    ///
    /// # Errors
    /// If that has fallen out of the ring, or there is a gap since then.
    pub fn past(&self, since: Time) -> Result<(Vec<Recorded>, usize), HistoryTooShort> {
        let start = self.ring.partition_point(|r| r.at < since);
        // a gap is before the pose that is marked: that pose itself can be gone back to
        let usable = self.ring.iter().rposition(|r| r.after_gap).unwrap_or(0);
        let oldest = self.ring.get(usable).map_or(Time::ZERO, |r| r.at);
        match (self.ring.get(start), start.checked_sub(usable)) {
            (Some(r), Some(start)) if r.at == since => Ok((self.ring.range(usable..).cloned().collect(), start)),
            _ => Err(HistoryTooShort { oldest, asked: since }),
        }
    }

    /// If the pose at `since` is about to fall out of the full ring: one that will stay for a while, a tenth of the
    /// ring after the oldest. About to: it is asked at each reading, of which some may be missing.
    pub fn later_start(&self, since: Time) -> Option<&Recorded> {
        let brink = self.ring.get(self.length / 50 + 1)?;
        (self.ring.len() == self.length && since <= brink.at).then(|| self.ring.get(self.length / 10 + 2)).flatten()
    }

    /// Greatest motor speed over the window, rad/s: between the means of its halves, and, so that a motor that turns
    /// round is not at rest, between those of each half's own halves; these are three times as noisy, and count a
    /// third.
    fn speed(&self) -> f64 {
        let window = WINDOW * self.crowd();
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
        // nothing has moved in the whole window, as in most of them: no sums are needed
        if self.unchanged <= first.at {
            return 0.0;
        }
        let way = |from: usize, n: usize, m: usize| {
            (sum(from..from + n, m) - sum(from + n..from + 2 * n, m)).abs() / n as f64
        };
        let motors = (0..last.q.len()).filter(|m| !self.stands(*m, last.at));
        let turn = |m: usize| way(start, half / 2, m).max(way(start + half, half / 2, m));
        motors.map(|m| way(start, half, m).max(turn(m) * 2.0 / 3.0)).fold(0.0, f64::max) / secs
    }

    /// Whether a motor with a coarse encoder stands; without one it is judged by the window.
    fn stands(&self, motor: usize, now: Time) -> bool {
        let Some(Coarse { band, secs }) = self.coarse.get(motor).copied().filter(|coarse| coarse.band > 0.0) else {
            return false;
        };
        let since = Duration::from_secs_f64(secs);
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for r in self.ring.iter().rev() {
            let q = r.q.get(motor).copied().unwrap_or(f64::NAN);
            (low, high) = (low.min(q), high.max(q));
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

    /// How many readings there are in the time of a usual one: a board that tells a thousand a second has ten times as
    /// many in its window, or the speed would be nothing but noise.
    fn crowd(&self) -> usize {
        if self.period > 0.0 { (USUAL / self.period).round().clamp(1.0, FASTEST) as usize } else { 1 }
    }

    /// How long the ring reaches back, gaps or not.
    pub fn span(&self) -> Duration {
        match (self.ring.front(), self.ring.back()) {
            (Some(a), Some(b)) => b.at.since(a.at),
            _ => Duration::ZERO,
        }
    }
}

#[cfg(test)]
mod tests;
