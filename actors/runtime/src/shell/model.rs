//! The model's shell: the hub where sensors, agents and controllers meet. One for all robots and objects.

use crate::wiring::{AgentMsg, ModelMsg, RobotContext, SharedContext};
use mobee_contract::{CommitId, Event, Pose, Status, WorldChange};
use mobee_controller::RELEASE;
use mobee_controller::gate::Gate;
use mobee_controller::ledger::{Motion, Open};
use mobee_controller::look_ahead::{self, LookAhead};
use mobee_controller::simultaneous::Simultaneous;
use mobee_model::{Contact, Edit, Field, Object, Scene, ShapeId, Watch};
use nalgebra::{Isometry3, Vector3};
use ractor::{Actor, ActorProcessingErr, ActorRef};
use std::sync::Arc;

/// The model's actor.
pub struct ModelActor;

/// State of a [`ModelActor`]; the scene itself survives it in the shared context.
pub struct Model {
    shared: Arc<SharedContext>,
    scene: Arc<Scene>,
    /// The true poses of the objects, if they are simulated; see [`SharedContext::truth`].
    truth: Arc<Scene>,
    watch: Watch,
    /// Least distances between robots from one reading to the next.
    simultaneous: Simultaneous,
    /// Stopping configurations, if any robot looks ahead.
    ahead: Option<LookAhead>,
    poses: Vec<Pose>,
    /// Force fields of the robots that move under forces.
    fields: Vec<Option<Fields>>,
}

impl Actor for ModelActor {
    type Msg = ModelMsg;
    type State = Model;
    type Arguments = Arc<SharedContext>;

    async fn pre_start(
        &self,
        myself: ActorRef<ModelMsg>,
        shared: Arc<SharedContext>,
    ) -> Result<Model, ActorProcessingErr> {
        let scene = shared.scene.lock().clone();
        let truth = shared.truth.lock().clone();
        let watch = watch(&shared, &scene);
        let simultaneous = simultaneous(&shared, &scene);
        let ahead = ahead(&shared, &scene);
        let poses = shared.robots.iter().map(|w| w.latest.lock().q.clone()).collect();
        let fields = shared.robots.iter().map(|w| Fields::new(w, &scene)).collect();
        shared.model.connect(myself.clone());
        shared.to_model.attach(Box::new(move || myself.send_message(ModelMsg::Pulses).is_ok()));
        Ok(Model { shared, scene, truth, watch, simultaneous, ahead, poses, fields })
    }

    async fn handle(
        &self,
        _myself: ActorRef<ModelMsg>,
        message: ModelMsg,
        model: &mut Model,
    ) -> Result<(), ActorProcessingErr> {
        match message {
            ModelMsg::Pulses => model.pulses(),
            ModelMsg::Margins => {
                model.watch = watch(&model.shared, &model.scene);
                model.simultaneous = simultaneous(&model.shared, &model.scene);
                model.ahead = ahead(&model.shared, &model.scene);
                model.fields = model.shared.robots.iter().map(|w| Fields::new(w, &model.scene)).collect();
            }
            ModelMsg::Edit(edit, reply) => {
                let done = model.change(&edit);
                model.warn_on_error(&done);
                if let Some(reply) = reply {
                    let _ = reply.send(done);
                }
            }
            ModelMsg::Seen(object, at) => {
                // The object may have been removed since.
                if let Some(edit) = model.scene.object(&object).map(|(_, o)| seen_at(o, at)) {
                    let done = model.edit(&edit);
                    model.warn_on_error(&done);
                }
            }
        }
        Ok(())
    }
}

/// Edit that puts an object with its center where it was seen.
fn seen_at(object: &Object, at: [f64; 3]) -> Edit {
    let from_middle = object.pose.rotation * object.middle();
    let pose = Isometry3::from_parts((Vector3::from(at) - from_middle).into(), object.pose.rotation);
    Edit::Move { name: object.name.clone(), pose }
}

/// Creates the watch, with the range that the robot with the greatest margin and the look-ahead need.
fn watch(shared: &SharedContext, scene: &Arc<Scene>) -> Watch {
    let rules: Vec<_> = shared.robots.iter().map(|w| w.rules()).collect();
    let margin = rules.iter().map(|rules| rules.margin).fold(0.0, f64::max);
    Watch::new(scene.clone(), (margin + RELEASE).max(look_ahead::farthest(rules.iter().map(|rules| &**rules))))
}

/// Creates the check between readings for the present robots.
fn simultaneous(shared: &SharedContext, scene: &Arc<Scene>) -> Simultaneous {
    let rules: Vec<_> = shared.robots.iter().map(|w| w.rules()).collect();
    Simultaneous::new(scene, rules.iter().map(|rules| &**rules))
}

/// Creates the look-ahead for the robots that use it.
fn ahead(shared: &SharedContext, scene: &Arc<Scene>) -> Option<LookAhead> {
    LookAhead::new(scene, shared.robots.iter().map(|w| w.rules()))
}

impl Model {
    fn pulses(&mut self) {
        while let Some((robot, mut pulse)) = self.shared.to_model.pop() {
            let (Some(context), Some(slot)) = (self.shared.robots.get(robot), self.poses.get_mut(robot)) else {
                continue;
            };
            *slot = pulse.sample.q.clone();
            let near = self.watch.update(&self.poses);
            if !near.is_empty() {
                let within = context.rules().margin + RELEASE;
                let is_own = |s: ShapeId| s.robot() == Some(robot);
                let own = |c: &&Contact| c.distance <= within && (is_own(c.pair.0) || is_own(c.pair.1));
                pulse.contacts = near.iter().filter(own).copied().collect();
            }
            // A single robot has no other to meet.
            if self.poses.len() > 1 {
                let met = self.simultaneous.read(robot, pulse.sample.at, &pulse.sample.q);
                if !met.is_empty() {
                    pulse.together = met.into();
                }
            }
            if let Some(ahead) = &mut self.ahead {
                let open = Gate::opens(context.gate.token());
                let foreseen = ahead.read(robot, &pulse.sample, &self.poses, near, open);
                if !foreseen.is_empty() {
                    pulse.foreseen = foreseen.into();
                }
            }
            if let Some(model) = self.scene.robots().get(robot) {
                pulse.violated = model.violated(&pulse.sample.q).next();
                pulse.depth = pulse.violated.map_or(0.0, |_| model.violated_by(&pulse.sample.q));
            }
            pulse.epoch = self.scene.epoch();
            pulse.push = self.fields.get_mut(robot).and_then(|f| f.as_mut()?.push(context, robot, &self.poses));
            context.to_reflex.push(pulse);
        }
    }

    fn warn_on_error(&self, done: &Result<(), String>) {
        if let Err(text) = done {
            self.shared.emit(Event::Warning { text: format!("the world was not edited: {text}") });
        }
    }

    /// Applies an edit of the world. An object that simulated cameras see moves in the truth only: the model is
    /// updated by its sensors.
    fn change(&mut self, edit: &Edit) -> Result<(), String> {
        let is_secret = matches!(edit, Edit::Move { name, .. } if self.shared.looked_at.contains(name));
        self.truth = match self.shared.looked_at.is_empty() {
            // Without simulated cameras the model is the truth.
            true => {
                self.edit(edit)?;
                self.scene.clone()
            }
            false => {
                let truth = self.truth.edit(edit).map_err(|e| e.to_string())?;
                if !is_secret {
                    self.edit(edit)?;
                }
                Arc::new(truth)
            }
        };
        *self.shared.truth.lock() = self.truth.clone();
        Ok(())
    }

    fn edit(&mut self, edit: &Edit) -> Result<(), String> {
        let next = Arc::new(self.scene.edit(edit).map_err(|e| e.to_string())?);
        let before = std::mem::replace(&mut self.scene, next.clone());
        self.watch.set_scene(next.clone());
        self.simultaneous.set_scene(&next);
        self.ahead.iter_mut().for_each(|ahead| ahead.set_scene(&next));
        self.fields.iter_mut().flatten().for_each(|f| f.set_scene(&next));
        *self.shared.scene.lock() = next.clone();
        for event in differences(&before, &next) {
            self.shared.emit(event);
        }
        self.shared.taps.scene(self.shared.clock.now(), &next);
        for context in &self.shared.robots {
            context.agent.send(AgentMsg::Revise);
        }
        Ok(())
    }
}

/// The force field about a robot's shapes, which acts while it moves.
struct Fields {
    field: Field,
    /// Commit, and its target, at which the field is aimed.
    aimed: Option<(CommitId, Pose)>,
}

impl Fields {
    fn new(context: &RobotContext, scene: &Arc<Scene>) -> Option<Fields> {
        let width = context.rules().fields.as_ref()?.width;
        Some(Fields { field: Field::new(scene, context.robot, width), aimed: None })
    }

    fn set_scene(&mut self, scene: &Arc<Scene>) {
        self.field.set_scene(scene);
        self.aimed = None;
    }

    /// Torques on the motors, if any.
    fn push(&mut self, context: &RobotContext, robot: usize, poses: &[Pose]) -> Option<Arc<[f64]>> {
        let (open, ahead) = {
            let book = context.ledger.book();
            let forces = |o: &&Open| matches!(o.motion, Motion::Forces { .. });
            let forced = |o: &&Open| book.status == Status::Moving && forces(o);
            (book.open.as_ref().filter(forced).map(|o| (o.id, o.target.clone())), book.ahead.clone())
        };
        let (_, target) = open.as_ref()?;
        let mut poses = poses.to_vec();
        if self.aimed != open {
            *poses.get_mut(robot)? = target.clone();
            self.field.aim(&poses);
            self.aimed = open;
        }
        *poses.get_mut(robot)? = ahead?;
        let torques = self.field.torques(&poses);
        torques.iter().any(|t| *t != 0.0).then(|| torques.into())
    }
}

/// Events for the objects that an edit changed.
fn differences(before: &Scene, after: &Scene) -> Vec<Event> {
    let world_event = |o: &Object, what: WorldChange, exists: bool| Event::World {
        object: o.name.clone(),
        what,
        class: exists.then_some(o.class),
        at: exists.then(|| o.pose.translation.vector.into()),
    };
    let mut events = Vec::new();
    for (id, old) in before.objects() {
        match after.objects().find(|(i, _)| *i == id) {
            None => events.push(world_event(old, WorldChange::Removed, false)),
            Some((_, new)) if old.class != new.class => events.push(world_event(new, WorldChange::Changed, true)),
            Some((_, new)) if old.pose != new.pose => events.push(world_event(new, WorldChange::Moved, true)),
            Some(_) => {}
        }
    }
    let is_new = |id: u32| !before.objects().any(|(i, _)| i == id);
    events.extend(after.objects().filter(|(id, _)| is_new(*id)).map(|(_, o)| world_event(o, WorldChange::Added, true)));
    events
}
