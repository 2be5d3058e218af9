//! The world's RPC: what MoBeE's users type to put objects around the robots, with the original's words and replies.
//!
//! The core is pure: a request and a view of the world give a reply and the edits to make. Where the original had a
//! mistake, the right thing is done instead: `grab` holds until it is released, a malformed request is answered with
//! a sentence, names in use are skipped, and a request that changes nothing says so. It knows requests and replies as types
//! ([`WorldRequest`], [`WorldReply`]); how they are written is a bridge's matter, YARP's is [`crate::yarp::world`].

mod file;
mod grab;
mod make;
mod place;
mod request;
#[cfg(test)]
pub(crate) mod tests;

pub use file::Errand;
pub(crate) use make::is_series;
pub use request::{Change, Geometry, ObjectReply, ObjectRequest, Size, WorldRefusal, WorldReply, WorldRequest};

use grab::Grabs;
use mobee_contract::Pose;
use mobee_model::{Edit, Object, Scene};
use std::collections::VecDeque;
use std::sync::Arc;

/// The most objects that the world may have once one is made over the network, those of the configuration included.
const MOST_OBJECTS: usize = 1000;
/// How many steps can be undone.
const MOST_STEPS: usize = 100;

/// Robots and world as a request finds them.
pub struct WorldView<'a> {
    /// Robots and objects.
    pub scene: &'a Scene,
    /// The robots' newest poses, in the scene's order.
    pub poses: &'a [Pose],
}

/// What a request leads to, if it is not refused.
#[derive(Debug)]
pub enum Answered {
    /// Nothing is to be done: this is the reply.
    Reply(WorldReply),
    /// Edits, to be made before the reply is sent.
    Changed(Changed),
    /// A file to be read or written; the reply follows from how that went.
    Errand(Errand),
}

/// Edits, to be made in this order, and the reply that follows them. They fit the scene that the request has seen.
#[derive(Debug)]
pub struct Changed {
    /// The edits.
    pub edits: Vec<Edit>,
    /// The reply.
    pub reply: WorldReply,
}

/// A change that can be taken back.
struct Step {
    change: Change,
    back: Vec<Edit>,
}

/// The core: counters of names, what is grabbed, and what can be undone.
#[derive(Default)]
pub struct WorldRpc {
    counters: make::Counters,
    grabs: Grabs,
    steps: VecDeque<Step>,
}

impl WorldRpc {
    /// Answers one request.
    ///
    /// # Errors
    /// Why it is not done; nothing has changed then.
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

    /// The world's part of a file that an [`Errand::Load`] asked for.
    ///
    /// # Errors
    /// Why the scene does not take it.
    pub fn loaded(&mut self, file: &str, objects: Vec<Object>, view: &WorldView) -> Result<Changed, WorldRefusal> {
        let reply = WorldReply::Loaded { file: file.to_owned(), objects: objects.len() };
        self.change(Change::Loaded(file.to_owned()), file::replace(objects, view.scene), view, reply)
    }

    /// The edits that keep what is grabbed with its marker; to be asked for while the robots move.
    pub fn follow(&mut self, view: &WorldView) -> Vec<Edit> {
        self.grabs.follow(view)
    }

    /// Whether anything is grabbed.
    pub fn holds_anything(&self) -> bool {
        !self.grabs.is_empty()
    }

    /// A request about one object: resolves its name, and goes on with the object.
    fn on_object(&mut self, name: &str, ask: &ObjectRequest, view: &WorldView) -> Result<Answered, WorldRefusal> {
        let object = found(name, view)?;
        let found = |outcome| WorldReply::Found { name: name.to_owned(), outcome };
        let (reply, edit) = match self.ask(object, ask, view) {
            Ok((reply, Some(edit))) => (reply, edit),
            Ok((reply, None)) => return Ok(Answered::Reply(found(Ok(reply)))),
            Err(why) => return Ok(Answered::Reply(found(Err(why)))),
        };
        match self.change(Change::Changed(name.to_owned()), vec![edit], view, found(Ok(reply))) {
            Ok(changed) => {
                self.grabs.regrip(&changed.edits, view);
                Ok(Answered::Changed(changed))
            }
            Err(why) => Ok(Answered::Reply(found(Err(why)))),
        }
    }

    /// The reply to a request about an object, and the edit that it takes.
    fn ask(
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
            ObjectRequest::Remove => {
                self.grabs.release(&object.name);
                (ObjectReply::Removed, Some(Edit::Remove { name: name() }))
            }
            ObjectRequest::Grab { robot, marker } => (self.grabs.grab(object, robot, marker, view)?, None),
        })
    }

    fn clear(&mut self, view: &WorldView) -> Result<Changed, WorldRefusal> {
        self.counters = make::Counters::default();
        self.grabs = Grabs::default();
        self.change(Change::Cleared, vec![Edit::Clear], view, WorldReply::Cleared)
    }

    fn undo(&mut self, view: &WorldView) -> Result<Changed, WorldRefusal> {
        let Step { change, back } = self.steps.pop_back().ok_or(WorldRefusal::NothingToUndo)?;
        rehearse(&back, view.scene).map_err(|why| WorldRefusal::NotUndone(Box::new(why)))?;
        self.grabs.regrip(&back, view);
        Ok(Changed { edits: back, reply: WorldReply::Undone(change) })
    }

    /// A change that the scene accepts, remembered so that it can be undone; otherwise the reason.
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
        self.steps.push_back(Step { change, back });
        Ok(Changed { edits, reply })
    }
}

fn found<'a>(name: &str, view: &'a WorldView) -> Result<&'a Arc<Object>, WorldRefusal> {
    view.scene.object(name).map(|(_, object)| object).ok_or_else(|| WorldRefusal::NoObject(name.to_owned()))
}

/// Tries edits on a copy of the scene: the edits that would undo them, in order, or the reason why they can't be made.
fn rehearse(edits: &[Edit], scene: &Scene) -> Result<Vec<Edit>, WorldRefusal> {
    let mut scene = scene.clone();
    let mut back: Vec<Edit> = Vec::new();
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
        back.splice(0..0, inverse);
        scene = scene.edit(edit).map_err(WorldRefusal::Scene)?;
        if scene.objects().count() > MOST_OBJECTS {
            return Err(WorldRefusal::Full { most: MOST_OBJECTS });
        }
    }
    Ok(back)
}
