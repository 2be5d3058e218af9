//! What is counted while a run goes on.

use crate::check::touches::Touches;
use mobee_contract::{Cause, Event, Outcome, RestStep, Status, Summary, SwapPart, SwapStep};
use std::collections::BTreeMap;
use std::time::Duration;

/// Counters of a run, all robots together.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct RunCounts {
    /// Encoder readings.
    pub samples: u64,
    /// Accepted commits.
    pub commits: u64,
    /// Of these, escapes.
    pub escapes: u64,
    /// Refused commits.
    pub refused: u64,
    /// Motions that reached their target.
    pub committed: u64,
    /// Motions that the reflex took back.
    pub rolled_back: u64,
    /// Motions that ended elsewhere.
    pub faulted: u64,
    /// Motions that ended elsewhere because a person, a program or the end of the run stopped them.
    pub stopped: u64,
    /// The causes of the motions that were rolled back or faulted, each with their number.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub failed_by: BTreeMap<&'static str, u64>,
    /// Contacts that began.
    pub contacts: u64,
    /// Hard contacts: times at which a robot touched another, an object or itself by its motion, however many of their shapes met.
    pub hard_contacts: u64,
    /// The greatest depth of these, millimeters.
    pub hard_contact_depth_mm: f64,
    /// The greatest force with which a simulated robot pushed anything, N, and the longest time for which it did, s. 0: none, or no
    /// simulation with forces.
    #[serde(skip_serializing_if = "is_zero")]
    pub push_n: f64,
    /// See above.
    #[serde(skip_serializing_if = "is_zero")]
    pub push_s: f64,
    /// Restarts of actors.
    pub restarts: u64,
    /// Groups that used up their restarts, those of sensors and services among them.
    pub gave_up: u64,
    /// Whether one of them was the safety chain's or an agent's, which ends the run.
    #[serde(skip)]
    pub is_given_up: bool,
    /// Sensors and services that do not serve, such as one that used up its restarts or a bridge without its ports, with the reason.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub down: BTreeMap<String, String>,
    /// Pictures that cameras could not use, and skipped.
    pub pictures_skipped: u64,
    /// Regions that detectors found beyond the number that their sensor reports.
    pub regions_omitted: u64,
    /// Retreats that were given up.
    pub retreats_stopped: u64,
    /// Commands thrown away.
    pub commands_dropped: u64,
    /// How often a motor left the place where it rested.
    pub displaced: u64,
    /// How often a filter was closed because the readings were old.
    pub stale: u64,
    /// Readings that were pushed out by newer ones, since an actor did not get its turn.
    pub readings_dropped: u64,
    /// Control periods that were missed.
    pub late: Late,
    /// What touches now.
    #[serde(skip)]
    pub(crate) touches: Touches,
    /// The filters' states, by robot.
    pub status: BTreeMap<String, Status>,
    /// The newest step of each robot's motion to its rest pose.
    #[serde(skip)]
    pub rest: BTreeMap<String, RestStep>,
    /// What the agents said at their end, by robot.
    pub done: BTreeMap<String, Summary>,
}

fn is_zero(x: &f64) -> bool {
    *x == 0.0
}

impl RunCounts {
    /// The causes of failed motions for people, the most frequent first: `contact foreseen 12, stall 3`.
    pub fn failed_by(&self) -> Option<String> {
        let mut causes: Vec<_> = self.failed_by.iter().collect();
        causes.sort_by_key(|(_, n)| std::cmp::Reverse(**n));
        let words: Vec<String> = causes.iter().map(|(cause, n)| format!("{cause} {n}")).collect();
        (!words.is_empty()).then(|| words.join(", "))
    }

    /// Takes in an event.
    pub fn note(&mut self, event: &Event) {
        self.touches.note(event);
        (self.hard_contacts, self.hard_contact_depth_mm) = (self.touches.episodes, self.touches.depth * 1e3);
        if let Event::Outcome { outcome: Outcome::RolledBack | Outcome::Faulted, cause: Some(cause), .. } = event
            && *cause != Cause::Asked
        {
            *self.failed_by.entry(cause.word()).or_default() += 1;
        }
        match event {
            Event::Commit { escape, .. } => {
                self.commits += 1;
                self.escapes += u64::from(*escape);
            }
            Event::Refused { .. } => self.refused += 1,
            Event::Sighted { omitted, is_shadow: false, .. } => self.regions_omitted += omitted,
            Event::Outcome { outcome: Outcome::Committed, .. } => self.committed += 1,
            Event::Outcome { outcome: Outcome::RolledBack, .. } => self.rolled_back += 1,
            Event::Outcome { outcome: Outcome::Faulted, cause: Some(Cause::Asked), .. } => self.stopped += 1,
            Event::Outcome { outcome: Outcome::Faulted, .. } => self.faulted += 1,
            Event::ContactBegan { .. } => self.contacts += 1,
            Event::Pushed { newtons, secs, .. } => {
                (self.push_n, self.push_s) = (self.push_n.max(*newtons), self.push_s.max(*secs));
            }
            Event::RetreatStopped { .. } => self.retreats_stopped += 1,
            Event::Displaced { .. } => self.displaced += 1,
            Event::Disabled { cause: Cause::Displaced { .. }, .. } => self.displaced += 1,
            Event::CommandDropped { .. } => self.commands_dropped += 1,
            Event::Disabled { cause: Cause::Stale, .. } => self.stale += 1,
            // what was lost in a restart was lost in a queue that was not full; a latest value (capacity 1) drops by design
            Event::Link { dropped, most, capacity, .. } if *capacity > 1 && most >= capacity => {
                self.readings_dropped += dropped;
            }
            Event::State { robot, status } => {
                self.status.insert(robot.clone(), *status);
            }
            // the new agent may have more to do
            Event::Swap { robot, part: SwapPart::Agent, step: SwapStep::TookOver { .. } } => {
                self.done.remove(robot);
            }
            // the resumed run has an end of its own
            Event::Resumed { .. } => self.rest.clear(),
            Event::Rest { robot, step } => {
                self.rest.insert(robot.clone(), step.clone());
            }
            Event::Done { robot, summary } => {
                self.done.insert(robot.clone(), summary.clone());
            }
            _ => {}
        }
    }

    /// Outcomes given.
    pub fn outcomes(&self) -> u64 {
        self.committed + self.rolled_back + self.faulted + self.stopped
    }
}

/// Control periods in which the driver's turn came too late, by the run's clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Late {
    /// How many.
    pub periods: u64,
    /// In how many seconds of the run there were any.
    pub seconds: u64,
    /// The newest one of these seconds, and one more.
    #[serde(skip)]
    until: u64,
}

impl Late {
    /// The driver's turn comes now, and was due `by` earlier.
    pub fn note(&mut self, now: Duration, by: Duration, period: Duration) {
        let missed = by.as_nanos() / period.as_nanos().max(1);
        if missed == 0 {
            return;
        }
        self.periods += u64::try_from(missed).unwrap_or(u64::MAX);
        let second = now.as_secs() + 1;
        if second > self.until {
            (self.seconds, self.until) = (self.seconds + 1, second);
        }
    }
}
