//! Faults that a whole-system simulation injects into a run, besides those of its hardware: see `mobee
//! torture`.

use crate::wiring::{Blow, ModelMsg, RobotContext, SharedContext, SuperviseMsg, Troubles};
use mobee_contract::{Commit, Event, Pose};
use mobee_model::{Edit, Object, ObjectClass, Primitive, Shape};
use nalgebra::{Isometry3, Translation3};
use std::sync::Arc;
use std::time::Duration;

/// A fault, or the moment at which all faults heal.
#[derive(Clone, Debug, PartialEq)]
pub enum Injection {
    /// An actor's handler fails at its `after`-th message from now on (0: the next).
    Strike {
        /// The actor, such as `icub/reflex` or `model`.
        actor: String,
        /// Number of messages that it handles before.
        after: u64,
        /// Kind of the failure.
        blow: Blow,
    },
    /// The next pulses on a link are lost, and counted as dropped.
    Lose {
        /// The link, such as `icub/model>reflex`.
        link: String,
        /// Number of pulses.
        count: u64,
    },
    /// Another client commits to a robot, `times` times at once, without waiting for the replies.
    Commit {
        /// The robot.
        robot: String,
        /// The commit.
        commit: Commit,
        /// Number of commits.
        times: u64,
    },
    /// An obstacle appears at a body of a robot, or at a place on its path.
    Obstruct {
        /// The obstacle's name.
        object: String,
        /// The robot.
        robot: String,
        /// Place of the obstacle.
        spot: Spot,
    },
    /// The whole process is suspended: time passes, and no actor runs. In virtual time only.
    Suspend(Duration),
    /// All faults have healed: from now on progress is demanded (I15).
    Heal,
}

/// A place on a robot's path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// True for the path to the safe pose of the open motion, false for the path to its target.
    pub back: bool,
    /// Position on that path, from 0 (the present configuration) to 1.
    pub share: f64,
    /// Body among the robot's movable ones, from 0 (nearest to the base) to 1 (the farthest).
    pub body: f64,
    /// Radius of the obstacle, meters.
    pub radius: f64,
}

/// Injects a fault into the running system.
pub(super) async fn inject(injection: Injection, shared: &SharedContext) {
    match injection {
        Injection::Strike { actor, after, blow } => {
            shared.emit(Event::Injected { fault: format!("{blow} in {actor} after {after} messages") });
            if let Some(troubles) = &shared.troubles {
                troubles.plan(&actor, after, blow);
            }
        }
        Injection::Lose { link, count } => {
            shared.emit(Event::Injected { fault: format!("{count} pulses are lost on {link}") });
            if *shared.to_model.name() == *link {
                shared.to_model.lose(count);
            }
            let streams = shared.robots.iter().flat_map(|w| [&w.to_history, &w.to_reflex, &w.to_supervise]);
            streams.filter(|s| *s.name() == *link).for_each(|s| s.lose(count));
        }
        Injection::Commit { robot, commit, times } => {
            shared.emit(Event::Injected { fault: format!("{} commits to {robot}, {times} times", commit.agent) });
            let Some(context) = find(shared, &robot) else { return };
            for _ in 0..times {
                let (reply, _unused) = ractor::concurrency::oneshot();
                context.supervise.send(SuperviseMsg::Commit(commit.clone(), reply.into()));
            }
        }
        Injection::Obstruct { object, robot, spot } => {
            shared.emit(Event::Injected { fault: format!("{object} appears on {robot} or its way") });
            if let Some(edit) = find(shared, &robot).map(|context| obstacle(object, context, spot, shared)) {
                shared.model.send(ModelMsg::Edit(edit, None));
            }
        }
        Injection::Suspend(time) => {
            shared.emit(Event::Injected { fault: format!("suspended for {:.3} s", time.as_secs_f64()) });
            shared.clock.suspend(time).await;
        }
        Injection::Heal => {
            shared.troubles.iter().for_each(Troubles::clear);
            shared.emit(Event::Injected { fault: mobee_journal::names::HEALED.into() });
        }
    }
}

fn find<'a>(shared: &'a SharedContext, robot: &str) -> Option<&'a Arc<RobotContext>> {
    shared.robots.iter().find(|w| w.name == robot)
}

fn obstacle(name: String, context: &RobotContext, spot: Spot, shared: &SharedContext) -> Edit {
    let here = context.latest.lock().q.clone();
    let there: Option<Pose> = {
        let book = context.ledger.book();
        let open = book.open.as_ref();
        open.and_then(|o| if spot.back { o.safe.as_ref().map(|safe| safe.q.clone()) } else { Some(o.target.clone()) })
    };
    let there = there.unwrap_or_else(|| here.clone());
    let q: Vec<f64> = here.iter().zip(there.iter()).map(|(a, b)| a + (b - a) * spot.share).collect();
    let scene = shared.scene.lock().clone();
    let mut at = Translation3::identity();
    if let Some(robot) = scene.robots().get(context.robot) {
        let mut frames = Vec::new();
        robot.forward_from(&scene.base(context.robot), &q, &mut frames);
        let solid = |n: &usize| robot.can_move(*n) && robot.nodes.get(*n).is_some_and(|node| !node.solids.is_empty());
        let moving: Vec<usize> = (0..frames.len()).filter(solid).collect();
        let which = (spot.body.clamp(0.0, 1.0) * moving.len().saturating_sub(1) as f64).round() as usize;
        let frame = moving.get(which).and_then(|n| frames.get(*n));
        at = frame.map_or(at, |f| f.translation);
    }
    Edit::Add(Object {
        name,
        class: ObjectClass::Obstacle,
        persistent: false,
        pose: Isometry3::from_parts(at, nalgebra::UnitQuaternion::identity()),
        shapes: vec![Primitive { shape: Shape::Sphere { radius: spot.radius }, pose: Isometry3::identity() }],
        color: None,
    })
}
