//! I22: a motion that the reflex or supervise takes back ends `rolled_back`, by a way back that was driven, unless the journal says why
//! not: the way back was given up, an actor died, the filter was closed anew, the run ends.
//!
//! What is taken back: a motion in which a contact begins or a constraint is violated, whose target is missed, or whose agent died. An
//! escape has no way back.

use super::{Found, Invariant};
use crate::journal::Line;
use mobee_contract::{Cause, Event, Hold, Outcome, Status};
use std::collections::BTreeMap;

#[derive(Default)]
pub(super) struct TakenBack {
    robots: BTreeMap<String, Motion>,
    gave_up: bool,
}

#[derive(Default)]
struct Motion {
    /// Whether a motion is open that has a safe pose.
    open: bool,
    /// Why it is to be taken back, in words.
    cause: Option<&'static str>,
    /// Whether a way back was driven.
    driven: bool,
    /// Whether the journal says why it may end otherwise.
    excused: bool,
}

fn in_words(cause: &Cause) -> Option<&'static str> {
    match cause {
        Cause::Contact(_) => Some("a contact"),
        Cause::Constraint { .. } => Some("a constraint"),
        Cause::TargetMissed => Some("a target that was missed"),
        Cause::AgentDied => Some("its agent's death"),
        _ => None,
    }
}

impl Invariant for TakenBack {
    fn on(&mut self, line: &Line, found: &mut Found<'_>) {
        match &line.event {
            Event::Commit { robot, escape, .. } => {
                self.robots.insert(robot.clone(), Motion { open: !escape, ..Motion::default() });
            }
            Event::Disabled { robot, cause, .. } => {
                let motion = self.robots.entry(robot.clone()).or_default();
                // anything else, or a second closing, ends the way back
                motion.excused |= motion.cause.is_some() || in_words(cause).is_none();
                motion.cause = motion.cause.or(in_words(cause));
            }
            Event::RetreatBegan { robot, .. } => self.robots.entry(robot.clone()).or_default().driven = true,
            Event::RetreatStopped { robot, .. }
            | Event::State { robot, status: Status::Holding(Hold::ShuttingDown | Hold::Stale | Hold::Restarted) } => {
                self.robots.entry(robot.clone()).or_default().excused = true;
            }
            Event::Died { actor, .. } if !actor.ends_with("/agent") => self.excuse_all(),
            Event::Resumed { .. } => self.excuse_all(),
            Event::GaveUp { .. } => self.gave_up = true,
            Event::Outcome { robot, id, outcome, .. } => {
                let Some(motion) = self.robots.remove(robot).filter(|m| m.open && !m.excused && !self.gave_up) else {
                    return;
                };
                let Some(cause) = motion.cause else { return };
                if *outcome != Outcome::RolledBack {
                    found
                        .say(format!("{robot}: commit {} was to be taken back for {cause}, and ended otherwise", id.0));
                } else if !motion.driven {
                    found.say(format!("{robot}: commit {} was rolled back for {cause} without a way back", id.0));
                }
            }
            _ => {}
        }
    }
}

impl TakenBack {
    fn excuse_all(&mut self) {
        self.robots.values_mut().for_each(|motion| motion.excused = true);
    }
}
