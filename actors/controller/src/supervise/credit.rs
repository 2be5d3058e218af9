//! Credit: how much of a flood is heard. What is beyond it costs a refusal, and no line in the journal.
//!
//! A token bucket: an agent that commits in an endless loop must neither starve the readings nor fill the disk (I7),
//! and a burst of a program that moves each motor by itself must pass.

use super::{Step, SuperviseCore, SuperviseOut};
use mobee_contract::{Credit, Event, SILENCE, Time, Verdict};
use std::sync::Arc;
use std::time::Duration;

/// What comes back in a second: more commands than any program needs that moves its motors one by one.
const PER_SECOND: f64 = 250.0;
/// The most that may be used at once: two seconds' worth, for a program that was held up and catches up.
const MOST: f64 = 500.0;
/// How often those refusals are summed up that were not told one by one.
const SUM_UP: Duration = Duration::from_secs(1);

/// What may still come to one robot.
#[derive(Clone, Debug)]
pub(super) struct Credits {
    /// Commits that may be taken.
    pub(super) commits: Credit,
    /// Refusals that may be told one by one.
    telling: Credit,
    /// Refusals that were not told.
    untold: Untold,
    /// The set-points that are being refused.
    bursts: Vec<Burst>,
}

/// How many refusals were not told, and since when.
#[derive(Clone, Copy, Debug)]
struct Untold {
    /// How many.
    count: u64,
    /// When they were last summed up.
    since: Time,
}

/// Set-points of one agent that are refused for one reason, without a silence between them.
#[derive(Clone, Debug)]
struct Burst {
    /// Who streams.
    agent: Arc<str>,
    /// Why it is refused, as [`mobee_contract::Refusal::code`] has it.
    code: &'static str,
    /// When the last of them came.
    last: Time,
}

impl Credits {
    /// All of it: nobody has used any yet.
    pub(super) fn full(now: Time) -> Credits {
        let all = Credit::full(now, PER_SECOND, MOST);
        Credits { commits: all, telling: all, untold: Untold { count: 0, since: now }, bursts: Vec::new() }
    }
}

impl SuperviseCore {
    /// Puts the verdict on a commit first, and tells of a refusal. First, since the agent waits for it: what follows
    /// from the commit is for others.
    pub(super) fn answer(&mut self, agent: &str, verdict: Verdict, step: &mut Step) {
        self.tell_refusal(agent, &verdict, step);
        step.out.insert(0, SuperviseOut::Verdict(verdict));
    }

    /// The same of set-points, which come in bursts: of those that are refused for one reason without a silence between
    /// them the first is told.
    pub(super) fn answer_setpoints(&mut self, agent: &Arc<str>, verdict: Verdict, step: &mut Step) {
        if let Err(refusal) = &verdict {
            let bursts = &mut self.credits.bursts;
            bursts.retain(|burst| step.now < burst.last + SILENCE);
            match bursts.iter_mut().find(|burst| burst.agent == *agent && burst.code == refusal.code()) {
                Some(burst) => burst.last = step.now,
                None => {
                    bursts.push(Burst { agent: agent.clone(), code: refusal.code(), last: step.now });
                    self.tell_refusal(agent, &verdict, step);
                }
            }
        }
        step.out.insert(0, SuperviseOut::Verdict(verdict));
    }

    /// A line in the journal for a refusal, while there is credit for lines; else it is counted.
    pub(super) fn tell_refusal(&mut self, agent: &str, verdict: &Verdict, step: &mut Step) {
        if let Err(refusal) = verdict {
            if self.credits.telling.take(step.now) {
                let (robot, agent, refusal) = (step.robot(), agent.to_string(), refusal.clone());
                step.emit(Event::Refused { robot, agent, refusal });
            } else {
                self.credits.untold.count += 1;
            }
        }
    }

    /// Tells how many refusals there were besides those that were told.
    pub(super) fn sum_up(&mut self, step: &mut Step) {
        let Untold { count, since } = self.credits.untold;
        if count > 0 && step.now >= since + SUM_UP {
            self.credits.untold = Untold { count: 0, since: step.now };
            let text = format!("{}: {count} more commands were refused; they come too quickly", step.rules.robot);
            step.emit(Event::Warning { text });
        }
    }
}
