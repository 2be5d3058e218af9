//! I15: after all faults have healed, each open transaction and each swap ends, the filter opens, and the agent
//! commits again, all within [`PROGRESS_TIMEOUT`].
//!
//! A robot that was escaping when the faults healed is excused: escapes are slow by design and may take long.
//! An agent that has reported its end need not commit again; nor need a robot without an agent, or one whose
//! agent never committed. A supervision group that used up its restarts stays down.

use super::{FoundViolations, Invariant};
use crate::journal::JournalLine;
use crate::names::HEALED;
use mobee_contract::{Event, Hold, Status, SwapPart, Time};
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

/// Longest time until progress.
const PROGRESS_TIMEOUT: Duration = Duration::from_secs(120);

#[derive(Default)]
pub(super) struct Liveness {
    healed: Option<Time>,
    gave_up: bool,
    robots: BTreeMap<String, LivenessWatch>,
    /// Time of the last event before the run was brought to its end.
    last: Time,
}

#[derive(Default)]
struct LivenessWatch {
    /// The commit that was open when the faults healed, and whether it is an escape.
    open: Option<(u64, bool)>,
    enabled: bool,
    /// True if the filter has been open at any time since.
    opened: bool,
    /// True if the run is being brought to its end: no further motion is expected.
    ending: bool,
    /// True if its agent has committed before and is not done.
    expects_commit: bool,
    /// True if the agent has committed since the faults healed.
    committed_since: bool,
    /// Parts that are being exchanged.
    swaps: BTreeSet<SwapPart>,
}

impl LivenessWatch {
    fn lacks(&self) -> Option<&'static str> {
        if self.open.is_some_and(|(_, escape)| escape) {
            return None;
        }
        let lacks = [
            (self.open.is_some(), "its open motion has not ended"),
            (!self.opened, "its filter has not opened"),
            (!self.swaps.is_empty(), "a swap has not ended"),
            (self.expects_commit && !self.committed_since, "its agent has not requested another motion"),
        ];
        lacks.into_iter().find(|(lacks, _)| *lacks).map(|(_, what)| what)
    }
}

impl Invariant for Liveness {
    fn on(&mut self, line: &JournalLine, _found: &mut FoundViolations<'_>) {
        let healed = self.healed.is_some();
        if !self.robots.values().any(|r| r.ending) {
            self.last = line.at;
        }
        match &line.event {
            Event::State { robot, status: Status::Holding(Hold::ShuttingDown) } => self.of(robot).ending = true,
            Event::Robot { robot, .. } => drop(self.robots.insert(robot.clone(), LivenessWatch::default())),
            Event::Injected { fault } if fault == HEALED => {
                self.healed = Some(line.at);
                self.robots.values_mut().for_each(|r| (r.opened, r.committed_since) = (r.enabled, false));
            }
            // A fault after the healing: no progress can be demanded any more.
            Event::Injected { .. } => self.healed = None,
            Event::GaveUp { .. } => self.gave_up = true,
            Event::Enabled { robot, .. } => {
                let robot = self.of(robot);
                (robot.enabled, robot.opened) = (true, true);
            }
            Event::Disabled { robot, .. } => self.of(robot).enabled = false,
            Event::Commit { robot, id, agent, escape, .. } => {
                let own = *agent == format!("{robot}/agent");
                let robot = self.of(robot);
                if own {
                    (robot.expects_commit, robot.committed_since) = (true, healed);
                }
                robot.open = if healed { robot.open } else { Some((id.0, *escape)) };
            }
            Event::Refused { robot, agent, .. } if *agent == format!("{robot}/agent") => {
                let robot = self.of(robot);
                (robot.expects_commit, robot.committed_since) = (true, healed);
            }
            Event::Outcome { robot, id, .. } => {
                let robot = self.of(robot);
                robot.open = robot.open.filter(|(open, _)| *open != id.0 || robot.ending);
            }
            Event::Swap { robot, part, step } => {
                let robot = self.of(robot);
                if step.is_last() {
                    robot.swaps.remove(part);
                } else {
                    robot.swaps.insert(*part);
                }
            }
            Event::Done { robot, .. } => self.of(robot).expects_commit = false,
            _ => {}
        }
    }

    fn waits(&self) -> bool {
        self.healed.is_none() || self.robots.values().any(|r| r.lacks().is_some())
    }

    fn end(&mut self, found: &mut FoundViolations<'_>) {
        let Some(healed) = self.healed.filter(|_| !self.gave_up) else { return };
        if self.last.since(healed) < PROGRESS_TIMEOUT {
            return;
        }
        for (robot, state) in &self.robots {
            if let Some(what) = state.lacks() {
                found.report(format!("{robot}: {what}, {} s after all faults had healed", PROGRESS_TIMEOUT.as_secs()));
            }
        }
    }
}

impl Liveness {
    fn of(&mut self, robot: &str) -> &mut LivenessWatch {
        self.robots.entry(robot.to_owned()).or_default()
    }
}
