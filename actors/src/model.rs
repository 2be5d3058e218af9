//! Model: the hub. One actor for all robots and objects; it completes every pulse with what the robot is near to.
//!
//! Planners never ask it: they read the latest [`Views`] and query the immutable scene in them by themselves.

mod core;
mod views;

pub use views::Views;

use crate::{address::Address, clock::Clock, controller::Rules, pulse::Pulse, stream::Stream};
use crate::{supervision::Child, tap::Taps};
use core::ModelCore;
use mobee_contract::Event;
use mobee_model::{Counters, Edit, SceneError};
use ractor::{Actor, ActorProcessingErr, ActorRef, RpcReplyPort};
use std::sync::Arc;

/// What the model actor is told.
#[derive(Debug)]
pub enum ModelMsg {
    /// There are pulses to pop.
    Bell,
    /// Change the world.
    Edit(Edit, Option<RpcReplyPort<Result<(), SceneError>>>),
    /// How much work the collision watch had.
    Work(RpcReplyPort<Counters>),
}

/// A robot as the model knows it.
#[derive(Clone)]
pub struct ModelRobot {
    /// Its rules.
    pub rules: Arc<Rules>,
    /// Where its pulse goes on.
    pub out: Stream<Pulse>,
}

/// What the model actor is made of; it outlives the actor.
#[derive(Clone)]
pub struct ModelParts {
    /// The robots, in the scene's order.
    pub robots: Vec<ModelRobot>,
    /// Where pulses come from, with the robot's index.
    pub inp: Stream<(usize, Pulse)>,
    /// The latest scene, poses and contacts; its scene is the one that counts, also after a restart.
    pub views: Arc<Views>,
    /// Who is told of edits and poses.
    pub taps: Taps,
    /// The time.
    pub clock: Clock,
    /// Where the actor is reached.
    pub address: Address<ModelMsg>,
}

/// The model actor as a child.
pub fn child(name: &str, parts: ModelParts) -> Child {
    Child::new(name, move |supervisor| {
        let parts = parts.clone();
        async move {
            let (actor, _) =
                Actor::spawn_linked(None, ModelActor, parts, supervisor).await.map_err(|e| e.to_string())?;
            Ok(actor.get_cell())
        }
    })
}

struct ModelActor;

struct State {
    core: ModelCore,
    parts: ModelParts,
}

impl Actor for ModelActor {
    type Msg = ModelMsg;
    type State = State;
    type Arguments = ModelParts;

    async fn pre_start(&self, myself: ActorRef<ModelMsg>, parts: ModelParts) -> Result<State, ActorProcessingErr> {
        let rules: Vec<Arc<Rules>> = parts.robots.iter().map(|r| r.rules.clone()).collect();
        let core = ModelCore::new(parts.views.scene(), parts.views.poses(), &rules);
        parts.address.set(myself.clone());
        parts.inp.attach(Box::new(move || myself.cast(ModelMsg::Bell).is_ok()));
        Ok(State { core, parts })
    }

    async fn handle(
        &self,
        _myself: ActorRef<ModelMsg>,
        message: ModelMsg,
        state: &mut State,
    ) -> Result<(), ActorProcessingErr> {
        let State { core, parts } = state;
        match message {
            ModelMsg::Bell => {
                while let Some((robot, mut pulse)) = parts.inp.pop() {
                    let touching = core.pulse(robot, &mut pulse);
                    let sample = &pulse.sample;
                    parts.views.set_pose(robot, &sample.q);
                    parts.taps.pose(sample.at, robot, &sample.q, &touching);
                    if let Some(r) = parts.robots.get(robot) {
                        r.out.push(pulse);
                    }
                }
            }
            ModelMsg::Edit(edit, reply) => {
                let now = parts.clock.now();
                let answer = core.edit(&edit).map(|scene| {
                    parts.views.set_scene(scene.clone());
                    parts.taps.scene(now, &scene);
                    for event in core::told(&edit, &scene) {
                        parts.taps.event(now, event);
                    }
                });
                match (reply, answer) {
                    (Some(port), answer) => drop(port.send(answer)),
                    (None, Err(e)) => parts.taps.event(now, Event::Warning { text: e.to_string() }),
                    (None, Ok(())) => {}
                }
            }
            ModelMsg::Work(port) => drop(port.send(core.work())),
        }
        Ok(())
    }
}
