//! I23: an edge whose motion failed is removed before its agent commits again, and no other is: so the agent was told how its motion ended.
//!
//! An agent that stopped its own motion, or turned it elsewhere, since what it was after has moved, need not blame the edge: not even if
//! that came too late, and was refused since the filter was closed by then, or may have been lost with a supervise that died. It is told
//! that the motion failed, and not why.
//!
//! Which edge a motion drives is told by the plan, in which its target is a vertex. An agent that died, or makes way for another,
//! was told nothing.

use super::{Found, Invariant};
use crate::record::journal::JournalLine;
use mobee_contract::{Cause, CommitId, EdgeState, Event, Note, Outcome, Refusal, SwapStep};
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// How far the target of a commit may be from its vertex, rad.
const SAME: f64 = 1e-9;

/// From vertex, to vertex.
type Edge = (u32, u32);

#[derive(Default)]
pub(super) struct FailedEdges {
    robots: BTreeMap<String, Walk>,
}

#[derive(Default)]
struct Walk {
    vertices: BTreeMap<u32, Vec<f64>>,
    plan: Vec<u32>,
    /// Whether the agent has committed since it began.
    begun: bool,
    /// The edge that the open motion drives.
    drives: Option<(CommitId, Edge)>,
    /// Whether it wanted, or may have wanted, to stop or to turn that motion, and could not.
    late: bool,
    /// The edge whose motion failed.
    failed: Option<(CommitId, Edge)>,
    /// Whether the agent, or a person, asked for that.
    asked: bool,
}

impl Walk {
    /// The edge of the plan that leads to this target of these motors.
    fn edge(&self, target: &[f64], motors: &[(usize, f64)]) -> Option<Edge> {
        // Of a motor that turns without end the target may be whole turns from the vertex: the same place by a shorter way.
        let same = |a: f64, b: f64| ((a - b) - TAU * ((a - b) / TAU).round()).abs() <= SAME;
        let at =
            |q: &[f64]| motors.iter().all(|(m, _)| q.get(*m).zip(target.get(*m)).is_some_and(|(a, b)| same(*a, *b)));
        let leads = |to: &u32| self.vertices.get(to).is_some_and(|q| at(q));
        let mut edges = self.plan.iter().zip(self.plan.iter().skip(1));
        edges.find(|(_, to)| leads(to)).map(|(from, to)| (*from, *to))
    }

    /// The agent is another one now.
    fn begins(&mut self) {
        (self.begun, self.drives, self.failed) = (false, None, None);
        self.plan.clear();
    }

    fn removed(&mut self, edge: Edge) -> Option<String> {
        let failed = self.failed.take_if(|(_, failed)| *failed == edge).is_some();
        // where the poses of a map are those of the configuration, the journal does not tell what is driven
        if failed || !self.begun || !self.vertices.contains_key(&edge.1) {
            return None;
        }
        Some(format!("the edge {} -> {} was removed, and no motion along it had failed", edge.0, edge.1))
    }
}

impl Invariant for FailedEdges {
    fn on(&mut self, line: &JournalLine, found: &mut Found<'_>) {
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
                let asked = walk.asked;
                walk.failed.take().filter(|_| !asked).map(|(id, (from, to))| {
                    format!("{robot}: the edge {from} -> {to} was not removed, though commit {} failed along it", id.0)
                })
            }
            Event::Refused { robot, agent, refusal: Refusal::Closed | Refusal::Holding { .. } | Refusal::Over }
                if *agent == format!("{robot}/agent") =>
            {
                let walk = self.robots.entry(robot.clone()).or_default();
                walk.late = walk.drives.is_some();
                None
            }
            // turned elsewhere in mid-motion, it does not drive the edge any more
            Event::Amended { robot, id, .. } => {
                let walk = self.robots.entry(robot.clone()).or_default();
                walk.drives.take_if(|(open, _)| open == id);
                None
            }
            Event::Outcome { robot, id, outcome, cause, .. } => {
                let walk = self.robots.entry(robot.clone()).or_default();
                let ended = walk.drives.take_if(|(open, _)| open == id);
                walk.failed = ended.filter(|_| *outcome != Outcome::Committed);
                walk.asked = *cause == Some(Cause::Asked) || std::mem::take(&mut walk.late);
                None
            }
            Event::Swap { robot, step: SwapStep::TookOver { .. } | SwapStep::Reverted { .. }, .. } => {
                self.robots.entry(robot.clone()).or_default().begins();
                None
            }
            Event::Died { actor, .. } => {
                let robot = actor.strip_suffix("/agent").and_then(|robot| self.robots.get_mut(robot));
                robot.into_iter().for_each(Walk::begins);
                let robot = actor.strip_suffix("/supervise").and_then(|robot| self.robots.get_mut(robot));
                robot.into_iter().for_each(|walk| walk.late |= walk.drives.is_some());
                None
            }
            Event::Resumed { .. } => {
                self.robots.values_mut().for_each(Walk::begins);
                None
            }
            _ => None,
        };
        wrong.into_iter().for_each(|what| found.say(what));
    }
}
