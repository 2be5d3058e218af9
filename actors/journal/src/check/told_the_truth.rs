//! I29: `committed` is reported only for a motion that ended within the tolerance of its target. The built-in
//! agent is notified of the end of its motion once, after the outcome and before it commits again, and the
//! notification matches the outcome.
//!
//! An agent that died, or was replaced while its motion was under way, need not be notified.

use super::{FoundViolations, Invariant};
use crate::journal::JournalLine;
use mobee_contract::distance;
use mobee_contract::{CommitId, Event, MotionEnd, MotorUnits, Outcome, Pose, SwapStep};
use std::collections::BTreeMap;

#[derive(Default)]
pub(super) struct ToldTheTruth {
    agents: BTreeMap<String, AgentMotion>,
    targets: BTreeMap<String, TargetWatch>,
    /// True if the journal records the notifications: older ones don't.
    records_notices: bool,
}

#[derive(Default)]
struct TargetWatch {
    units: MotorUnits,
    tolerance: f64,
    /// Target of the open commit.
    q: Option<Pose>,
}

#[derive(Default)]
struct AgentMotion {
    /// Its last motion, with the outcome if it has one.
    motion: Option<(CommitId, Option<Outcome>)>,
    /// True if the agent that waits for the end of that motion is still the one that committed it.
    waits: bool,
}

impl AgentMotion {
    fn notified(&mut self, id: CommitId, end: MotionEnd) -> Option<String> {
        let number = id.0;
        match self.motion {
            Some((last, Some(outcome))) if last == id => {
                (self.motion, self.waits) = (None, false);
                let truth = if outcome == Outcome::Committed { MotionEnd::Reached } else { MotionEnd::Failed };
                (end != truth)
                    .then(|| format!("was told that commit {number} had {end:?}, and its outcome is {outcome:?}"))
            }
            Some((last, None)) if last == id => {
                Some(format!("was told of the end of commit {number} before its outcome"))
            }
            _ => Some(format!("was told of the end of commit {number}, which is not its last, or a second time")),
        }
    }

    fn commits(&mut self, id: CommitId) -> Option<String> {
        let last = self.motion.replace((id, None));
        let waited = std::mem::replace(&mut self.waits, true);
        let (open, _) = last.filter(|_| waited)?;
        Some(format!("commits again, and was not told how commit {} had ended", open.0))
    }
}

impl ToldTheTruth {
    /// Checks a motion that is reported to have reached its target in this configuration.
    fn reached(&self, robot: &str, q: &Pose) -> Option<String> {
        let target = self.targets.get(robot)?;
        let away = distance(q, target.q.as_ref()?);
        let what = || {
            format!("{robot}: a commit is said to have reached its target {} away from it", target.units.told(away, 3))
        };
        (away > target.tolerance).then(what)
    }

    fn outcome(&mut self, robot: &str, id: CommitId, outcome: Outcome) {
        let motion = self.agents.get_mut(robot).and_then(|agent| agent.motion.as_mut());
        motion.into_iter().filter(|(last, _)| *last == id).for_each(|(_, end)| *end = Some(outcome));
    }

    fn agent(&mut self, robot: &str) -> &mut AgentMotion {
        self.agents.entry(robot.into()).or_default()
    }
}

impl Invariant for ToldTheTruth {
    fn on(&mut self, line: &JournalLine, found: &mut FoundViolations<'_>) {
        let agent = |robot: &str| format!("{robot}/agent");
        let wrong = match &line.event {
            Event::Robot { robot, motors, sliding, tolerance, .. } => {
                let target = self.targets.entry(robot.clone()).or_default();
                target.units = MotorUnits::new(motors.len(), sliding);
                target.tolerance = *tolerance;
                None
            }
            Event::Commit { robot, id, agent: owner, target, .. } => {
                self.targets.entry(robot.clone()).or_default().q = Some(target.clone());
                let wrong = (*owner == agent(robot)).then(|| self.agent(robot).commits(*id)).flatten();
                wrong.filter(|_| self.records_notices).map(|what| format!("{robot}: its agent {what}"))
            }
            Event::Amended { robot, target, .. } => {
                self.targets.entry(robot.clone()).or_default().q = Some(target.clone());
                None
            }
            Event::Outcome { robot, id, outcome, q, .. } => {
                self.outcome(robot, *id, *outcome);
                self.reached(robot, q).filter(|_| *outcome == Outcome::Committed)
            }
            Event::Told { robot, id: Some(id), end } => {
                self.records_notices = true;
                self.agent(robot).notified(*id, *end).map(|what| format!("{robot}: its agent {what}"))
            }
            Event::Told { robot, id: None, end: MotionEnd::Reached } => {
                Some(format!("{robot}: its agent was told that it reached what was refused"))
            }
            Event::Swap { robot, step: SwapStep::Reverted { .. }, .. } => {
                self.agent(robot).waits = false;
                None
            }
            Event::Died { actor, .. } => {
                let died = self.agents.iter_mut().filter(|(robot, _)| *actor == agent(robot));
                died.for_each(|(_, agent)| agent.waits = false);
                None
            }
            Event::Resumed { .. } => {
                self.agents.clear();
                None
            }
            _ => None,
        };
        wrong.into_iter().for_each(|what| found.report(what));
    }
}
