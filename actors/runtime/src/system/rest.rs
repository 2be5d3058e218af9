//! The planned motion at the end of a run: each robot with a rest pose is moved there, one robot after another, as an ordinary transaction
//! under the reflex.

use super::RestSetup;
use crate::access::Access;
use crate::attempt::{Timed, attempt};
use crate::wiring::{AgentMsg, RobotContext, SharedContext, SuperviseMsg};
use mobee_contract::{
    Agent, Commit, CommitId, Event, Filtered, Intent, MotionEnd, Refusal, RestStep, Running, Status, Target, Time,
};
use std::sync::Arc;
use std::time::Duration;

/// Interval of the checks whether the robot is at rest.
const TICK: Duration = Duration::from_millis(20);
/// Pause before a refused commit is tried again.
const RETRY_PAUSE: Duration = Duration::from_millis(100);
/// Time for which a robot may hold, or give no readings, before the motion is aborted: it will not move without
/// intervention.
const HOLD_TIMEOUT: Duration = Duration::from_secs(3);

/// Moves all robots to their rest poses. The robots' own agents make no more motions.
pub(super) async fn move_to_rest(shared: &Arc<SharedContext>, rests: &[Option<RestSetup>]) {
    for context in &shared.robots {
        context.agent.send(AgentMsg::Rest);
        context.supervise.send(SuperviseMsg::Stop(context.agent_name.clone()));
    }
    let access = Access::new(shared);
    for ((context, rest), filtered) in shared.robots.iter().zip(rests).zip(access.robots()) {
        let Some(rest) = rest else { continue };
        emit(shared, context, RestStep::Begun);
        let motion = RestMotion {
            shared,
            context,
            filtered: filtered.as_ref(),
            name: format!("{}/rest", context.name).into(),
            begun: shared.clock.now(),
            until: shared.clock.now() + rest.within,
            within: rest.within,
        };
        let step = match motion.run(rest).await {
            Ok(()) => RestStep::Reached,
            Err(why) => RestStep::Missed { why },
        };
        filtered.stop(motion.name.clone());
        emit(shared, context, step);
    }
}

/// Reports the rest pose as missed for every robot whose motion to it has not ended.
pub(super) fn give_up(shared: &SharedContext, rests: &[Option<RestSetup>], why: &str) {
    for (context, _) in shared.robots.iter().zip(rests).filter(|(_, rest)| rest.is_some()) {
        let step = shared.counts.lock().rest.get(&context.name).cloned();
        if matches!(step, None | Some(RestStep::Begun)) {
            emit(shared, context, RestStep::Missed { why: why.to_owned() });
        }
    }
}

fn emit(shared: &SharedContext, context: &RobotContext, step: RestStep) {
    shared.emit(Event::Rest { robot: context.name.clone(), step });
}

/// The motion of one robot.
struct RestMotion<'a> {
    shared: &'a Arc<SharedContext>,
    context: &'a Arc<RobotContext>,
    filtered: &'a dyn Filtered,
    /// Name under which it commits.
    name: Arc<str>,
    begun: Time,
    until: Time,
    within: Duration,
}

impl RestMotion<'_> {
    /// Plans and commits until the robot is at its rest pose.
    ///
    /// # Errors
    /// The reason why it is not.
    async fn run(&self, rest: &RestSetup) -> Result<(), String> {
        let mut agent = (rest.maker)()?;
        let mut last = None;
        let mut held_since = None;
        loop {
            self.settle().await?;
            let (returned, intent) = self.next(agent, last.take()).await?;
            agent = returned;
            let verdict = match intent {
                Intent::MoveTo(target) => self.commit(target, None).await,
                Intent::MoveEach(target, speeds) => self.commit(target, Some(speeds)).await,
                Intent::Wait(time) => {
                    self.pause(time).await;
                    continue;
                }
                Intent::Stream(_) | Intent::Stop => {
                    self.pause(RETRY_PAUSE).await;
                    continue;
                }
                Intent::Done(summary) => {
                    let reached = summary.figures.iter().any(|(name, n)| name == RestSetup::REACHED && *n > 0.0);
                    return if reached { Ok(()) } else { Err(summary.text) };
                }
            };
            match verdict {
                Ok(id) => {
                    held_since = None;
                    last = Some(self.end_of(id).await?);
                }
                Err(refusal @ Refusal::Holding { .. }) => {
                    let now = self.shared.clock.now();
                    if now > *held_since.get_or_insert(now) + HOLD_TIMEOUT {
                        return Err(refusal.to_string());
                    }
                    self.pause(RETRY_PAUSE).await;
                }
                Err(Refusal::Closed | Refusal::Busy | Refusal::NotReady { .. } | Refusal::Pushing) => {
                    // The robot's own agent may have committed after the request to stop.
                    self.context.supervise.send(SuperviseMsg::Stop(self.context.agent_name.clone()));
                    self.pause(RETRY_PAUSE).await;
                }
                Err(_) => {
                    last = Some(MotionEnd::Failed);
                    self.pause(RETRY_PAUSE).await;
                }
            }
        }
    }

    /// Waits until the robot is at rest and every outcome is given.
    async fn settle(&self) -> Result<(), String> {
        let mut held_since = None;
        loop {
            if self.filtered.is_halted() {
                return Err("it is halted".into());
            }
            let latest = self.filtered.latest();
            if latest.ready {
                return Ok(());
            }
            let now = self.shared.clock.now();
            match latest.status {
                Status::Holding(hold) if now > *held_since.get_or_insert(now) + HOLD_TIMEOUT => {
                    return Err(format!("it holds: {hold}"));
                }
                Status::Holding(_) => {}
                _ => held_since = None,
            }
            self.in_time()?;
            self.pause(TICK).await;
        }
    }

    /// Waits for the end of a motion.
    async fn end_of(&self, id: CommitId) -> Result<MotionEnd, String> {
        loop {
            if let Some(end) = self.filtered.end_of(id) {
                return Ok(end);
            }
            self.in_time()?;
            self.pause(TICK).await;
        }
    }

    /// Requests the next intent from the planner; returns the planner with it.
    async fn next(
        &self,
        mut agent: Box<dyn Agent>,
        last: Option<MotionEnd>,
    ) -> Result<(Box<dyn Agent>, Intent), String> {
        self.in_time()?;
        let view = self.shared.view(self.context);
        let left = self.until.since(self.shared.clock.now());
        let call = move || {
            let intent = agent.next(last, &view);
            Timed { value: (agent, intent), cost: Duration::ZERO }
        };
        attempt(&self.shared.clock, left, call).await.map_err(|why| format!("its planner failed: {why}"))
    }

    async fn commit(&self, target: Target, speeds: Option<Vec<f64>>) -> Result<CommitId, Refusal> {
        self.filtered.commit(Commit { agent: self.name.clone(), target, speeds }).await
    }

    /// Error if the time is over, or no readings arrive.
    fn in_time(&self) -> Result<(), String> {
        let latest = self.filtered.latest();
        let now = self.shared.clock.now();
        if now > latest.at.max(self.begun) + HOLD_TIMEOUT {
            return Err("no readings come from it".into());
        }
        if now < self.until {
            return Ok(());
        }
        let state = match latest.status {
            Status::Holding(hold) => format!("it holds: {hold}"),
            Status::Retreating => "it was retreating".into(),
            Status::Moving | Status::Escaping => "it was still moving".into(),
            _ => "its last plan was not carried out".into(),
        };
        Err(format!("{} s were not enough; {state}", self.within.as_secs_f64()))
    }

    async fn pause(&self, time: Duration) {
        let left = self.until.since(self.shared.clock.now());
        self.shared.clock.sleep(time.min(left).max(Duration::from_millis(1))).await;
    }
}
