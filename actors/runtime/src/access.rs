//! Access of a service to the running system: the robots through their filtered interfaces, and the world.

use crate::wiring::{LatestCell, ModelMsg, RobotContext, SharedContext, SuperviseMsg};
use mobee_contract::{
    Answer, Board, Commit, CommitId, DriverFault, Event, Filtered, Hold, Latest, MotionEnd, NativeMessage, NativeState,
    Refusal, Running, Setpoints, Status, Time, Verdict,
};
use mobee_model::{Edit, Robot, Scene};
use ractor::RpcReplyPort;
use std::collections::{BTreeSet, VecDeque};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Most agent names remembered per robot and service. Their motions are cancelled when the service ends.
const NAMES: usize = 64;

/// Access of one life of a service to the run, until it is revoked.
pub struct Access {
    revoked: Arc<AtomicBool>,
    shared: Arc<SharedContext>,
    filters: Vec<Arc<FilterHandle>>,
    robots: Vec<Arc<dyn Filtered>>,
}

impl Access {
    /// Access to all robots of the run.
    pub fn new(shared: &Arc<SharedContext>) -> Access {
        let revoked = Arc::new(AtomicBool::new(false));
        let filters: Vec<Arc<FilterHandle>> = (shared.robots.iter())
            .map(|context| {
                Arc::new(FilterHandle {
                    shared: shared.clone(),
                    revoked: revoked.clone(),
                    context: context.clone(),
                    board: context.parts.lock().board.clone(),
                    names: LatestCell::default(),
                })
            })
            .collect();
        let robots = filters.iter().map(|f| f.clone() as Arc<dyn Filtered>).collect();
        Access { revoked, shared: shared.clone(), filters, robots }
    }

    /// Revokes the access when the service has ended. Open motions of its agents are cancelled as after an
    /// agent's death (I18), and code of the service that still runs can start nothing more.
    pub fn revoke(&self) {
        self.revoked.store(true, Ordering::SeqCst);
        for filter in &self.filters {
            let mut names = filter.names.lock();
            for name in names.drain(..) {
                filter.context.agent_died(name);
            }
        }
    }
}

impl Running for Access {
    fn now(&self) -> Time {
        self.shared.clock.now()
    }

    fn time_of_day(&self, at: Time) -> f64 {
        self.shared.clock.time_of_day(at)
    }

    fn robots(&self) -> &[Arc<dyn Filtered>] {
        &self.robots
    }

    fn models(&self) -> Vec<Arc<Robot>> {
        self.shared.scene.lock().robots().to_vec()
    }

    fn scene(&self) -> Arc<Scene> {
        self.shared.scene.lock().clone()
    }

    fn sleep_until(&self, at: Time) -> Answer<()> {
        let clock = self.shared.clock.clone();
        Box::pin(async move { clock.sleep_until(at).await })
    }

    fn edit(&self, edit: Edit) -> Answer<Result<(), String>> {
        if self.revoked.load(Ordering::SeqCst) {
            return Box::pin(async { Err("the requesting service has ended".into()) });
        }
        let (reply, done) = ractor::concurrency::oneshot();
        self.shared.model.send(ModelMsg::Edit(edit, Some(reply.into())));
        Box::pin(async move { done.await.unwrap_or_else(|_| Err("the model is being restarted; try again".into())) })
    }

    fn tell(&self, event: Event) {
        self.shared.emit(event);
    }
}

/// One robot's filtered interface, as one service uses it.
#[derive(Debug)]
struct FilterHandle {
    shared: Arc<SharedContext>,
    revoked: Arc<AtomicBool>,
    context: Arc<RobotContext>,
    board: Board,
    /// The agents for which the service has sent commits or streams, most recent last.
    names: LatestCell<VecDeque<Arc<str>>>,
}

impl FilterHandle {
    /// Sends a request of one of the service's agents to supervise, and waits for the verdict.
    fn request(
        &self,
        agent: &Arc<str>,
        message: impl FnOnce(RpcReplyPort<Verdict>) -> SuperviseMsg,
    ) -> Answer<Verdict> {
        if *agent == self.context.agent_name {
            let what = format!("{agent} is the name of the robot's own agent");
            return Box::pin(async { Err(Refusal::Malformed { what }) });
        }
        let (reply, verdict) = ractor::concurrency::oneshot();
        {
            // The lock is held until the message is sent: `revoke` then cancels every request sent before it.
            let mut names = self.names.lock();
            if self.revoked.load(Ordering::SeqCst) {
                return Box::pin(async {
                    Err(Refusal::NotReady { missing: "the requesting service, which has ended".into() })
                });
            }
            if names.back() != Some(agent) {
                names.retain(|n| n != agent);
                if names.len() >= NAMES {
                    names.pop_front();
                }
                names.push_back(agent.clone());
            }
            self.context.supervise.send(message(reply.into()));
        }
        let missing = || Refusal::NotReady { missing: "a part of the controller that is being restarted".into() };
        Box::pin(async move { verdict.await.unwrap_or_else(|_| Err(missing())) })
    }
}

impl Filtered for FilterHandle {
    fn name(&self) -> &str {
        &self.context.name
    }

    fn index(&self) -> usize {
        self.context.robot
    }

    fn board(&self) -> &Board {
        &self.board
    }

    fn latest(&self) -> Latest {
        self.context.latest.lock().clone()
    }

    fn commit(&self, commit: Commit) -> Answer<Verdict> {
        let agent = commit.agent.clone();
        self.request(&agent, |reply| SuperviseMsg::Commit(commit, reply))
    }

    fn stream(&self, agent: Arc<str>, setpoints: Setpoints) -> Answer<Verdict> {
        self.request(&agent.clone(), |reply| SuperviseMsg::Stream(agent, setpoints, reply))
    }

    fn stop(&self, agent: Arc<str>) {
        self.context.supervise.send(SuperviseMsg::Stop(agent));
    }

    fn end_of(&self, id: CommitId) -> Option<MotionEnd> {
        self.context.ledger.book().end_of(id)
    }

    fn to_blame(&self, id: CommitId) -> Option<BTreeSet<usize>> {
        let stalled = self.context.ledger.book().stalled_in(id).map(str::to_owned);
        if let Some(motor) = stalled {
            return self.context.rules().axes.iter().position(|axis| axis.name == motor).map(|m| BTreeSet::from([m]));
        }
        let contacts = self.context.ledger.book().contacts_of(id)?.to_vec();
        Some(self.shared.movers(&contacts, self.context.robot))
    }

    fn let_agent_act(&self, act: bool) -> Result<(), Refusal> {
        if self.context.slot.lock().maker.is_none() {
            return Err(Refusal::NotReady { missing: "an agent of the robot's own".into() });
        }
        if self.context.agent_acts.swap(act, Ordering::SeqCst) != act {
            self.shared.emit(Event::AgentActs { robot: self.context.name.clone(), acts: act });
        }
        Ok(())
    }

    fn recover(&self) -> Result<(), String> {
        if self.revoked.load(Ordering::SeqCst) {
            return Err("the requesting service has ended".into());
        }
        if self.context.can_recover.load(Ordering::SeqCst) {
            self.context.supervise.send(SuperviseMsg::Recover);
            return Ok(());
        }
        let Status::Holding(why) = self.context.latest.lock().status else {
            return Err("there is nothing to recover from: the robot does not hold".into());
        };
        let opens = match why {
            Hold::Stale | Hold::Restarted | Hold::BoardFault | Hold::SlowBoard | Hold::Displaced => {
                "its filter opens by itself when that is over"
            }
            Hold::Halted => "`mobee ctl release` lets it act again",
            Hold::ShuttingDown => "start it again with `mobee run --resume`",
            _ => "commit an escape, or clear away what touches it",
        };
        Err(format!("there is no retreat to try again: the robot holds ({why}); {opens}"))
    }

    fn halt(&self) -> Result<(), String> {
        if self.revoked.load(Ordering::SeqCst) {
            return Err("the requesting service has ended".into());
        }
        self.context.halt();
        Ok(())
    }

    fn release(&self) -> Result<(), String> {
        if self.revoked.load(Ordering::SeqCst) {
            return Err("the requesting service has ended".into());
        }
        self.context.release().then_some(()).ok_or_else(|| "it is not halted".into())
    }

    fn is_halted(&self) -> bool {
        self.context.ledger.book().halted
    }

    fn passthrough(&self, part: &str, request: NativeMessage) -> Option<Answer<Result<NativeMessage, DriverFault>>> {
        let plug = self.context.parts.lock().plug.clone();
        plug.0.passthrough(part, request)
    }

    fn native_state(&self, part: &str) -> Option<NativeState> {
        let plug = self.context.parts.lock().plug.clone();
        plug.0.native_state(part)
    }
}
