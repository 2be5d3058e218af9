//! Credit: the accepted rate of commits and journaled refusals. Beyond it, a commit is refused without a line in the
//! journal.
//!
//! A token bucket: an agent that commits in an endless loop must neither starve the readings nor fill the disk (I7),
//! and a burst of a program that moves each motor separately must pass.

use super::{SuperviseCore, SuperviseOut, SuperviseStep};
use mobee_contract::{Credit, Event, SILENCE, Time, Verdict};
use std::sync::Arc;
use std::time::Duration;

/// Credit per second: more commands than any program needs that moves its motors one by one.
const COMMITS_PER_SECOND: f64 = 250.0;
/// Greatest burst: the credit of two seconds, for a program that catches up after a delay.
const MAX_BURST: f64 = 500.0;
/// Interval between summaries of the refusals that were not journaled one by one.
const SUMMARY_INTERVAL: Duration = Duration::from_secs(1);

/// Remaining credit of one robot.
#[derive(Clone, Debug)]
pub(super) struct Credits {
    /// Commits that may be accepted.
    pub(super) commits: Credit,
    /// Refusals that may be journaled one by one.
    reports: Credit,
    /// Refusals that were not journaled.
    unreported: Unreported,
    /// Bursts of set-points that are being refused.
    bursts: Vec<Burst>,
}

/// Number of refusals that were not journaled, and the time since which they are counted.
#[derive(Clone, Copy, Debug)]
struct Unreported {
    /// Number of refusals.
    count: u64,
    /// Time of the last summary.
    since: Time,
}

/// Set-points of one agent that are refused for one reason, without a silence between them.
#[derive(Clone, Debug)]
struct Burst {
    /// Streaming agent.
    agent: Arc<str>,
    /// Reason of the refusal, as returned by [`mobee_contract::Refusal::code`].
    code: &'static str,
    /// Time of the last set-point.
    last: Time,
}

impl Credits {
    /// Full credit.
    pub(super) fn full(now: Time) -> Credits {
        let all = Credit::full(now, COMMITS_PER_SECOND, MAX_BURST);
        let unreported = Unreported { count: 0, since: now };
        Credits { commits: all, reports: all, unreported, bursts: Vec::new() }
    }
}

impl SuperviseCore {
    /// Puts the verdict on a commit in front of the step's actions, since the agent waits for it; journals a refusal.
    pub(super) fn answer(&mut self, agent: &str, verdict: Verdict, step: &mut SuperviseStep) {
        self.report_refusal(agent, &verdict, step);
        step.out.insert(0, SuperviseOut::Verdict(verdict));
    }

    /// Answers set-points, which arrive in bursts: if several are refused for one reason without a silence between
    /// them, only the first is journaled.
    pub(super) fn answer_setpoints(&mut self, agent: &Arc<str>, verdict: Verdict, step: &mut SuperviseStep) {
        if let Err(refusal) = &verdict {
            let bursts = &mut self.credits.bursts;
            bursts.retain(|burst| step.now < burst.last + SILENCE);
            match bursts.iter_mut().find(|burst| burst.agent == *agent && burst.code == refusal.code()) {
                Some(burst) => burst.last = step.now,
                None => {
                    bursts.push(Burst { agent: agent.clone(), code: refusal.code(), last: step.now });
                    self.report_refusal(agent, &verdict, step);
                }
            }
        }
        step.out.insert(0, SuperviseOut::Verdict(verdict));
    }

    /// Journals a refusal, if there is credit; else counts it.
    pub(super) fn report_refusal(&mut self, agent: &str, verdict: &Verdict, step: &mut SuperviseStep) {
        if let Err(refusal) = verdict {
            if self.credits.reports.take(step.now) {
                let robot = step.robot();
                let agent = agent.to_string();
                step.emit(Event::Refused { robot, agent, refusal: refusal.clone() });
            } else {
                self.credits.unreported.count += 1;
            }
        }
    }

    /// Warns of the number of refusals that were not journaled.
    pub(super) fn summarize_refusals(&mut self, step: &mut SuperviseStep) {
        let Unreported { count, since } = self.credits.unreported;
        if count > 0 && step.now >= since + SUMMARY_INTERVAL {
            self.credits.unreported = Unreported { count: 0, since: step.now };
            let text = format!("{}: {count} more commands were refused; they come too quickly", step.rules.robot);
            step.emit(Event::Warning { text });
        }
    }
}
