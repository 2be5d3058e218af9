//! I9: a contact that begins during the retreat stops it within one control period, and no motion is commanded
//! after that. Behind boards, each of which reads its encoders in its own cycle, a second period is allowed: a
//! reading of the whole robot is as old as its oldest part.
//!
//! A pair may get 1 mm closer than its margin, or than at the start of the retreat, because the path is not
//! followed exactly and a pair in near-contact must be able to separate. Where joints deflect, it may get half
//! as close. A pair that is closer when its contact begins, or when it touches, must stop the retreat. The same
//! holds from the sample in which a contact deepened (`RetreatStopped::seen`). After the stop the reflex writes
//! no move and no set-point until a new transaction. A retreat that waits for another robot to clear its path
//! counts as stopped until it continues. So does one that the reflex stops to separate a joint retreat, until
//! it restarts: a thing that is put onto the robot in between is listed as near at the restart.

use super::{FoundViolations, Invariant};
use crate::journal::JournalLine;
use mobee_contract::{CommandKind, Event, Hold, Status, Time, Writer};
use mobee_model::Contact;
use std::collections::BTreeMap;
use std::time::Duration;

/// Distance by which a pair may get closer than its margin, or than at the start, during the retreat, meters.
const DEEPER: f64 = 0.001;

#[derive(Default)]
pub(super) struct WatchedRetreat {
    robots: BTreeMap<String, RetreatWatch>,
    /// Time of the last change of the world: earlier readings can't show its effects.
    changed: Time,
}

#[derive(Default)]
struct RetreatWatch {
    period: Duration,
    /// True if it is behind boards, each of which reads its encoders in its own cycle: a reading of all is as
    /// old as the oldest part.
    has_boards: bool,
    margin: f64,
    /// True if its joints deflect: its sag differs on the way there and on the retreat.
    gives: bool,
    /// Pairs that were closer than the margin at the start of the retreat.
    near: Vec<Contact>,
    retreating: bool,
    /// A retreat is being driven: from its start until it has stopped, or the filter was closed again.
    driven: bool,
    /// Time at which the reflex last stopped it while it was driven.
    halted: Time,
    /// The filter was closed since the last retreat.
    closed: bool,
    /// Start of a contact during the retreat that has not stopped it yet.
    contact: Option<Time>,
    stopped: Option<Time>,
}

impl RetreatWatch {
    fn in_time(&self, from: Time, to: Time) -> bool {
        let parts = if self.has_boards { self.period } else { Duration::ZERO };
        to.since(from) <= self.period + parts
    }

    /// Takes a contact during the retreat, which must stop it if the pair is closer than allowed.
    fn meet(&mut self, contact: &Contact, at: Time) {
        let granted = |least: f64| if self.gives { DEEPER.max(0.5 * least) } else { DEEPER };
        let too_near = match self.near.iter().find(|c| c.pair == contact.pair) {
            Some(start) => {
                let least = start.distance.min(self.margin);
                contact.distance < least - granted(least)
            }
            None => contact.distance < self.margin - granted(self.margin) || contact.distance <= 0.0,
        };
        if too_near && self.driven && self.stopped.is_none() {
            self.contact.get_or_insert(at);
        }
    }

    /// The retreat is over: a violation if a contact should have stopped it and has not.
    fn over(&mut self, robot: &str, found: &mut FoundViolations<'_>) {
        if let Some(at) = self.contact.take() {
            found.report(format!("{robot}: the contact that began at {at} during the retreat did not stop it"));
        }
    }
}

impl Invariant for WatchedRetreat {
    fn on(&mut self, line: &JournalLine, found: &mut FoundViolations<'_>) {
        match &line.event {
            Event::Robot { robot, period, margin, deflection, .. } => {
                let way = self.robots.entry(robot.clone()).or_default();
                way.period = Duration::try_from_secs_f64(*period).unwrap_or_default();
                way.margin = *margin;
                way.gives = *deflection > 0.0;
            }
            Event::Found { robot, .. } => self.robots.entry(robot.clone()).or_default().has_boards = true,
            Event::World { .. } => self.changed = line.at,
            Event::State { robot, status } => {
                self.robots.entry(robot.clone()).or_default().retreating = *status == Status::Retreating;
            }
            Event::RetreatBegan { robot, near, .. } => {
                let way = self.robots.entry(robot.clone()).or_default();
                let halted = way.halted;
                if let Some(at) = way.contact.take().filter(|at| halted < *at || !way.in_time(*at, halted)) {
                    found.report(format!(
                        "{robot}: the contact that began at {at} did not stop the retreat that begins anew"
                    ));
                }
                way.driven = true;
                way.near.clone_from(near);
                if std::mem::take(&mut way.closed) {
                    way.stopped = None;
                }
            }
            // A new closing comes with a stop, and ends any motion under the old token.
            Event::Disabled { robot, .. } => {
                let way = self.robots.entry(robot.clone()).or_default();
                (way.driven, way.closed) = (false, true);
                if let Some(at) = way.contact.take().filter(|at| !way.in_time(*at, line.at)) {
                    found.report(format!(
                        "{robot}: the contact that began at {at} during the retreat did not stop it in time"
                    ));
                }
            }
            Event::ContactBegan { robot, contact, during: Status::Retreating, .. } => {
                self.robots.entry(robot.clone()).or_default().meet(contact, line.at);
            }
            Event::HardContact { robot, contact, .. } => {
                let way = self.robots.entry(robot.clone()).or_default();
                if way.retreating {
                    way.meet(contact, line.at);
                }
            }
            Event::RetreatGoesOn { robot } => self.robots.entry(robot.clone()).or_default().driven = true,
            Event::RetreatStopped { robot, seen, .. } | Event::RetreatWaits { robot, seen, .. } => {
                let way = self.robots.entry(robot.clone()).or_default();
                let reason = if let Event::RetreatStopped { reason, .. } = &line.event {
                    way.stopped = Some(line.at);
                    *reason
                } else {
                    way.driven = false;
                    Hold::RetreatBlocked
                };
                let seen = (reason == Hold::RetreatBlocked).then_some((*seen).max(self.changed));
                if let Some(from) = way.contact.take().into_iter().chain(seen).find(|t| !way.in_time(*t, line.at)) {
                    let took = line.at.since(from).as_secs_f64() * 1e3;
                    found.report(format!("{robot}: a contact during the retreat stopped it after {took:.1} ms only"));
                }
            }
            // The robots of a joint retreat separate: each stops, and restarts with the pairs that are near by
            // then.
            Event::Command { robot, writer: Writer::Reflex, kind: CommandKind::Stop, .. } => {
                let way = self.robots.entry(robot.clone()).or_default();
                if std::mem::take(&mut way.driven) {
                    way.halted = line.at;
                }
            }
            Event::Command { robot, writer: Writer::Reflex, kind, .. } if *kind == CommandKind::Move => {
                let way = self.robots.entry(robot.clone()).or_default();
                if way.stopped.is_some() {
                    found.report(format!("{robot}: the reflex moved on after it had given up the retreat"));
                }
            }
            Event::Streamed { robot, writer: Writer::Reflex, span, .. } => {
                let way = self.robots.entry(robot.clone()).or_default();
                if way.stopped.is_some_and(|stop| span.1 > stop) {
                    found.report(format!("{robot}: the reflex streamed on after it had given up the retreat"));
                }
            }
            Event::Outcome { robot, .. } => self.robots.entry(robot.clone()).or_default().over(robot, found),
            Event::Commit { robot, .. } => {
                let way = self.robots.entry(robot.clone()).or_default();
                way.over(robot, found);
                way.stopped = None;
            }
            _ => {}
        }
    }

    fn end(&mut self, found: &mut FoundViolations<'_>) {
        for (robot, way) in &mut self.robots {
            way.over(robot, found);
        }
    }
}
