//! Bridges over gaps in the readings: a busy machine misses readings for a fraction of a second, while the robot goes on
//! as it was commanded. Within [`MAX_BRIDGED_TIME`] the path across such a gap is the commanded one, if both readings
//! beside the gap are near it. A bridge is a path to retreat on, and nothing else: no speed is estimated across it, no
//! camera image is located by it, and other robots count as unrecorded there.

use super::{MAX_BRIDGED_MOTION, Recorded};
use mobee_contract::{MAX_BRIDGED_TIME, Pose, Time, distance};
use std::collections::VecDeque;
use std::time::Duration;

/// Greatest number of stored set-points: half a second at 1 kHz.
const MAX_SET_POINTS: usize = 512;
/// Greatest number of configurations of a bridge.
const MAX_POSES: f64 = 512.0;

/// Commanded path of the robot during a gap.
#[derive(Clone, Debug, PartialEq)]
pub enum CommandedPath {
    /// Unknown, as at rest, in an escape or during a retreat.
    Unknown,
    /// Straight to this configuration, rad.
    Straight(Pose),
    /// Along the set-points that [`super::HistoryCore::note_setpoint`] has recorded.
    Setpoints,
}

/// A gap in the readings that is bridged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BridgedGap {
    /// Time of the last reading before the gap.
    pub since: Time,
    /// Number of configurations in the gap.
    pub poses: usize,
}

/// Set-points of the last [`MAX_BRIDGED_TIME`] before the newest reading, and later ones; oldest first.
#[derive(Clone, Debug, Default)]
pub(super) struct RecentSetpoints(VecDeque<(Time, Pose)>);

impl RecentSetpoints {
    /// Records a whole configuration that was commanded at `now`, rad.
    pub fn note(&mut self, now: Time, q: Pose) {
        if self.0.len() >= MAX_SET_POINTS {
            self.0.pop_front();
        }
        self.0.push_back((now, q));
    }

    /// Drops set-points that no later gap can need. `newest`: time of the newest reading.
    pub fn forget(&mut self, newest: Time) {
        while self.0.front().is_some_and(|(at, _)| *at + MAX_BRIDGED_TIME < newest) {
            self.0.pop_front();
        }
    }

    /// Corners of the path along the set-points from `a` to `b`; `None` if one of them is not near the set-points, or if
    /// these jump.
    fn corners(&self, a: &Pose, b: &Pose) -> Option<Vec<Pose>> {
        let nearest = |q: &Pose, from: usize| {
            let all = self.0.iter().enumerate().skip(from);
            all.min_by(|(_, (_, x)), (_, (_, y))| distance(x, q).total_cmp(&distance(y, q))).map(|(i, _)| i)
        };
        let first = nearest(a, 0)?;
        let last = nearest(b, first)?;
        let between = self.0.iter().skip(first).take(last + 1 - first).map(|(_, q)| q.clone());
        let corners: Vec<Pose> = [a.clone()].into_iter().chain(between).chain([b.clone()]).collect();
        let steady = corners.windows(2).all(|w| matches!(w, [a, b] if distance(a, b) <= MAX_BRIDGED_MOTION));
        steady.then_some(corners)
    }
}

/// Returns the configurations in the gap between two readings, one per `period` (s), at constant speed along the
/// commanded path; `None` if the readings are not beside that path.
pub(super) fn bridge(
    (a, b): (&Recorded, &Recorded),
    commanded: &CommandedPath,
    setpoints: &RecentSetpoints,
    period: f64,
) -> Option<Vec<Recorded>> {
    let corners = match commanded {
        CommandedPath::Unknown => return None,
        CommandedPath::Straight(target) => {
            let passed = nearest_on_line(&a.q, target, &b.q);
            (distance(&passed, &b.q) <= MAX_BRIDGED_MOTION).then(|| vec![a.q.clone(), passed, b.q.clone()])?
        }
        CommandedPath::Setpoints => setpoints.corners(&a.q, &b.q)?,
    };
    let length: f64 = corners.windows(2).map(|w| leg(w).0).sum();
    let secs = b.at.since(a.at).as_secs_f64();
    let poses = (secs / period.max(1e-3)).round().clamp(1.0, MAX_POSES) as usize;
    let point = |k: usize| {
        let share = k as f64 / poses as f64;
        let at = a.at + Duration::from_secs_f64(secs * share);
        Some(Recorded {
            bridged: true,
            after_pause: true,
            ..Recorded::next(at, along(&corners, length * share)?, length / secs)
        })
    };
    (1..poses).map(point).collect()
}

/// Length of a leg, rad, and its ends.
fn leg(ends: &[Pose]) -> (f64, Option<(&Pose, &Pose)>) {
    if let [a, b] = ends { (distance(a, b), Some((a, b))) } else { (0.0, None) }
}

/// Configuration at this distance along the path.
fn along(corners: &[Pose], distance: f64) -> Option<Pose> {
    let mut left = distance;
    for ends in corners.windows(2) {
        let (length, Some((a, b))) = leg(ends) else { continue };
        if left <= length {
            let share = left / length.max(f64::MIN_POSITIVE);
            return Some(a.iter().zip(b.iter()).map(|(a, b)| a + (b - a) * share).collect());
        }
        left -= length;
    }
    corners.last().cloned()
}

/// Point of the line from `a` to `b` that is nearest to `q`.
fn nearest_on_line(a: &Pose, b: &Pose, q: &Pose) -> Pose {
    let along = |of: &Pose| a.iter().zip(b.iter()).zip(of.iter()).map(|((a, b), q)| (b - a) * (q - a)).sum::<f64>();
    let share = (along(q) / along(b).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    a.iter().zip(b.iter()).map(|(a, b)| a + (b - a) * share).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::history::HistoryCore;
    use crate::pulse::Pulse;
    use mobee_contract::Sample;

    fn deg(q: [f64; 2]) -> Pose {
        q.iter().map(|q| q.to_radians()).collect()
    }

    fn pulse(ms: u64, q: [f64; 2]) -> Pulse {
        let sample =
            Sample { seq: ms / 10, at: Time(ms * 1_000_000), q: deg(q), done: vec![true; 2], ..Sample::default() };
        Pulse::new(sample, &Vec::new().into())
    }

    /// A robot that moves at 100 deg/s for 0.2 s; readings are missing for `gap` ms; then the first motor is at `then`, deg.
    /// Returns the history, the pulse after the gap, and whether the history reaches back across it.
    fn missing(gap: u64, then: [f64; 2], commanded: &CommandedPath, stale: u64) -> (HistoryCore, Pulse, bool) {
        let mut history = HistoryCore::new(1000);
        let known = CommandedPath::Unknown;
        let stale = Duration::from_millis(stale);
        for ms in (0..=200).step_by(10) {
            history.note_setpoint(Time(ms * 1_000_000), deg([0.1 * ms as f64, 0.0]));
            history.record(&mut pulse(ms, [0.1 * ms as f64, 0.0]), stale, &known);
        }
        for ms in (210..=200 + gap).step_by(10) {
            // the set-points turn a corner
            let (x, y) = (0.1 * ms.min(350) as f64, 0.1 * ms.saturating_sub(350) as f64);
            history.note_setpoint(Time(ms * 1_000_000), deg([x, y]));
        }
        let mut after = pulse(200 + gap, then);
        history.record(&mut after, stale, commanded);
        let reaches = history.past(Time::ZERO).is_ok();
        (history, after, reaches)
    }

    #[test]
    fn a_gap_in_a_move_is_bridged_along_the_line_to_its_target() {
        let straight = CommandedPath::Straight(deg([90.0, 0.0]));
        let (history, after, reaches) = missing(300, [50.0, 1.0], &straight, 500);
        assert!(reaches && after.speed.is_infinite(), "no speed is known yet");
        assert_eq!(after.bridged, Some(BridgedGap { since: Time(200_000_000), poses: 29 }));
        let (past, _) = history.past(Time::ZERO).unwrap();
        let steps = past.windows(2).map(|w| distance(&w[0].q, &w[1].q).to_degrees());
        assert!(steps.fold(0.0, f64::max) < 1.5, "no jump is left");
        let bridged: Vec<&Recorded> = past.iter().filter(|r| r.bridged).collect();
        assert_eq!(bridged.len(), 30, "and the reading after it");
        assert!(bridged.iter().all(|r| r.q[1].abs() <= 1.0_f64.to_radians() + 1e-9));
        let inside = Time(350_000_000);
        assert!(history.at(inside).is_err() && history.at(Time(205_000_000)).is_err(), "nothing was measured there");
    }

    #[test]
    fn a_gap_in_a_stream_is_bridged_along_its_set_points() {
        let (history, after, reaches) = missing(300, [35.0, 13.0], &CommandedPath::Setpoints, 500);
        assert!(reaches && after.bridged.is_some());
        let (past, _) = history.past(Time::ZERO).unwrap();
        let corner = deg([35.0, 0.0]);
        let nearest = past.iter().map(|r| distance(&r.q, &corner)).fold(f64::INFINITY, f64::min);
        assert!(nearest < 1.0_f64.to_radians(), "it leads round the corner");
    }

    #[test]
    fn gaps_that_are_long_or_lead_elsewhere_remain() {
        let straight = CommandedPath::Straight(deg([90.0, 0.0]));
        let reaches = |gap: u64, then: [f64; 2], commanded: &CommandedPath, stale: u64| {
            let (_, after, reaches) = missing(gap, then, commanded, stale);
            assert_eq!(after.bridged.is_some(), reaches);
            reaches
        };
        assert!(reaches(500, [70.0, 0.0], &straight, 1000) && !reaches(510, [71.0, 0.0], &straight, 1000));
        assert!(!reaches(300, [50.0, 0.0], &straight, 290), "the reading before was stale");
        assert!(!reaches(300, [50.0, 6.0], &straight, 500), "it left the line");
        assert!(!reaches(300, [10.0, 0.0], &straight, 500), "it went the other way");
        assert!(!reaches(300, [50.0, 0.0], &CommandedPath::Unknown, 500));
        assert!(!reaches(300, [50.0, 20.0], &CommandedPath::Setpoints, 500), "it is not at its set-points");
    }

    #[test]
    fn a_restart_is_not_bridged() {
        let straight = CommandedPath::Straight(deg([90.0, 0.0]));
        let stale = Duration::from_millis(500);
        let mut history = HistoryCore::new(100);
        (0..20).for_each(|k| history.record(&mut pulse(10 * k, [k as f64, 0.0]), stale, &straight));
        history.mark_gap();
        history.record(&mut pulse(490, [49.0, 0.0]), stale, &straight);
        assert!(history.past(Time::ZERO).is_err());
    }
}
