//! Counters during a run.

use mobee_contract::{Cause, Event, Outcome, RestStep, Status, Summary, SwapPart, SwapStep};
use mobee_journal::check::touches::Touches;
use std::collections::BTreeMap;
use std::time::Duration;

/// Counters of a run, over all robots.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct RunCounts {
    /// Encoder readings.
    pub samples: u64,
    /// Accepted commits.
    pub commits: u64,
    /// Escapes among them.
    pub escapes: u64,
    /// Refused commits.
    pub refused: u64,
    /// Motions that reached their target.
    pub committed: u64,
    /// Motions that were rolled back.
    pub rolled_back: u64,
    /// Motions that neither reached their target nor were rolled back.
    pub faulted: u64,
    /// Motions that faulted because a person, a program or the end of the run stopped them.
    pub stopped: u64,
    /// Causes of the motions that were rolled back or faulted, each with their number.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub failed_by: BTreeMap<&'static str, u64>,
    /// Contacts that began.
    pub contacts: u64,
    /// Hard contacts: episodes in which a robot touched another, an object or itself by its motion, however
    /// many of their shapes met.
    pub hard_contacts: u64,
    /// Greatest penetration depth of these, mm.
    pub hard_contact_depth_mm: f64,
    /// Greatest force with which a simulated robot pushed anything, N; 0 without pushes, or without a
    /// simulation of forces.
    #[serde(skip_serializing_if = "is_zero")]
    pub push_n: f64,
    /// Longest duration of such a push, s; 0 as for the force.
    #[serde(skip_serializing_if = "is_zero")]
    pub push_s: f64,
    /// Restarts of actors.
    pub restarts: u64,
    /// Supervision groups that used up their restarts, including those of sensors and services.
    pub gave_up: u64,
    /// True if one of them was the safety chain's or an agent's, which ends the run.
    #[serde(skip)]
    pub is_given_up: bool,
    /// Sensors and services that do not run, such as one that used up its restarts or a bridge without its
    /// ports, with the reason.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub down: BTreeMap<String, String>,
    /// Images that cameras could not use and skipped.
    pub pictures_skipped: u64,
    /// Regions that detectors found beyond the limit of their sensor.
    pub regions_omitted: u64,
    /// Retreats that were aborted.
    pub retreats_stopped: u64,
    /// Commands that were discarded.
    pub commands_dropped: u64,
    /// Number of times that a motor was moved from its place of rest.
    pub displaced: u64,
    /// Number of times that a filter was closed because of old readings.
    pub stale: u64,
    /// Readings that were displaced by newer ones, because an actor did not run in time.
    pub readings_dropped: u64,
    /// Control periods that were missed.
    pub late: Late,
    /// Present hard contacts.
    #[serde(skip)]
    pub(crate) touches: Touches,
    /// States of the filters, by robot.
    pub status: BTreeMap<String, Status>,
    /// Newest step of each robot's motion to its rest pose.
    #[serde(skip)]
    pub rest: BTreeMap<String, RestStep>,
    /// Final reports of the agents, by robot.
    pub done: BTreeMap<String, Summary>,
}

fn is_zero(x: &f64) -> bool {
    *x == 0.0
}

impl RunCounts {
    /// Causes of failed motions as text, the most frequent first: `contact foreseen 12, stall 3`.
    pub fn failed_by(&self) -> Option<String> {
        let mut causes: Vec<_> = self.failed_by.iter().collect();
        causes.sort_by_key(|(_, n)| std::cmp::Reverse(**n));
        let words: Vec<String> = causes.iter().map(|(cause, n)| format!("{cause} {n}")).collect();
        (!words.is_empty()).then(|| words.join(", "))
    }

    /// Takes an event.
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
                self.push_n = self.push_n.max(*newtons);
                self.push_s = self.push_s.max(*secs);
            }
            Event::RetreatStopped { .. } => self.retreats_stopped += 1,
            Event::Displaced { .. } => self.displaced += 1,
            Event::Disabled { cause: Cause::Displaced { .. }, .. } => self.displaced += 1,
            Event::CommandDropped { .. } => self.commands_dropped += 1,
            Event::Disabled { cause: Cause::Stale, .. } => self.stale += 1,
            // A queue that was not full lost its items in a restart; a latest value (capacity 1) drops by
            // design.
            Event::Link { dropped, most, capacity, .. } if *capacity > 1 && most >= capacity => {
                self.readings_dropped += dropped;
            }
            Event::State { robot, status } => {
                self.status.insert(robot.clone(), *status);
            }
            // The new agent may have more to do.
            Event::Swap { robot, part: SwapPart::Agent, step: SwapStep::TookOver { .. } } => {
                self.done.remove(robot);
            }
            // The resumed run has its own end.
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

    /// Number of outcomes given.
    pub fn outcomes(&self) -> u64 {
        self.committed + self.rolled_back + self.faulted + self.stopped
    }
}

/// Control periods in which the driver was polled too late, by the run's clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Late {
    /// Number of periods.
    pub periods: u64,
    /// Number of seconds of the run with late periods.
    pub seconds: u64,
    /// End of the newest of these seconds, s.
    #[serde(skip)]
    until: u64,
}

impl Late {
    /// Takes the delay `by` of the driver's poll at the time `now`.
    pub fn note(&mut self, now: Duration, by: Duration, period: Duration) {
        let missed = by.as_nanos() / period.as_nanos().max(1);
        if missed == 0 {
            return;
        }
        self.periods += u64::try_from(missed).unwrap_or(u64::MAX);
        let second = now.as_secs() + 1;
        if second > self.until {
            self.seconds += 1;
            self.until = second;
        }
    }
}
