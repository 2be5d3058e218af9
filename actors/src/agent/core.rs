//! The turns between a planner and its motions, without actor or clock.

use mobee_contract::{Agent, Event, Intent, MotionEnd, Refusal, Snapshot, Summary, Target, Verdict, View};
use std::time::Duration;

/// How long to wait before a planner is asked again after a commit that could not be taken now.
const AGAIN: Duration = Duration::from_millis(100);

/// What the agent wants done.
pub enum AgentOut {
    /// Commit this target, as the motion of this number.
    Commit(u64, Target),
    /// Brake.
    Stop,
    /// Ask the planner after this time.
    ThinkIn(Duration),
    /// Look at the world again, in this motion.
    LookAgain(u64),
    /// Keep this state for a successor.
    Keep(Snapshot),
    /// Tell the taps.
    Event(Event),
    /// Nothing more to do.
    Done(Summary),
}

/// The state machine around an [`Agent`].
pub struct AgentCore {
    robot: String,
    agent: Box<dyn Agent>,
    /// Counts motions; news of an earlier one is none.
    motion: u64,
    moving: bool,
    /// How the last motion ended, until the planner has heard it.
    last: Option<MotionEnd>,
    epoch: u64,
    done: bool,
}

impl AgentCore {
    /// A planner that has not been asked yet.
    pub fn new(robot: String, agent: Box<dyn Agent>) -> AgentCore {
        AgentCore { robot, agent, motion: 0, moving: false, last: None, epoch: 0, done: false }
    }

    /// Asks the planner, at rest.
    pub fn think(&mut self, view: &View) -> Vec<AgentOut> {
        if self.moving || self.done {
            return Vec::new();
        }
        let intent = self.agent.next(self.last.take(), view);
        let mut out = self.notes();
        match intent {
            Intent::MoveTo(target) => self.set_out(target, view, &mut out),
            Intent::Stop => out.push(AgentOut::ThinkIn(AGAIN)),
            Intent::Wait(time) => out.push(AgentOut::ThinkIn(time)),
            Intent::Done(summary) => {
                self.done = true;
                out.push(AgentOut::Keep(self.agent.export()));
                out.push(AgentOut::Event(Event::Done { robot: self.robot.clone(), summary: summary.clone() }));
                out.push(AgentOut::Done(summary));
            }
        }
        out
    }

    /// The answer to a commit. What can't be taken now is planned anew a little later; what can never be taken has failed.
    pub fn verdict(&mut self, motion: u64, verdict: Verdict) -> Vec<AgentOut> {
        match verdict {
            _ if motion != self.motion => Vec::new(),
            Ok(_) => Vec::new(),
            Err(refusal) => {
                let later = matches!(
                    refusal,
                    Refusal::Closed | Refusal::NotReady { .. } | Refusal::Holding { .. } | Refusal::Busy
                );
                self.rest((!later).then_some(MotionEnd::Failed), AGAIN)
            }
        }
    }

    /// A motion has ended. If whoever could have told how has died, the planner is asked as at the start.
    pub fn ended(&mut self, motion: u64, end: Option<MotionEnd>, view: &View) -> Vec<AgentOut> {
        if motion != self.motion || !self.moving {
            return Vec::new();
        }
        let Some(end) = end else { return self.rest(None, AGAIN) };
        self.rest(Some(end), Duration::ZERO);
        let mut out = self.think(view);
        out.push(AgentOut::Keep(self.agent.export()));
        out
    }

    /// Shows the planner a changed world in mid-motion.
    pub fn look(&mut self, motion: u64, view: &View) -> Vec<AgentOut> {
        if motion != self.motion || !self.moving {
            return Vec::new();
        }
        let mut out = vec![];
        if view.scene.epoch() != self.epoch {
            self.epoch = view.scene.epoch();
            let intent = self.agent.revise(view);
            out.extend(self.notes());
            match intent {
                Some(Intent::MoveTo(target)) => {
                    self.set_out(target, view, &mut out);
                    return out;
                }
                Some(Intent::Stop | Intent::Wait(_) | Intent::Done(_)) => out.push(AgentOut::Stop),
                None => {}
            }
        }
        out.push(AgentOut::LookAgain(motion));
        out
    }

    fn set_out(&mut self, target: Target, view: &View, out: &mut Vec<AgentOut>) {
        self.motion += 1;
        self.moving = true;
        self.epoch = view.scene.epoch();
        out.push(AgentOut::Commit(self.motion, target));
    }

    fn rest(&mut self, last: Option<MotionEnd>, wait: Duration) -> Vec<AgentOut> {
        self.moving = false;
        self.last = last;
        vec![AgentOut::ThinkIn(wait)]
    }

    fn notes(&mut self) -> Vec<AgentOut> {
        let robot = &self.robot;
        let event = |note| AgentOut::Event(Event::Note { robot: robot.clone(), note });
        self.agent.notes().into_iter().map(event).collect()
    }
}
