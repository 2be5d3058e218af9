//! The world's RPC: what MoBeE's users type to put objects around the robots, with the original's words and replies.
//!
//! The core is pure: a request and a view of the world give a reply and the edits to make. Where the original had a
//! mistake the right thing is done instead: `grab` holds until it is released, a wrong shape of request is answered with
//! a sentence, names in use are skipped, and an object that stays says so.
//!
//! ```text
//! OBJ = sph1 | sph 1
//! mk (s)sph r px py pz          set OBJ x y z           grab OBJ robot marker    save FILE
//! mk (s)cyl r h px py pz        rot OBJ rx ry rz        sim OBJ px py pz rx ry rz load FILE
//! mk (s)box sx sy sz px py pz   rot OBJ m00 .. m22      srun s, sstp, sync       undo
//! ls, clr, help                 get OBJ, rm OBJ         def OBJ obs|tgt|gho
//! ```

mod file;
mod grab;
mod make;
mod place;
#[cfg(test)]
mod tests;

use crate::words::{self, line, string};
use grab::Grabs;
use mobee_contract::Pose;
use mobee_model::{Edit, Object, ObjectClass, Scene};
use mobee_yarp::{Bottle, Value, Vocab};
use std::collections::VecDeque;
use std::sync::Arc;

pub use file::Errand;

/// Objects that may be made over the network, those of the files included.
const MOST_OBJECTS: usize = 1000;
/// Steps that can be undone.
const MOST_STEPS: usize = 100;

/// Robots and world as a request finds them.
pub struct WorldView<'a> {
    /// Robots and objects.
    pub scene: &'a Scene,
    /// The robots' newest poses, in the scene's order.
    pub poses: &'a [Pose],
}

/// What a request leads to.
#[derive(Debug, Default)]
pub struct Answered {
    /// The reply, if there is no errand.
    pub reply: Bottle,
    /// To be made in this order; they fit the scene that was seen.
    pub edits: Vec<Edit>,
    /// A file to be read or written first; its end gives the reply.
    pub errand: Option<Errand>,
}

impl Answered {
    fn says(reply: Bottle) -> Answered {
        Answered { reply, ..Answered::default() }
    }
}

/// A change that can be taken back.
struct Step {
    what: String,
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
    /// Answers one request. Never fails: whatever is wrong is said in the reply.
    pub fn on(&mut self, request: &Bottle, view: &WorldView) -> Answered {
        let arguments = request.0.get(1..).unwrap_or_default();
        let Some(verb) = words::name(request.0.first()) else { return unknown() };
        match verb.as_str() {
            "help" => Answered::says(help()),
            "ls" => Answered::says(Bottle(view.scene.objects().map(|(_, o)| string(&o.name)).collect())),
            "mk" => self.make(arguments, view),
            "set" => self.on_object(arguments, view, WorldRpc::set),
            "rot" => self.on_object(arguments, view, WorldRpc::rot),
            "get" => self.on_object(arguments, view, |_, object, _, _| (place::column_major(&object.pose), vec![])),
            "def" => self.on_object(arguments, view, WorldRpc::def),
            "rm" => self.on_object(arguments, view, WorldRpc::rm),
            "grab" => self.on_object(arguments, view, WorldRpc::grab),
            "sim" => self.on_object(arguments, view, WorldRpc::sim),
            "clr" => self.clear(view),
            "srun" => Answered::says(line(match words::exactly::<1>(arguments) {
                Some(_) => "ok",
                None => "Please provide the refresh period for the synchronization thread in seconds",
            })),
            "sstp" | "sync" => Answered::says(line("ok")),
            "undo" => self.undo(view),
            "save" => file::save(arguments, view),
            "load" => file::load(arguments),
            _ => unknown(),
        }
    }

    /// The world's part of a file that an [`Errand::Load`] asked for.
    pub fn loaded(&mut self, file: &str, objects: Vec<Object>, view: &WorldView) -> Answered {
        let count = objects.len();
        let edits = file::replace(objects, view.scene);
        self.change(format!("load {file}"), edits, view, vec![string(format!("Loaded {count} objects from {file}."))])
    }

    /// The edits that keep what is grabbed with its marker; to be asked for while the robots move.
    pub fn follow(&mut self, view: &WorldView) -> Vec<Edit> {
        self.grabs.follow(view)
    }

    /// Whether anything is grabbed.
    pub fn holds_anything(&self) -> bool {
        !self.grabs.is_empty()
    }

    /// A command about one object: finds it and says so, then does the rest.
    fn on_object(
        &mut self,
        arguments: &[Value],
        view: &WorldView,
        act: impl FnOnce(&mut WorldRpc, &Arc<Object>, &[Value], &WorldView) -> (Vec<Value>, Vec<Edit>),
    ) -> Answered {
        let (name, rest) = object_name(arguments);
        let Some((_, object)) = view.scene.object(&name) else {
            return Answered::says(line(format!("Object {name} not found.")));
        };
        let mut reply = vec![string(format!("Object {name} found."))];
        let (more, edits) = act(self, object, rest, view);
        if edits.is_empty() {
            reply.extend(more);
            return Answered::says(Bottle(reply));
        }
        let found = reply.clone();
        reply.extend(more);
        let mut answered = self.change(format!("changing {name}"), edits, view, reply);
        if answered.edits.is_empty() {
            // refused by the model: what it says, after the found-string
            answered.reply.0.splice(0..0, found);
        } else {
            self.grabs.regrip(&answered.edits, view);
        }
        answered
    }

    fn set(&mut self, object: &Arc<Object>, rest: &[Value], _: &WorldView) -> (Vec<Value>, Vec<Edit>) {
        match words::exactly(rest) {
            Some(at) => moved(object, place::at(&object.pose, at), "Set Cartesian position of object."),
            None => said("SET ERROR: give x y z in metres."),
        }
    }

    fn rot(&mut self, object: &Arc<Object>, rest: &[Value], _: &WorldView) -> (Vec<Value>, Vec<Edit>) {
        if let Some(degrees) = words::exactly(rest) {
            return moved(object, place::turned(&object.pose, degrees), "Set rotation (about x,y,z in degrees).");
        }
        match words::exactly(rest).and_then(|rows| place::with_matrix(&object.pose, rows)) {
            Some(pose) => moved(object, pose, "Set full rotation matrix."),
            None => said("ROT ERROR: give 3 angles in degrees, or the 9 numbers of a rotation matrix row by row."),
        }
    }

    fn sim(&mut self, object: &Arc<Object>, rest: &[Value], _: &WorldView) -> (Vec<Value>, Vec<Edit>) {
        let Some(numbers) = words::exactly(rest) else {
            return said("parseSimRTBottle: invalid number of arguments supplied");
        };
        let pose = place::from_simulator(&object.name, numbers);
        (vec![], vec![Edit::Move { name: object.name.clone(), pose }])
    }

    fn def(&mut self, object: &Arc<Object>, rest: &[Value], _: &WorldView) -> (Vec<Value>, Vec<Edit>) {
        let (class, word) = match words::name(rest.first()).as_deref() {
            Some("obs") => (ObjectClass::Obstacle, "obstacle"),
            Some("tgt") => (ObjectClass::Target, "target"),
            Some("gho") => (ObjectClass::Ghost, "ghost"),
            _ => return said("Unknown definition, use 'obs' or 'tgt'."),
        };
        let edit = Edit::Class { name: object.name.clone(), class };
        (vec![string(format!("Changed object type to '{word}'."))], vec![edit])
    }

    fn rm(&mut self, object: &Arc<Object>, _: &[Value], _: &WorldView) -> (Vec<Value>, Vec<Edit>) {
        if object.persistent {
            return said("Object is persistent and stays.");
        }
        self.grabs.release(&object.name);
        (vec![string("Removed object")], vec![Edit::Remove { name: object.name.clone() }])
    }

    fn grab(&mut self, object: &Arc<Object>, rest: &[Value], view: &WorldView) -> (Vec<Value>, Vec<Edit>) {
        (self.grabs.grab(object, rest, view), vec![])
    }

    fn clear(&mut self, view: &WorldView) -> Answered {
        self.counters = make::Counters::default();
        self.grabs = Grabs::default();
        self.change("clr".into(), vec![Edit::Clear], view, vec![string("Removed all world objects")])
    }

    fn undo(&mut self, view: &WorldView) -> Answered {
        let Some(Step { what, back }) = self.steps.pop_back() else {
            return Answered::says(line("Nothing to undo."));
        };
        match rehearse(&back, view.scene) {
            Ok(_) => {
                self.grabs.regrip(&back, view);
                Answered { reply: line(format!("Undone: {what}.")), edits: back, errand: None }
            }
            Err(sentence) => Answered::says(line(format!("Not undone: {sentence}"))),
        }
    }

    /// Makes a change that the scene would take, keeping what takes it back; else says why not.
    fn change(&mut self, what: String, edits: Vec<Edit>, view: &WorldView, reply: Vec<Value>) -> Answered {
        match rehearse(&edits, view.scene) {
            Err(sentence) => Answered::says(line(sentence)),
            Ok(back) => {
                if self.steps.len() >= MOST_STEPS {
                    self.steps.pop_front();
                }
                self.steps.push_back(Step { what, back });
                Answered { reply: Bottle(reply), edits, errand: None }
            }
        }
    }
}

/// Whether a request may change something, the world or a file.
pub fn is_change(request: &Bottle) -> bool {
    const CHANGES: [&str; 10] = ["mk", "set", "rot", "def", "rm", "sim", "clr", "undo", "save", "load"];
    words::name(request.0.first()).is_some_and(|verb| CHANGES.contains(&verb.as_str()))
}

/// Makes edits on a copy of the scene: what would take them back, in order, or why they can't be made.
fn rehearse(edits: &[Edit], scene: &Scene) -> Result<Vec<Edit>, String> {
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
        scene = scene.edit(edit).map_err(|e| e.to_string())?;
        if scene.objects().count() > MOST_OBJECTS {
            return Err(format!("There are {MOST_OBJECTS} objects already; remove some first."));
        }
    }
    Ok(back)
}

fn moved(object: &Object, pose: nalgebra::Isometry3<f64>, reply: &str) -> (Vec<Value>, Vec<Edit>) {
    (vec![string(reply)], vec![Edit::Move { name: object.name.clone(), pose }])
}

fn said(sentence: &str) -> (Vec<Value>, Vec<Edit>) {
    (vec![string(sentence)], vec![])
}

fn unknown() -> Answered {
    Answered::says(line("Unknown RPC command"))
}

/// The object's name in one of its two forms, and what follows it.
fn object_name(arguments: &[Value]) -> (String, &[Value]) {
    let first = words::name(arguments.first()).unwrap_or_default();
    if make::is_geometry(&first)
        && let Some(number) = words::integer(arguments.get(1))
    {
        return (format!("{first}{number}"), arguments.get(2..).unwrap_or_default());
    }
    (first, arguments.get(1..).unwrap_or_default())
}

fn help() -> Bottle {
    let lines = [
        "OBJ is the name of an object, in one word (sph1) or two (sph 1). Lengths in metres.",
        "ls - names of all objects",
        "mk sph|ssph radius x y z - make a sphere",
        "mk cyl|scyl radius height x y z - make a cylinder along y",
        "mk box|sbox size_x size_y size_z x y z - make a box",
        "set OBJ x y z - put an object elsewhere",
        "rot OBJ rx ry rz - turn an object to these angles about x, y, z, degrees",
        "rot OBJ r00 r01 r02 r10 r11 r12 r20 r21 r22 - turn an object to this rotation matrix",
        "get OBJ - pose of an object: its 4x4 matrix, column by column",
        "def OBJ obs|tgt|gho - make it an obstacle, a target or a ghost",
        "rm OBJ - remove an object that is not persistent",
        "clr - remove all objects that are not persistent",
        "grab OBJ robot marker - let an object follow a marker; with any other word than a marker: release it",
        "sim OBJ px py pz rx ry rz - set the pose as the iCub simulator gives it, degrees",
        "srun period | sstp | sync - taken for the original's sake; there is no simulator to keep in step with",
        "save FILE | load FILE - write or replace the world, in the folder that the configuration names",
        "undo - take back the last change",
    ];
    let mut reply = vec![Value::Vocab(Vocab::new("many"))];
    reply.extend(lines.iter().map(string));
    Bottle(reply)
}
