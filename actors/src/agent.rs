//! Agent: the shell around somebody's planner. It commits what the planner wants, and tells it how that ended.
//!
//! It never hears from the controller but by the answer to its own commands, as in the paper.

mod core;

use crate::{address::Address, clock::Clock, model::Views, supervise::SuperviseMsg, supervision::Child, tap::Taps};
use core::{AgentCore, AgentOut};
use mobee_contract::{Agent, Axis, Commit, KindError, MotionEnd, Snapshot, Summary, Verdict, View};
use ractor::{Actor, ActorProcessingErr, ActorRef, RpcReplyPort};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::sync::oneshot;

/// How often an agent in motion looks whether the world has changed.
const LOOK: Duration = Duration::from_millis(100);

/// Builds an agent, at the start and after each of its deaths.
pub type AgentFactory = Arc<dyn Fn() -> Result<Box<dyn Agent>, KindError> + Send + Sync>;

/// What the agent actor is told. Motions are numbered, so that news of an earlier one is known as such.
#[derive(Debug)]
pub enum AgentMsg {
    /// Time to ask the planner.
    Think,
    /// The answer to a commit.
    Verdict(u64, Verdict),
    /// The motion has ended; `None`: whoever could have told has died.
    Ended(u64, Option<MotionEnd>),
    /// Time to look at the world, in this motion.
    Look(u64),
}

/// What an agent actor is made of; it outlives the actor.
#[derive(Clone)]
pub struct AgentParts {
    /// Its robot, an index into the scene's robots.
    pub robot: usize,
    /// The robot's name.
    pub robot_name: String,
    /// The agent's name, as the filtered interface knows it.
    pub name: Arc<str>,
    /// Builds the planner.
    pub factory: AgentFactory,
    /// What it sees.
    pub views: Arc<Views>,
    /// The robot's board.
    pub axes: Arc<[Axis]>,
    /// The distance that plans keep, metres.
    pub clearance: f64,
    /// The filtered interface.
    pub supervise: Address<SuperviseMsg>,
    /// Who is told of notes.
    pub taps: Taps,
    /// The time.
    pub clock: Clock,
    /// The planner's state after its last motion, for its successor.
    pub snapshot: Arc<Mutex<Option<Snapshot>>>,
    /// Called when the planner has nothing more to do.
    pub on_done: Arc<dyn Fn(Summary) + Send + Sync>,
}

impl AgentParts {
    fn view(&self) -> View {
        self.views.view(self.robot, self.clock.now(), self.axes.clone(), self.clearance)
    }
}

/// An agent actor as a child of its own group.
pub fn child(parts: AgentParts) -> Child {
    Child::new(parts.name.clone(), move |supervisor| {
        let parts = parts.clone();
        async move {
            let (actor, _) =
                Actor::spawn_linked(None, AgentActor, parts, supervisor).await.map_err(|e| e.to_string())?;
            Ok(actor.get_cell())
        }
    })
}

struct AgentActor;

struct State {
    core: AgentCore,
    parts: AgentParts,
}

impl Actor for AgentActor {
    type Msg = AgentMsg;
    type State = State;
    type Arguments = AgentParts;

    async fn pre_start(&self, myself: ActorRef<AgentMsg>, parts: AgentParts) -> Result<State, ActorProcessingErr> {
        let mut agent = (parts.factory)()?;
        if let Some(snapshot) = parts.snapshot.lock().unwrap_or_else(PoisonError::into_inner).clone() {
            agent.import(snapshot)?;
        }
        myself.cast(AgentMsg::Think)?;
        Ok(State { core: AgentCore::new(parts.robot_name.clone(), agent), parts })
    }

    async fn handle(
        &self,
        myself: ActorRef<AgentMsg>,
        message: AgentMsg,
        state: &mut State,
    ) -> Result<(), ActorProcessingErr> {
        let parts = &state.parts;
        let out = match message {
            AgentMsg::Think => state.core.think(&parts.view()),
            AgentMsg::Verdict(motion, verdict) => state.core.verdict(motion, verdict),
            AgentMsg::Ended(motion, end) => state.core.ended(motion, end, &parts.view()),
            AgentMsg::Look(motion) => state.core.look(motion, &parts.view()),
        };
        for o in out {
            match o {
                AgentOut::Commit(motion, target) => {
                    let commit = Commit { agent: parts.name.clone(), target };
                    myself.send_after(LOOK, move || AgentMsg::Look(motion));
                    send(&myself, &parts.supervise, motion, commit);
                }
                AgentOut::Stop => {
                    parts.supervise.send(SuperviseMsg::StopMotion { agent: parts.name.clone() });
                }
                AgentOut::ThinkIn(wait) => {
                    myself.send_after(wait, || AgentMsg::Think);
                }
                AgentOut::LookAgain(motion) => {
                    myself.send_after(LOOK, move || AgentMsg::Look(motion));
                }
                AgentOut::Keep(snapshot) => {
                    *parts.snapshot.lock().unwrap_or_else(PoisonError::into_inner) = Some(snapshot);
                }
                AgentOut::Event(event) => parts.taps.event(parts.clock.now(), event),
                AgentOut::Done(summary) => (parts.on_done)(summary),
            }
        }
        Ok(())
    }
}

/// Sends a commit, and brings its answers back as messages: the handler itself waits for nothing.
fn send(myself: &ActorRef<AgentMsg>, supervise: &Address<SuperviseMsg>, motion: u64, commit: Commit) {
    let (verdict, answer) = oneshot::channel();
    let (end, ended) = oneshot::channel();
    let verdict = RpcReplyPort::from(verdict);
    supervise.send(SuperviseMsg::Commit { commit, verdict, end });
    let myself = myself.clone();
    tokio::spawn(async move {
        let Ok(verdict) = answer.await else {
            let _ = myself.cast(AgentMsg::Ended(motion, None));
            return;
        };
        let accepted = verdict.is_ok();
        let _ = myself.cast(AgentMsg::Verdict(motion, verdict));
        if accepted {
            let _ = myself.cast(AgentMsg::Ended(motion, ended.await.ok()));
        }
    });
}
