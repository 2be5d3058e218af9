//! How a running system is: what a status line, or a person's "why does it not move?", is answered from.

use super::Counts;
use crate::runtime::stream::Counters;
use crate::runtime::supervision::Health;
use crate::wiring::{Hub, Wires};
use mobee_contract::{AnswerTime, Status, SwapPart, SwapStep, Time};
use std::collections::BTreeMap;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// A running system at an instant.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// When.
    pub at: Time,
    /// The robots.
    pub robots: Vec<RobotReport>,
    /// Who runs, group by group.
    pub tree: Vec<Health>,
    /// The bounded links between actors, by name.
    pub links: Vec<(String, Counters)>,
    /// The counters of the run.
    pub counts: Counts,
}

/// One robot at an instant.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotReport {
    /// Its name.
    pub name: String,
    /// The state of its filter.
    pub status: Status,
    /// The age of its newest reading.
    pub age: Duration,
    /// The greatest age of a reading that is still fresh.
    pub fresh: Duration,
    /// How long its board took to answer of late, if that is known.
    pub answers: Option<AnswerTime>,
    /// Whether its own agent may make motions.
    pub acts: bool,
    /// The last step of the exchange of each part that was ever exchanged.
    pub swaps: BTreeMap<SwapPart, SwapStep>,
}

impl Report {
    /// The system as it is, but for its tree.
    pub(super) fn of(hub: &Hub, tree: Vec<Health>) -> Report {
        let at = hub.clock.now();
        let of_robot = |w: &Wires| [&w.to_history, &w.to_reflex, &w.to_supervise].map(|s| (s.name(), s.counters()));
        let mut links: Vec<(String, Counters)> = hub.robots.iter().flat_map(|w| of_robot(w)).collect();
        links.push((hub.to_model.name(), hub.to_model.counters()));
        links.extend(hub.taps.counters());
        let robots = hub.robots.iter().map(|w| RobotReport::of(w, at)).collect();
        let counts = hub.counts.lock().clone();
        Report { at, robots, tree, links, counts }
    }
}

impl RobotReport {
    fn of(wires: &Wires, now: Time) -> RobotReport {
        let latest = wires.latest.lock().clone();
        RobotReport {
            name: wires.name.clone(),
            status: latest.status,
            age: now.since(latest.at),
            fresh: wires.rules().fresh,
            answers: *wires.answers.lock(),
            acts: wires.agent_acts.load(Ordering::SeqCst),
            swaps: wires.swaps.lock().clone(),
        }
    }
}
