//! I35: a robot does not go on pushing what it meets: it has brought that to an end within a second and the time that it takes to brake and
//! to come back.
//!
//! Judged by the forces that a simulation knows (`pushed`). Excused are pushes after a disturbance, as for hard contacts, and in an escape.

use super::disturbances::Disturbances;
use super::{Found, Invariant, PerRobot};
use crate::record::journal::JournalLine;
use mobee_contract::Event;
use std::collections::BTreeMap;

/// How long a push may last beside braking and coming back, s.
const LONGEST: f64 = 1.0;

/// Judges pushes as they end.
#[derive(Default)]
pub(super) struct Released {
    robots: BTreeMap<String, Robot>,
    disturbances: Disturbances,
}

#[derive(Default)]
struct Robot {
    /// The time in which it comes to rest, s.
    stops: f64,
    /// Whether its motion leads out of a contact, or has begun while it was in one.
    escapes: bool,
    /// The push that was reported before its end: when it began, s, and its greatest force so far, N.
    open: Option<(f64, f64)>,
}

impl Robot {
    fn judge(&self, robot: &str, secs: f64, newtons: f64) -> Option<String> {
        let most = LONGEST + 2.0 * self.stops;
        (secs > most && !self.escapes).then(|| {
            format!("{robot}: pushed something for {secs:.2} s, with at most {newtons:.1} N; {most:.2} s are allowed")
        })
    }
}

impl Invariant for Released {
    fn on(&mut self, line: &JournalLine, found: &mut Found<'_>) {
        self.disturbances.note(line.at, &line.event);
        let now = line.at.secs();
        match &line.event {
            Event::Controller { robot, stops, .. } => {
                self.robots.entry(robot.clone()).or_default().stops = stops.unwrap_or_default();
            }
            Event::Commit { robot, escape, .. } => self.robots.of(robot, |r| r.escapes = *escape),
            Event::Pushed { robot, newtons, secs, lasting } => {
                let excused = self.disturbances.excuse(line.at);
                let Some(of) = self.robots.get_mut(robot) else { return };
                of.open = lasting.then_some((now - secs, *newtons));
                if !lasting && !excused {
                    found.say_all(of.judge(robot, *secs, *newtons));
                }
            }
            Event::Ended { .. } => {
                let judge =
                    |(name, r): (&String, &Robot)| r.open.and_then(|(since, most)| r.judge(name, now - since, most));
                found.say_all(self.robots.iter().filter_map(judge));
            }
            _ => {}
        }
    }
}
