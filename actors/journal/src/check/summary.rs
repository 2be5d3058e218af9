//! Key figures of a run, from its journal.

use super::touches::Touches;
use crate::journal::{JournalError, read};
use mobee_contract::{Cause, EdgeState, Event, Note, Outcome, Summary, SwapStep, Time};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Counts over all robots of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RunSummary {
    /// Seed of the run.
    pub seed: Option<u64>,
    /// `virtual` or `real`.
    pub clock: String,
    /// Names of the robots.
    pub robots: Vec<String>,
    /// Duration on the run's clock, s.
    pub secs: f64,
    /// Number of events in the journal.
    pub events: u64,
    /// Final hash of the journal.
    pub hash: String,
    /// Reason for which the run ended, if it ended in order.
    pub ended: Option<String>,
    /// Place at which the journal stops in mid-line, if it does.
    pub truncated: Option<String>,
    /// Accepted commits, escapes included.
    pub commits: u64,
    /// Accepted escapes from a hold.
    pub escapes: u64,
    /// Refused commits, by the code of the refusal.
    pub refused: BTreeMap<String, u64>,
    /// Motions that reached their target.
    pub committed: u64,
    /// Motions that were rolled back to the safe pose.
    pub rolled_back: u64,
    /// Motions that neither reached their target nor were rolled back.
    pub faulted: u64,
    /// Motions that faulted because a person, a program or the end of the run stopped them.
    pub stopped: u64,
    /// Contacts below the margin.
    pub contacts: u64,
    /// Hard contacts: episodes in which a robot touched another, an object or itself, however many of their
    /// shapes met.
    pub hard_contacts: u64,
    /// Greatest penetration depth of these, mm.
    pub hard_contact_depth_mm: f64,
    /// Retreats that were aborted.
    pub retreats_stopped: u64,
    /// Safe poses that moved in mid-motion.
    pub safe_poses_moved: u64,
    /// Vertices of all maps.
    pub vertices: u64,
    /// Directed edges of all maps by their last state.
    pub edges: BTreeMap<EdgeState, u64>,
    /// Restarts of actors.
    pub restarts: u64,
    /// Deaths of actors.
    pub deaths: u64,
    /// Parts that were replaced while the robot ran.
    pub swaps: u64,
    /// Of these, parts that failed on probation.
    pub swaps_reverted: u64,
    /// New parts that were rejected.
    pub swaps_refused: u64,
    /// Supervision groups that used up their restarts.
    pub gave_up: Vec<String>,
    /// Edits of the world.
    pub world_edits: u64,
    /// Faults that were injected.
    pub injected: u64,
    /// Commands that were discarded on their way to a driver.
    pub commands_dropped: u64,
    /// Texts of the warnings.
    pub warnings: Vec<String>,
    /// Final reports of the agents, by robot.
    pub done: Vec<(String, Summary)>,
}

/// Counts the events of a run's journal (its file, or its run's folder), and verifies its chain.
///
/// # Errors
/// As for [`super::check`].
pub fn summary(path: &Path) -> Result<RunSummary, JournalError> {
    let mut s = RunSummary::default();
    let mut edges = BTreeMap::new();
    let mut vertices = BTreeMap::new();
    let mut touches = Touches::default();
    for line in read(path)? {
        let line = match line {
            Ok(line) => line,
            Err(e) if e.truncated => {
                s.truncated = Some(e.to_string());
                break;
            }
            Err(e) => return Err(e),
        };
        s.events += 1;
        s.secs = line.at.since(Time::ZERO).as_secs_f64();
        s.hash = line.hash;
        touches.note(&line.event);
        match line.event {
            Event::Note { robot, note: Note::Vertex { id, q, .. } } => {
                let before = vertices.insert((robot.clone(), id), q.clone());
                if before.is_some_and(|before| before != q) {
                    // It is another vertex now, whose edges are recorded again.
                    edges.retain(|(r, from, to), _| *r != robot || (*from != id && *to != id));
                }
            }
            Event::Note { robot, note: Note::Edge { from, to, state, .. } } => {
                edges.insert((robot, from, to), state);
            }
            other => s.count(other),
        }
    }
    (s.hard_contacts, s.hard_contact_depth_mm) = (touches.episodes, touches.depth * 1e3);
    s.vertices = vertices.len() as u64;
    for state in edges.into_values() {
        *s.edges.entry(state).or_default() += 1;
    }
    Ok(s)
}

impl RunSummary {
    fn count(&mut self, event: Event) {
        match event {
            Event::Started { seed, clock, .. } => (self.seed, self.clock) = (Some(seed), clock),
            Event::Robot { robot, .. } if !self.robots.contains(&robot) => self.robots.push(robot),
            Event::SafePoseMoved { .. } => self.safe_poses_moved += 1,
            Event::Commit { escape, .. } => {
                self.commits += 1;
                self.escapes += u64::from(escape);
            }
            Event::Refused { refusal, .. } => *self.refused.entry(refusal.code().into()).or_default() += 1,
            Event::Outcome { outcome: Outcome::Committed, .. } => self.committed += 1,
            Event::Outcome { outcome: Outcome::RolledBack, .. } => self.rolled_back += 1,
            Event::Outcome { outcome: Outcome::Faulted, cause: Some(Cause::Asked), .. } => self.stopped += 1,
            Event::Outcome { outcome: Outcome::Faulted, .. } => self.faulted += 1,
            Event::CommandDropped { .. } => self.commands_dropped += 1,
            Event::ContactBegan { .. } => self.contacts += 1,
            Event::RetreatStopped { .. } => self.retreats_stopped += 1,
            Event::World { .. } => self.world_edits += 1,
            Event::Done { robot, summary } => self.done.push((robot, summary)),
            Event::Died { .. } => self.deaths += 1,
            Event::Swap { step, .. } | Event::SwapBeside { step, .. } => match step {
                SwapStep::TookOver { .. } => self.swaps += 1,
                SwapStep::Reverted { .. } => self.swaps_reverted += 1,
                SwapStep::Refused { .. } => self.swaps_refused += 1,
                SwapStep::Offered { .. } | SwapStep::Settled => {}
            },
            Event::Restarted { .. } => self.restarts += 1,
            Event::GaveUp { group } => self.gave_up.push(group),
            Event::Injected { .. } => self.injected += 1,
            Event::Warning { text } => self.warnings.push(text),
            Event::Ended { reason } => self.ended = Some(reason),
            _ => {}
        }
    }
}
