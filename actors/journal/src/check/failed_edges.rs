//! I23: an edge whose motion failed is removed before its agent commits again, and no other edge is. This shows
//! that the agent was notified of the end of its motion.
//!
//! An agent that stopped or redirected its own motion, because its goal moved, need not remove the edge. That
//! also holds if the stop or amendment came too late, was refused because the filter had closed, or may have
//! been lost with a supervise that died. The notification states that the motion failed, and not why.
//!
//! The plan determines the edge of a motion: the target of the motion is a vertex of the plan. An agent that
//! died, or that was replaced, received no notification.

use super::{FoundViolations, Invariant};
use crate::journal::JournalLine;
use mobee_contract::{Cause, CommitId, EdgeState, Event, Note, Outcome, Refusal, SwapStep};
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Tolerance between the target of a commit and its vertex, rad.
const SAME: f64 = 1e-9;

/// Start vertex, end vertex.
type VertexPair = (u32, u32);

#[derive(Default)]
pub(super) struct FailedEdges {
    robots: BTreeMap<String, EdgeWalk>,
}

#[derive(Default)]
struct EdgeWalk {
    vertices: BTreeMap<u32, Vec<f64>>,
    plan: Vec<u32>,
    /// True if this agent has committed since it started.
    begun: bool,
    /// The edge that the open motion drives.
    drives: Option<(CommitId, VertexPair)>,
    /// True if the agent tried, or may have tried, to stop or redirect that motion without success.
    late: bool,
    /// The edge whose motion failed.
    failed: Option<(CommitId, VertexPair)>,
    /// True if the agent, or a person, requested that end.
    stop_requested: bool,
}

impl EdgeWalk {
    /// Edge of the plan that leads to this target of these motors.
    fn edge(&self, target: &[f64], motors: &[(usize, f64)]) -> Option<VertexPair> {
        // The target of a continuous joint may differ from the vertex by whole turns: the same place by a
        // shorter path.
        let same = |a: f64, b: f64| ((a - b) - TAU * ((a - b) / TAU).round()).abs() <= SAME;
        let at =
            |q: &[f64]| motors.iter().all(|(m, _)| q.get(*m).zip(target.get(*m)).is_some_and(|(a, b)| same(*a, *b)));
        let leads = |to: &u32| self.vertices.get(to).is_some_and(|q| at(q));
        let mut edges = self.plan.iter().zip(self.plan.iter().skip(1));
        edges.find(|(_, to)| leads(to)).map(|(from, to)| (*from, *to))
    }

    /// The agent was replaced.
    fn begins(&mut self) {
        (self.begun, self.drives, self.failed) = (false, None, None);
        self.plan.clear();
    }

    fn removed(&mut self, edge: VertexPair) -> Option<String> {
        let failed = self.failed.take_if(|(_, failed)| *failed == edge).is_some();
        // Where a map takes its poses from the configuration file, the journal does not show which edge is
        // driven.
        if failed || !self.begun || !self.vertices.contains_key(&edge.1) {
            return None;
        }
        Some(format!("the edge {} -> {} was removed, and no motion along it had failed", edge.0, edge.1))
    }
}

impl Invariant for FailedEdges {
    fn on(&mut self, line: &JournalLine, found: &mut FoundViolations<'_>) {
        let wrong = match &line.event {
            Event::Note { robot, note } => {
                let walk = self.robots.entry(robot.clone()).or_default();
                match note {
                    Note::Vertex { id, q, .. } => {
                        walk.vertices.insert(*id, q.clone());
                        None
                    }
                    Note::Plan { path } => {
                        walk.plan.clone_from(path);
                        None
                    }
                    Note::Edge { from, to, state: EdgeState::Removed, .. } => walk.removed((*from, *to)),
                    _ => None,
                }
                .map(|what| format!("{robot}: {what}"))
            }
            Event::Commit { robot, id, agent, target, motors, .. } if *agent == format!("{robot}/agent") => {
                let walk = self.robots.entry(robot.clone()).or_default();
                walk.begun = true;
                (walk.drives, walk.late) = (walk.edge(target, motors).map(|edge| (*id, edge)), false);
                let stop_requested = walk.stop_requested;
                walk.failed.take().filter(|_| !stop_requested).map(|(id, (from, to))| {
                    format!("{robot}: the edge {from} -> {to} was not removed, though commit {} failed along it", id.0)
                })
            }
            Event::Refused { robot, agent, refusal: Refusal::Closed | Refusal::Holding { .. } | Refusal::Over }
                if *agent == format!("{robot}/agent") =>
            {
                let walk = self.robots.entry(robot.clone()).or_default();
                walk.late = walk.drives.is_some();
                // A stalled agent may redirect its motion after its end, before the notification arrives.
                walk.stop_requested |= matches!(&line.event, Event::Refused { refusal: Refusal::Over, .. });
                None
            }
            // A motion that is redirected no longer drives the edge.
            Event::Amended { robot, id, .. } => {
                let walk = self.robots.entry(robot.clone()).or_default();
                walk.drives.take_if(|(open, _)| open == id);
                None
            }
            Event::Outcome { robot, id, outcome, cause, .. } => {
                let walk = self.robots.entry(robot.clone()).or_default();
                let ended = walk.drives.take_if(|(open, _)| open == id);
                walk.failed = ended.filter(|_| *outcome != Outcome::Committed);
                walk.stop_requested = *cause == Some(Cause::Asked) || std::mem::take(&mut walk.late);
                None
            }
            Event::Swap { robot, step: SwapStep::TookOver { .. } | SwapStep::Reverted { .. }, .. } => {
                self.robots.entry(robot.clone()).or_default().begins();
                None
            }
            Event::Died { actor, .. } => {
                let robot = actor.strip_suffix("/agent").and_then(|robot| self.robots.get_mut(robot));
                robot.into_iter().for_each(EdgeWalk::begins);
                let robot = actor.strip_suffix("/supervise").and_then(|robot| self.robots.get_mut(robot));
                robot.into_iter().for_each(|walk| walk.late |= walk.drives.is_some());
                None
            }
            Event::Resumed { .. } => {
                self.robots.values_mut().for_each(EdgeWalk::begins);
                None
            }
            _ => None,
        };
        wrong.into_iter().for_each(|what| found.report(what));
    }
}
