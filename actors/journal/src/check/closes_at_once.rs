//! I28: the filter closes at once when the controller loses its robot, through the death of the model or of an
//! actor of the robot's controller, whatever it was doing. An exchange of the controller or driver closes it
//! before the new part is inspected. A restarted driver stops its board before it forwards a command. A stop
//! discards the set-points that are queued at the driver: a later stream begins with its control mode.

use super::{FoundViolations, Invariant};
use crate::journal::JournalLine;
use mobee_contract::{CommandKind, Event, SwapPart, SwapStep, Time, Writer};
use std::collections::BTreeMap;
use std::time::Duration;

/// Most leases until the filter is closed: one expires, the next is not granted.
const LEASES: u32 = 2;
/// The actors of a robot's controller.
const CHAIN: [&str; 4] = ["driver", "history", "supervise", "reflex"];

#[derive(Default)]
pub(super) struct ClosesAtOnce {
    robots: BTreeMap<String, DeathWatch>,
    gave_up: bool,
}

#[derive(Default)]
struct DeathWatch {
    fresh: Duration,
    open: bool,
    /// Time at which the filter last closed.
    /// Time at which an actor of its controller last died.
    closed: Time,
    died: Option<Time>,
    /// Actor that died while the filter was open, and the time; `None` once the filter has closed.
    death: Option<(String, Time)>,
    /// True if its driver was restarted and has not written yet.
    new_driver: bool,
    /// Motors of the last command, if that was a stop of the reflex or an agent; an empty list means all.
    stopped: Option<Vec<usize>>,
}

impl DeathWatch {
    fn judge(&mut self, robot: &str, now: Time, found: &mut FoundViolations<'_>) {
        let within = self.fresh * LEASES;
        if let Some((actor, at)) = self.death.take_if(|(_, at)| now.since(*at) > within) {
            let after = now.since(at).as_secs_f64();
            found.report(format!("{robot}: {actor} died at {at}, and the filter was open {after:.3} s later"));
        }
    }

    /// Takes a written command, or a stream that has just ended.
    fn written(&mut self, robot: &str, event: &Event, found: &mut FoundViolations<'_>) {
        let (writer, kind, motors) = match event {
            Event::Command { writer, kind, motors, .. } => (*writer, Some(*kind), motors),
            Event::Streamed { writer, motors, .. } => (*writer, None, motors),
            _ => return,
        };
        if std::mem::take(&mut self.new_driver) && (writer, kind) != (Writer::Driver, Some(CommandKind::Stop)) {
            let what = kind.map_or("set-points".into(), |kind| format!("a {}", kind.word()));
            found.report(format!("{robot}: a new driver wrote {what} of the {writer:?} before a stop of its own"));
        }
        let stopped = std::mem::take(&mut self.stopped);
        match stopped {
            _ if kind == Some(CommandKind::Stop) && writer != Writer::Driver => self.stopped = Some(motors.clone()),
            Some(stopped) if kind.is_none() => {
                let meant = |m: &usize| stopped.is_empty() || stopped.contains(m);
                if motors.iter().any(meant) {
                    found.report(format!("{robot}: set-points were written after a stop, and no new stream began"));
                }
            }
            _ => {}
        }
    }
}

impl Invariant for ClosesAtOnce {
    fn on(&mut self, line: &JournalLine, found: &mut FoundViolations<'_>) {
        match &line.event {
            Event::Robot { robot, fresh, .. } => {
                self.robots.entry(robot.clone()).or_default().fresh =
                    Duration::try_from_secs_f64(*fresh).unwrap_or_default();
            }
            Event::Enabled { robot, .. } => self.robots.entry(robot.clone()).or_default().open = true,
            Event::Disabled { robot, .. } => {
                let filter = self.robots.entry(robot.clone()).or_default();
                filter.judge(robot, line.at, found);
                if filter.open {
                    filter.closed = line.at;
                }
                (filter.open, filter.death) = (false, None);
            }
            Event::Command { robot, .. } | Event::Streamed { robot, .. } => {
                self.robots.entry(robot.clone()).or_default().written(robot, &line.event, found);
            }
            // The driver commanded a stop, and the board does not answer.
            Event::CommandDropped { robot, writer: Writer::Driver, .. } => {
                self.robots.entry(robot.clone()).or_default().new_driver = false;
            }
            Event::Swap {
                robot,
                part: SwapPart::Controller | SwapPart::Driver,
                step: SwapStep::TookOver { gap, .. },
            } => {
                let filter = self.robots.entry(robot.clone()).or_default();
                let begun = line.at - Duration::try_from_secs_f64(*gap).unwrap_or_default();
                let died = filter.died.is_some_and(|at| at >= begun);
                if (filter.open || filter.closed > begun) && !died {
                    found.report(format!("{robot}: a part was exchanged from {begun} on, and the filter was open"));
                }
            }
            Event::Died { actor, .. } => {
                for (robot, filter) in &mut self.robots {
                    let own = actor.strip_prefix(robot.as_str()).and_then(|rest| rest.strip_prefix('/'));
                    if actor == "model" || own.is_some_and(|part| CHAIN.contains(&part)) {
                        filter.died = Some(line.at);
                        if filter.open {
                            filter.death.get_or_insert((actor.clone(), line.at));
                        }
                    }
                    if own == Some("driver") {
                        (filter.new_driver, filter.stopped) = (true, None);
                    }
                }
            }
            Event::GaveUp { .. } => self.gave_up = true,
            Event::Resumed { .. } => self.robots.values_mut().for_each(|f| (f.open, f.death) = (false, None)),
            _ => {}
        }
        if !self.gave_up && !matches!(line.event, Event::Ended { .. } | Event::Link { .. }) {
            self.robots.iter_mut().for_each(|(robot, filter)| filter.judge(robot, line.at, found));
        }
    }
}
