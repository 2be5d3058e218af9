//! I34: a robot that looks ahead touches nothing that it could have stopped short of.
//!
//! A contact is unavoidable if the object was placed so late that the robot could not have stopped since, in an
//! escape, which starts in contact, or soon after a part failed, a reading was stale or a motor was displaced.
//! A contact under Algorithm 6 or without a reflex, also of the other robot, is counted but is no violation. A
//! contact is not judged if the journal does not state the clearance.

use super::disturbances::Disturbances;
use super::touches::Touches;
use super::{FoundViolations, Invariant};
use crate::journal::JournalLine;
use mobee_contract::{Event, Time};
use mobee_model::Pair;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

/// Hard contacts of a run, as episodes, by the rule that applies to each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct HardContactTally {
    /// Number of episodes.
    pub episodes: u64,
    /// Greatest penetration depth, meters.
    pub depth: f64,
    /// Episodes that a robot that looks ahead could have avoided: each is a violation of I34.
    pub avoidable: u64,
    /// Episodes that it could not have avoided.
    pub unavoidable: u64,
    /// Episodes under Algorithm 6 or without a reflex.
    pub unpromised: u64,
    /// Episodes for which the journal does not state the clearance.
    pub unjudged: u64,
}

impl fmt::Display for HardContactTally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let contacts = if self.episodes == 1 { "contact" } else { "contacts" };
        write!(f, "{} hard {contacts}, at most {:.1} mm deep", self.episodes, self.depth * 1e3)?;
        let of = [
            (self.avoidable, "avoidable"),
            (self.unavoidable, "not avoidable"),
            (self.unpromised, "under Algorithm 6 (`reserve_mm = 0`) or without a reflex, which don't rule them out"),
            (self.unjudged, "not judged: this journal does not state the braking clearance"),
        ];
        let words: Vec<String> = of.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")).collect();
        if words.is_empty() { Ok(()) } else { write!(f, ": {}", words.join("; ")) }
    }
}

/// Judges hard contacts as they occur.
#[derive(Default)]
pub(super) struct HardContacts {
    touches: Touches,
    tally: HardContactTally,
    /// In the order of the journal, which is that of the scene.
    robots: Vec<DrivenRobot>,
    /// Time at which each object was last placed.
    edited: BTreeMap<String, Time>,
    disturbances: Disturbances,
}

#[derive(Default)]
struct DrivenRobot {
    name: String,
    /// Braking clearance, meters: zero under Algorithm 6; `None` if the journal does not state it.
    clearance: Option<f64>,
    /// Stopping time.
    stops: Duration,
    escapes: bool,
}

/// The rule that applies to a contact.
enum Rule {
    Avoidable,
    Unavoidable,
    Unpromised,
    Unjudged,
}

impl HardContacts {
    /// Takes the next event.
    ///
    /// # Returns
    /// The violation, if an avoidable contact begins.
    pub fn note(&mut self, at: Time, event: &Event) -> Option<String> {
        self.follow(at, event);
        let begins = self.touches.note(event);
        (self.tally.episodes, self.tally.depth) = (self.touches.episodes, self.touches.depth);
        let Event::HardContact { robot, contact, names } = event else { return None };
        if !begins {
            return None;
        }
        match self.rule(at, contact.pair, names) {
            Rule::Avoidable => {
                self.tally.avoidable += 1;
                let (a, b) = names;
                let mm = -contact.distance * 1e3;
                Some(format!(
                    "{robot}: {a} touches {b}, {mm:.1} mm deep; it looks ahead, and nothing was put there too late to brake"
                ))
            }
            rule => {
                let count = match rule {
                    Rule::Unpromised => &mut self.tally.unpromised,
                    Rule::Unjudged => &mut self.tally.unjudged,
                    Rule::Avoidable | Rule::Unavoidable => &mut self.tally.unavoidable,
                };
                *count += 1;
                None
            }
        }
    }

    /// Tally of all contacts so far.
    pub fn tally(&self) -> HardContactTally {
        self.tally
    }

    fn rule(&self, at: Time, pair: Pair, names: &(String, String)) -> Rule {
        let index = [pair.0.robot(), pair.1.robot()];
        let robots: Vec<Option<&DrivenRobot>> = index.into_iter().flatten().map(|i| self.robots.get(i)).collect();
        let clearances: Option<Vec<f64>> = robots.iter().map(|r| r.and_then(|r| r.clearance)).collect();
        let Some(clearances) = clearances else { return Rule::Unjudged };
        if clearances.iter().any(|clearance| *clearance <= 0.0) {
            return Rule::Unpromised;
        }
        let stops = robots.iter().flatten().map(|r| r.stops).max().unwrap_or_default();
        let is_late = |name: &String| {
            let object = name.rsplit_once('#').map_or(name.as_str(), |(object, _)| object);
            self.edited.get(object).is_some_and(|edited| at.since(*edited) <= stops)
        };
        let escapes = robots.iter().flatten().any(|r| r.escapes);
        if escapes || self.disturbances.excuse(at) || is_late(&names.0) || is_late(&names.1) {
            return Rule::Unavoidable;
        }
        Rule::Avoidable
    }

    /// Updates the state that the rules depend on.
    fn follow(&mut self, at: Time, event: &Event) {
        self.disturbances.note(at, event);
        match event {
            Event::Robot { robot, .. } if self.robots.iter().all(|r| r.name != *robot) => {
                self.robots.push(DrivenRobot { name: robot.clone(), ..DrivenRobot::default() });
            }
            Event::Controller { robot, clearance, stops, .. } => {
                let stops = stops.and_then(|secs| Duration::try_from_secs_f64(secs).ok()).unwrap_or_default();
                self.of(robot, |r| (r.clearance, r.stops) = (*clearance, stops));
            }
            Event::Commit { robot, escape, .. } => self.of(robot, |r| r.escapes = *escape),
            Event::Outcome { robot, .. } => self.of(robot, |r| r.escapes = false),
            Event::World { object, .. } => drop(self.edited.insert(object.clone(), at)),
            _ => {}
        }
    }

    fn of(&mut self, robot: &str, change: impl FnMut(&mut DrivenRobot)) {
        self.robots.iter_mut().filter(|r| r.name == robot).for_each(change);
    }
}

impl Invariant for HardContacts {
    fn on(&mut self, line: &JournalLine, found: &mut FoundViolations<'_>) {
        found.report_all(self.note(line.at, &line.event));
    }
}
