//! State of one board, as the judge tracks it.

use super::board::JointSettings;
use mobee_contract::{Sample, Time};
use mobee_yarp::board::{Ask, Joints, Set};
use std::collections::VecDeque;
use std::ops::Range;
use std::time::Duration;

/// Tolerated age of a reading beyond its stated age.
const OLDER: Duration = Duration::from_millis(250);

/// State of one board, as the judge tracks it.
#[derive(Debug)]
pub(super) struct WatchedBoard {
    pub port: String,
    pub motors: Range<usize>,
    /// Time since which a stop is due.
    pub owed: Option<Time>,
    /// Time of the last stop sent.
    pub stop_sent: Option<Time>,
    /// Time of a stop that the board ignored, until the next one is sent.
    pub ignored: Option<Time>,
    /// True if another program has set its references since they were sent or read.
    pub meddled: bool,
    /// Time of the last move commanded.
    pub moved: Time,
    /// Time since which it has to rest.
    pub stopped: Option<Time>,
    /// True if no order was sent on this connection yet.
    pub fresh: bool,
    /// Start of the message in transit on each connection, and whether it is a stop.
    pub in_transit: [Option<(Time, bool)>; 2],
    /// True positions of its motors, rad.
    pub truth: VecDeque<(Time, Vec<f64>)>,
    /// Time since which each motor exceeds its commanded speed.
    pub fast: Vec<Option<Time>>,
    /// Arrival times of answers, and their durations, s.
    pub answers: VecDeque<(Time, f64)>,
    /// Settings found in its joints, and the time since which none of them has moved or changed.
    pub found: Vec<JointSettings>,
    pub still: Option<Time>,
    /// Time until which missing stops are excused.
    pub excused: Time,
}

impl WatchedBoard {
    /// Creates the initial state of a board.
    pub fn new(port: String, motors: Range<usize>) -> WatchedBoard {
        WatchedBoard {
            port,
            fast: vec![None; motors.len()],
            motors,
            owed: None,
            stop_sent: None,
            ignored: None,
            meddled: false,
            moved: Time::ZERO,
            stopped: None,
            fresh: false,
            in_transit: [None; 2],
            truth: VecDeque::new(),
            answers: VecDeque::new(),
            found: Vec::new(),
            still: None,
            excused: Time::ZERO,
        }
    }

    /// True if a stop is in transit that was sent after the last move.
    pub fn is_being_stopped(&self) -> bool {
        self.in_transit.iter().flatten().any(|(since, is_stop)| *is_stop && *since > self.moved)
    }

    /// True if its part of a reading is older than stated, by more than is tolerated.
    pub fn is_older(&self, sample: &Sample) -> bool {
        let since = Time(sample.at.0.saturating_sub(OLDER.as_nanos() as u64));
        let window: Vec<&Vec<f64>> = self.truth.iter().filter(|(at, _)| *at >= since).map(|(_, q)| q).collect();
        let covered = self.truth.front().is_some_and(|(at, _)| *at <= since);
        let Some(read) = sample.q.get(self.motors.clone()).filter(|_| covered && !window.is_empty()) else {
            return false;
        };
        let noise = 0.5_f64.to_radians();
        read.iter().enumerate().any(|(j, q)| {
            let all = || window.iter().filter_map(|w| w.get(j));
            let (least, most) = all().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), q| (a.min(*q), b.max(*q)));
            // a fast motor moves on after the last check
            let step = all().zip(all().skip(1)).map(|(a, b)| (b - a).abs()).fold(0.0, f64::max);
            *q < least - step - noise || *q > most + step + noise
        })
    }

    /// True if an order only restores settings as found.
    pub fn is_as_found(&self, ask: &Ask) -> bool {
        let all = |joints: &Joints, says: &dyn Fn(usize, &JointSettings) -> bool| {
            let joints = joints.on(self.found.len()).unwrap_or_default();
            joints.iter().enumerate().all(|(i, j)| self.found.get(*j).is_some_and(|kept| says(i, kept)))
        };
        let near = |sent: Option<&f64>, found: f64| sent.is_some_and(|sent| (sent - found).abs() < 1e-6);
        match ask {
            Ask::Set(Set::Speed(joints, said)) => all(joints, &|i, kept| near(said.get(i), kept.speed)),
            Ask::Set(Set::Acceleration(joints, said)) => all(joints, &|i, kept| near(said.get(i), kept.acceleration)),
            Ask::Set(Set::Mode(joints, said)) => all(joints, &|i, kept| said.get(i) == Some(&kept.mode)),
            _ => false,
        }
    }

    /// Median answer time of the last seconds, s, if there were enough answers.
    pub fn median(&self, now: Time) -> Option<f64> {
        let of_late = self.answers.iter().filter(|(at, _)| now.since(*at) < Duration::from_secs(4));
        let mut all: Vec<f64> = of_late.map(|(_, took)| *took).collect();
        all.sort_by(f64::total_cmp);
        if all.len() < 20 { None } else { all.get(all.len() / 2).copied() }
    }
}
