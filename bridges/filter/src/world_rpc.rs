//! RPC of the world: requests of MoBeE's users that put objects around the robots, with the original's words
//! and replies.
//!
//! The core is pure: a request and a view of the world give a reply and the edits to make. Mistakes of the
//! original are corrected: `grab` holds until it is released, a malformed request is answered with a message,
//! names in use are skipped, and a request that changes nothing reports this. Requests and replies are types
//! ([`WorldRequest`], [`WorldReply`]); their encoding belongs to a bridge, YARP's is `mobee_bridge_yarp::world`.

mod file;
mod grab;
mod make;
mod place;
mod request;
#[cfg(test)]
mod tests;

pub use file::Errand;
pub use make::is_series;
pub use request::{Change, Geometry, ObjectReply, ObjectRequest, Size, WorldRefusal, WorldReply, WorldRequest};

use grab::Grabs;
use mobee_contract::Pose;
use mobee_model::{Edit, Object, Scene};
use std::collections::VecDeque;
use std::sync::Arc;

/// Largest number of objects in the world when one is made over the network, those of the configuration
/// included.
const MOST_OBJECTS: usize = 1000;
/// Largest number of steps that can be undone.
const MOST_STEPS: usize = 100;

/// Robots and world at the time of a request.
pub struct WorldView<'a> {
    /// Robots and objects.
    pub scene: &'a Scene,
    /// Newest configurations of the robots, in the scene's order.
    pub poses: &'a [Pose],
}

/// Outcome of a request that is not refused.
#[derive(Debug)]
pub enum Answered {
    /// Reply without further action.
    Reply(WorldReply),
    /// Edits, to be made before the reply is sent.
    Changed(Changed),
    /// A file to be read or written; the reply depends on the outcome.
    Errand(Errand),
}

/// Edits to be made in this order, and the reply that follows them. They fit the scene at the time of the
/// request.
#[derive(Debug)]
pub struct Changed {
    /// The edits.
    pub edits: Vec<Edit>,
    /// The reply.
    pub reply: WorldReply,
    /// State that [`WorldRpc::not_made`] restores.
    before: Before,
}

/// State of the core before a change.
#[derive(Debug)]
struct Before {
    counters: make::Counters,
    grabs: Grabs,
    /// The step that the change undoes; `None` if the change is recorded as a step itself.
    undone: Option<UndoStep>,
}

/// A change that can be undone.
#[derive(Debug)]
struct UndoStep {
    change: Change,
    /// For each edit, in the order in which they were made, the edits that undo it.
    back: Vec<Vec<Edit>>,
}

/// Pure core: counters of names, grabbed objects, and the steps that can be undone.
#[derive(Default)]
pub struct WorldRpc {
    counters: make::Counters,
    grabs: Grabs,
    steps: VecDeque<UndoStep>,
}

impl WorldRpc {
    /// Answers one request.
    ///
    /// # Errors
    /// The reason why it is not executed.
    pub fn on(&mut self, request: &WorldRequest, view: &WorldView) -> Result<Answered, WorldRefusal> {
        let reply = match request {
            WorldRequest::Help => WorldReply::Help,
            WorldRequest::List => WorldReply::Names(view.scene.objects().map(|(_, o)| o.name.clone()).collect()),
            WorldRequest::Synchronize => WorldReply::Synchronized,
            WorldRequest::Make { geometry, fixed, at } => {
                return self.make(*geometry, *fixed, *at, view).map(Answered::Changed);
            }
            WorldRequest::Object { name, ask } => return self.on_object(name, ask, view),
            WorldRequest::Clear => return self.clear(view).map(Answered::Changed),
            WorldRequest::Undo => return self.undo(view).map(Answered::Changed),
            WorldRequest::Save(name) => return file::save(name, view).map(Answered::Errand),
            WorldRequest::Load(name) => return file::load(name).map(Answered::Errand),
            WorldRequest::Malformed { object: None, why } => return Err(why.clone()),
            WorldRequest::Malformed { object: Some(name), why } => {
                found(name, view)?;
                WorldReply::Found { name: name.clone(), outcome: Err(why.clone()) }
            }
        };
        Ok(Answered::Reply(reply))
    }

    /// Replaces the world by the file that an [`Errand::Load`] has read.
    ///
    /// # Errors
    /// The reason why the scene does not accept it.
    pub fn loaded(&mut self, file: &str, objects: Vec<Object>, view: &WorldView) -> Result<Changed, WorldRefusal> {
        let reply = WorldReply::Loaded { file: file.to_owned(), objects: objects.len() };
        self.change(Change::Loaded(file.to_owned()), file::replace(objects, view.scene), view, reply)
    }

    /// Drops the record of the newest change: only its first edits were made, `made` of them. These can be undone.
    /// Call it before the next request.
    pub fn not_made(&mut self, changed: Changed, made: usize) {
        let Before { counters, grabs, undone } = changed.before;
        (self.counters, self.grabs) = (counters, grabs);
        let step = match undone {
            Some(UndoStep { change, .. }) => {
                let left = changed.edits.into_iter().skip(made);
                Some(UndoStep { change, back: left.rev().map(|edit| vec![edit]).collect() })
            }
            None => self.steps.pop_back().map(|mut step| {
                step.back.truncate(made);
                step
            }),
        };
        self.steps.extend(step.filter(|step| !step.back.is_empty()));
    }

    /// Edits that move grabbed objects with their markers; to be called while the robots move.
    pub fn follow(&mut self, view: &WorldView) -> Vec<Edit> {
        self.grabs.follow(view)
    }

    /// True if anything is grabbed.
    pub fn holds_anything(&self) -> bool {
        !self.grabs.is_empty()
    }

    /// Answers a request about one object, given by its name.
    fn on_object(&mut self, name: &str, ask: &ObjectRequest, view: &WorldView) -> Result<Answered, WorldRefusal> {
        let object = found(name, view)?;
        let found = |outcome| WorldReply::Found { name: name.to_owned(), outcome };
        let (reply, edit) = match self.object_request(object, ask, view) {
            Ok((reply, Some(edit))) => (reply, edit),
            Ok((reply, None)) => return Ok(Answered::Reply(found(Ok(reply)))),
            Err(why) => return Ok(Answered::Reply(found(Err(why)))),
        };
        match self.change(Change::Changed(name.to_owned()), vec![edit], view, found(Ok(reply))) {
            Ok(changed) => {
                self.grabs.regrip(&changed.edits, view);
                if matches!(ask, ObjectRequest::Remove) {
                    self.grabs.release(name);
                }
                Ok(Answered::Changed(changed))
            }
            Err(why) => Ok(Answered::Reply(found(Err(why)))),
        }
    }

    /// Reply to a request about an object, and the edit that it requires.
    fn object_request(
        &mut self,
        object: &Arc<Object>,
        ask: &ObjectRequest,
        view: &WorldView,
    ) -> Result<(ObjectReply, Option<Edit>), WorldRefusal> {
        let name = || object.name.clone();
        let moved = |pose| Some(Edit::Move { name: name(), pose });
        Ok(match ask {
            ObjectRequest::Get => (ObjectReply::Pose(object.pose), None),
            ObjectRequest::Put(at) => (ObjectReply::Put, moved(place::at(&object.pose, *at))),
            ObjectRequest::Turn(degrees) => (ObjectReply::Turned, moved(place::turned(&object.pose, *degrees))),
            ObjectRequest::TurnTo(rows) => {
                let pose = place::with_matrix(&object.pose, *rows).ok_or(WorldRefusal::Rotation)?;
                (ObjectReply::TurnedTo, moved(pose))
            }
            ObjectRequest::FromSimulator(numbers) => {
                (ObjectReply::AsSimulated, moved(place::from_simulator(&object.name, *numbers)))
            }
            ObjectRequest::Class(class) => {
                (ObjectReply::Class(*class), Some(Edit::Class { name: name(), class: *class }))
            }
            ObjectRequest::Remove if object.persistent => return Err(WorldRefusal::Persistent),
            ObjectRequest::Remove => (ObjectReply::Removed, Some(Edit::Remove { name: name() })),
            ObjectRequest::Grab { robot, marker } => (self.grabs.grab(object, robot, marker, view)?, None),
        })
    }

    fn clear(&mut self, view: &WorldView) -> Result<Changed, WorldRefusal> {
        let changed = self.change(Change::Cleared, vec![Edit::Clear], view, WorldReply::Cleared)?;
        self.counters = make::Counters::default();
        self.grabs = Grabs::default();
        Ok(changed)
    }

    fn undo(&mut self, view: &WorldView) -> Result<Changed, WorldRefusal> {
        let step = self.steps.back().ok_or(WorldRefusal::NothingToUndo)?;
        let edits: Vec<Edit> = step.back.iter().rev().flatten().cloned().collect();
        let reply = WorldReply::Undone(step.change.clone());
        // A step that can't be undone now remains: the world may change again.
        rehearse(&edits, view.scene).map_err(|why| WorldRefusal::NotUndone(Box::new(why)))?;
        let before = Before { undone: self.steps.pop_back(), ..self.before() };
        self.grabs.regrip(&edits, view);
        Ok(Changed { edits, reply, before })
    }

    /// Checks a change with the scene and records it for undo; fails if the scene does not accept it.
    fn change(
        &mut self,
        change: Change,
        edits: Vec<Edit>,
        view: &WorldView,
        reply: WorldReply,
    ) -> Result<Changed, WorldRefusal> {
        let back = rehearse(&edits, view.scene)?;
        if self.steps.len() >= MOST_STEPS {
            self.steps.pop_front();
        }
        self.steps.push_back(UndoStep { change, back });
        Ok(Changed { edits, reply, before: self.before() })
    }

    /// The present state, before a change that is recorded as a step.
    fn before(&self) -> Before {
        Before { counters: self.counters.clone(), grabs: self.grabs.clone(), undone: None }
    }
}

fn found<'a>(name: &str, view: &'a WorldView) -> Result<&'a Arc<Object>, WorldRefusal> {
    view.scene.object(name).map(|(_, object)| object).ok_or_else(|| WorldRefusal::NoObject(name.to_owned()))
}

/// Tries edits on a copy of the scene. Returns, for each of them, the edits that would undo it, or the reason why
/// they can't be made.
fn rehearse(edits: &[Edit], scene: &Scene) -> Result<Vec<Vec<Edit>>, WorldRefusal> {
    let mut scene = scene.clone();
    let mut back: Vec<Vec<Edit>> = Vec::new();
    for edit in edits {
        let old = |name: &str| scene.object(name).map(|(_, o)| Object::clone(o));
        let inverse: Vec<Edit> = match edit {
            Edit::Add(o) if o.persistent => vec![],
            Edit::Add(o) => vec![Edit::Remove { name: o.name.clone() }],
            Edit::Remove { name } => old(name).map(Edit::Add).into_iter().collect(),
            Edit::Move { name, .. } => {
                old(name).map(|o| Edit::Move { name: o.name, pose: o.pose }).into_iter().collect()
            }
            Edit::Class { name, .. } => {
                old(name).map(|o| Edit::Class { name: o.name, class: o.class }).into_iter().collect()
            }
            Edit::Clear => {
                scene.objects().filter(|(_, o)| !o.persistent).map(|(_, o)| Edit::Add(Object::clone(o))).collect()
            }
        };
        back.push(inverse);
        scene = scene.edit(edit).map_err(WorldRefusal::Scene)?;
        if scene.objects().count() > MOST_OBJECTS {
            return Err(WorldRefusal::Full { most: MOST_OBJECTS });
        }
    }
    Ok(back)
}
