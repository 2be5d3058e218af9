//! What the judge knows of one board.

use crate::sim::JointSettings;
use mobee_contract::{Sample, Time};
use mobee_yarp::board::{Ask, Joints, Set};
use std::collections::VecDeque;
use std::ops::Range;
use std::time::Duration;

/// How much older than it is told to be a reading may really be.
const OLDER: Duration = Duration::from_millis(250);

/// What the judge knows of one board.
#[derive(Debug)]
pub(super) struct Watched {
    pub port: String,
    pub motors: Range<usize>,
    /// Since when a stop is to be said.
    pub owed: Option<Time>,
    /// When it was told to stop last.
    pub said: Option<Time>,
    /// When it did not heed a stop, until it is told another.
    pub ignored: Option<Time>,
    /// Whether another program has set its references since they were told or read.
    pub meddled: bool,
    /// When it was told to move last.
    pub moved: Time,
    /// Since when it is to rest.
    pub stopped: Option<Time>,
    /// Whether nothing was ordered on this connection yet.
    pub fresh: bool,
    /// What is being said on either line since when, and whether it is a stop.
    pub saying: [Option<(Time, bool)>; 2],
    /// Where its motors really were, rad.
    pub truth: VecDeque<(Time, Vec<f64>)>,
    /// Since when each motor outruns what it was told.
    pub fast: Vec<Option<Time>>,
    /// When answers came, and how long they took, s.
    pub answers: VecDeque<(Time, f64)>,
    /// What was found in its joints, and since when none of them has moved or changed.
    pub found: Vec<JointSettings>,
    pub still: Option<Time>,
    /// Until when it can't be helped that no stop gets there.
    pub excused: Time,
}

impl Watched {
    /// A board of which nothing is known yet.
    pub fn new(port: String, motors: Range<usize>) -> Watched {
        Watched {
            port,
            fast: vec![None; motors.len()],
            motors,
            owed: None,
            said: None,
            ignored: None,
            meddled: false,
            moved: Time::ZERO,
            stopped: None,
            fresh: false,
            saying: [None; 2],
            truth: VecDeque::new(),
            answers: VecDeque::new(),
            found: Vec::new(),
            still: None,
            excused: Time::ZERO,
        }
    }

    /// Whether a stop is on its way that was said after the last move.
    pub fn is_being_stopped(&self) -> bool {
        self.saying.iter().flatten().any(|(since, is_stop)| *is_stop && *since > self.moved)
    }

    /// Whether its part of a reading is of a time before the one that is told, by more than is allowed.
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
            // a fast motor goes on after the last look at it
            let step = all().zip(all().skip(1)).map(|(a, b)| (b - a).abs()).fold(0.0, f64::max);
            *q < least - step - noise || *q > most + step + noise
        })
    }

    /// Whether these orders say nothing but what was found.
    pub fn is_as_found(&self, ask: &Ask) -> bool {
        let all = |joints: &Joints, says: &dyn Fn(usize, &JointSettings) -> bool| {
            let joints = joints.on(self.found.len()).unwrap_or_default();
            joints.iter().enumerate().all(|(i, j)| self.found.get(*j).is_some_and(|kept| says(i, kept)))
        };
        let near = |said: Option<&f64>, found: f64| said.is_some_and(|said| (said - found).abs() < 1e-6);
        match ask {
            Ask::Set(Set::Speed(joints, said)) => all(joints, &|i, kept| near(said.get(i), kept.speed)),
            Ask::Set(Set::Acceleration(joints, said)) => all(joints, &|i, kept| near(said.get(i), kept.acceleration)),
            Ask::Set(Set::Mode(joints, said)) => all(joints, &|i, kept| said.get(i) == Some(&kept.mode)),
            _ => false,
        }
    }

    /// What half of the answers of the last seconds took at least, s, if there were many.
    pub fn median(&self, now: Time) -> Option<f64> {
        let of_late = self.answers.iter().filter(|(at, _)| now.since(*at) < Duration::from_secs(4));
        let mut all: Vec<f64> = of_late.map(|(_, took)| *took).collect();
        all.sort_by(f64::total_cmp);
        if all.len() < 20 { None } else { all.get(all.len() / 2).copied() }
    }
}
