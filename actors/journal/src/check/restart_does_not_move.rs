//! I10: starting or restarting an actor of a controller causes no commanded motion until the next commit,
//! except the reflex's rollback of the interrupted motion.
//!
//! This concerns driver, history, model, supervise and reflex, named `ROBOT/ACTOR` (or `ACTOR` alone for all
//! robots). The death of an agent or a recorder stops no controller, and the reflex may be retreating then.
//! Stops, modes and references move nothing. A swap causes no motion either: a new part takes over with no
//! transaction open.

use super::{FoundViolations, Invariant};
use crate::journal::JournalLine;
use mobee_contract::{CommandKind, Event, SwapStep, Time};
use std::collections::BTreeMap;

/// The actors of a robot's safety chain.
const CHAIN: [&str; 5] = ["driver", "history", "model", "supervise", "reflex"];

#[derive(Default)]
pub(super) struct RestartDoesNotMove {
    /// Per robot that has committed: the actor that was restarted since its last commit, and the time.
    robots: BTreeMap<String, Option<(String, Time)>>,
}

impl RestartDoesNotMove {
    /// `late` is true if the motion is younger than the given restart.
    fn judge(&self, robot: &str, late: impl Fn(Time) -> bool, found: &mut FoundViolations<'_>) {
        match self.robots.get(robot) {
            None => found.report(format!("{robot}: was moved before its first commit")),
            Some(Some((actor, at))) if late(*at) => {
                found.report(format!(
                    "{robot}: was moved after {actor} was restarted or exchanged at {at}, before a new commit"
                ));
            }
            Some(_) => {}
        }
    }
}

impl Invariant for RestartDoesNotMove {
    fn on(&mut self, line: &JournalLine, found: &mut FoundViolations<'_>) {
        match &line.event {
            Event::Commit { robot, .. } => drop(self.robots.insert(robot.clone(), None)),
            // Recorded before the retreat writes its first command, and only with a transaction open (I2, I9).
            Event::RetreatBegan { robot, .. } => {
                if let Some(restarted) = self.robots.get_mut(robot) {
                    *restarted = None;
                }
            }
            Event::Restarted { actor, .. } => {
                let (robot, name) = actor.rsplit_once('/').map_or((None, actor.as_str()), |(r, n)| (Some(r), n));
                if CHAIN.contains(&name) {
                    let concerned = self.robots.iter_mut().filter(|(r, _)| robot.is_none_or(|robot| robot == *r));
                    concerned.for_each(|(_, restarted)| *restarted = Some((actor.clone(), line.at)));
                }
            }
            Event::Swap { robot, part, step: SwapStep::TookOver { .. } } => {
                if let Some(restarted) = self.robots.get_mut(robot) {
                    *restarted = Some((format!("{robot}/{part}"), line.at));
                }
            }
            Event::Resumed { .. } => {
                let whole = || Some(("the process".to_owned(), line.at));
                self.robots.values_mut().for_each(|restarted| *restarted = whole());
            }
            Event::Command { robot, kind, .. } if *kind == CommandKind::Move => self.judge(robot, |_| true, found),
            // Recorded at its end, and therefore judged by the time of its last set-point.
            Event::Streamed { robot, span, .. } => self.judge(robot, |restart| span.1 > restart, found),
            _ => {}
        }
    }
}
