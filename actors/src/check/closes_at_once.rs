//! I28: what takes the robot out of the controller's hands closes the filter at once: the death of the model or of an actor of the
//! robot's controller, whatever it was doing.

use super::{Found, Invariant};
use crate::journal::Line;
use mobee_contract::{Event, Time};
use std::collections::BTreeMap;
use std::time::Duration;

/// How many leases it may take: one runs out, the next is not given.
const LEASES: u32 = 2;
/// The actors of a robot's controller.
const CHAIN: [&str; 4] = ["driver", "history", "supervise", "reflex"];

#[derive(Default)]
pub(super) struct ClosesAtOnce {
    robots: BTreeMap<String, Filter>,
    gave_up: bool,
}

#[derive(Default)]
struct Filter {
    fresh: Duration,
    open: bool,
    /// Who died, and when, with the filter open since.
    death: Option<(String, Time)>,
}

impl Filter {
    fn judge(&mut self, robot: &str, now: Time, found: &mut Found<'_>) {
        let within = self.fresh * LEASES;
        if let Some((who, at)) = self.death.take_if(|(_, at)| now.since(*at) > within) {
            let after = now.since(at).as_secs_f64();
            found.say(format!("{robot}: {who} died at {at}, and the filter was open {after:.3} s later"));
        }
    }
}

impl Invariant for ClosesAtOnce {
    fn on(&mut self, line: &Line, found: &mut Found<'_>) {
        match &line.event {
            Event::Robot { robot, fresh, .. } => {
                self.robots.entry(robot.clone()).or_default().fresh =
                    Duration::try_from_secs_f64(*fresh).unwrap_or_default();
            }
            Event::Enabled { robot, .. } => self.robots.entry(robot.clone()).or_default().open = true,
            Event::Disabled { robot, .. } => {
                let filter = self.robots.entry(robot.clone()).or_default();
                filter.judge(robot, line.at, found);
                (filter.open, filter.death) = (false, None);
            }
            Event::Died { actor, .. } => {
                for (robot, filter) in &mut self.robots {
                    let own = actor.strip_prefix(robot.as_str()).and_then(|rest| rest.strip_prefix('/'));
                    if filter.open && (actor == "model" || own.is_some_and(|part| CHAIN.contains(&part))) {
                        filter.death.get_or_insert((actor.clone(), line.at));
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
