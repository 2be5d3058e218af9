//! YARP encoding of the world's RPC, in the original's words.
//!
//! ```text
//! OBJ = sph1 | sph 1
//! mk (s)sph r px py pz          set OBJ x y z           grab OBJ robot marker    save FILE
//! mk (s)cyl r h px py pz        rot OBJ rx ry rz        sim OBJ px py pz rx ry rz load FILE
//! mk (s)box sx sy sz px py pz   rot OBJ m00 .. m22      srun s, sstp, sync       undo
//! ls, clr, help                 get OBJ, rm OBJ         def OBJ obs|tgt|gho (also obstacle|target|ghost)
//! ```

#[cfg(test)]
mod tests;

use super::words::{self, line, string};
use crate::services::WorldService;
use mobee_filter::world_rpc::{
    Change, Geometry, ObjectReply, ObjectRequest, Size, WorldRefusal, WorldReply, WorldRequest, is_series,
};
use mobee_model::ObjectClass;
use mobee_yarp::{Bottle, Value, Vocab};

/// Answers one request; edits are made before the reply.
pub async fn answer(world: &WorldService, request: &Bottle) -> Bottle {
    judged(world, request).await.unwrap_or_else(|refused| refused)
}

/// Same as [`answer`], for callers that depend on the outcome.
///
/// # Errors
/// The reply to a request that was refused.
pub async fn judged(world: &WorldService, request: &Bottle) -> Result<Bottle, Bottle> {
    let answered = world.answer(parse(request)).await;
    let refused = matches!(&answered, Err(_) | Ok(WorldReply::Found { outcome: Err(_), .. }));
    let bottle = reply(&answered);
    if refused { Err(bottle) } else { Ok(bottle) }
}

/// Parses a request. Never fails: an error becomes part of the request, and the world's core answers it.
pub fn parse(request: &Bottle) -> WorldRequest {
    let malformed = |why| WorldRequest::Malformed { object: None, why };
    let Some(verb) = words::name(request.0.first()) else { return malformed(WorldRefusal::Unknown) };
    let arguments = request.0.get(1..).unwrap_or_default();
    let file = || words::name(arguments.first()).unwrap_or_default();
    match verb.as_str() {
        "help" => WorldRequest::Help,
        "ls" => WorldRequest::List,
        "mk" => make(arguments).unwrap_or_else(malformed),
        "set" => {
            on_object(arguments, |rest| words::exactly(rest).map(ObjectRequest::Put).ok_or(WorldRefusal::Position))
        }
        "rot" => on_object(arguments, |rest| {
            let angles = words::exactly(rest).map(ObjectRequest::Turn);
            angles.or_else(|| words::exactly(rest).map(ObjectRequest::TurnTo)).ok_or(WorldRefusal::Rotation)
        }),
        "get" => on_object(arguments, |_| Ok(ObjectRequest::Get)),
        "def" => on_object(arguments, |rest| class(rest).map(ObjectRequest::Class)),
        "rm" => on_object(arguments, |_| Ok(ObjectRequest::Remove)),
        "grab" => on_object(arguments, |rest| {
            let word = |i: usize| words::name(rest.get(i)).unwrap_or_default();
            Ok(ObjectRequest::Grab { robot: word(0), marker: word(1) })
        }),
        "sim" => on_object(arguments, |rest| {
            words::exactly(rest).map(ObjectRequest::FromSimulator).ok_or(WorldRefusal::SimulatorPose)
        }),
        "clr" => WorldRequest::Clear,
        "srun" if words::exactly::<1>(arguments).is_none() => malformed(WorldRefusal::Period),
        "srun" | "sstp" | "sync" => WorldRequest::Synchronize,
        "undo" => WorldRequest::Undo,
        "save" => WorldRequest::Save(file()),
        "load" => WorldRequest::Load(file()),
        _ => malformed(WorldRefusal::Unknown),
    }
}

/// Request about the object that the arguments begin with, whose name has two forms.
fn on_object(arguments: &[Value], ask: impl FnOnce(&[Value]) -> Result<ObjectRequest, WorldRefusal>) -> WorldRequest {
    let first = words::name(arguments.first()).unwrap_or_default();
    let number = words::integer(arguments.get(1)).filter(|_| is_series(&first));
    let (name, rest) = match number {
        Some(number) => (format!("{first}{number}"), arguments.get(2..)),
        None => (first, arguments.get(1..)),
    };
    match ask(rest.unwrap_or_default()) {
        Ok(ask) => WorldRequest::Object { name, ask },
        Err(why) => WorldRequest::Malformed { object: Some(name), why },
    }
}

fn make(arguments: &[Value]) -> Result<WorldRequest, WorldRefusal> {
    let word = words::name(arguments.first()).unwrap_or_default();
    let arguments = arguments.get(1..).unwrap_or_default();
    // a missing or malformed number counts as 0, as in the original
    let size = |i: usize| words::number(arguments.get(i)).unwrap_or_default();
    let (geometry, sizes) = match word.as_str() {
        "sph" | "ssph" => (Geometry::Sphere { radius: size(0) }, 1),
        "cyl" | "scyl" => (Geometry::Cylinder { radius: size(0), height: size(1) }, 2),
        "box" | "sbox" => (Geometry::Box { size: [size(0), size(1), size(2)] }, 3),
        _ => return Err(WorldRefusal::UnknownGeometry),
    };
    // a malformed size is reported before a missing position
    geometry.shape()?;
    let numbers = words::numbers(arguments).filter(|n| n.len() == sizes + 3);
    let at = numbers.as_deref().and_then(|n| n.get(sizes..)).and_then(|at| at.try_into().ok());
    let at = at.ok_or(WorldRefusal::NewObject { sizes })?;
    Ok(WorldRequest::Make { geometry, fixed: matches!(word.as_str(), "ssph" | "scyl" | "sbox"), at })
}

fn class(rest: &[Value]) -> Result<ObjectClass, WorldRefusal> {
    let word = words::name(rest.first());
    word.as_deref().and_then(ObjectClass::of_word).ok_or(WorldRefusal::UnknownClass)
}

/// Encodes a reply as the original does.
pub fn reply(reply: &Result<WorldReply, WorldRefusal>) -> Bottle {
    match reply {
        Err(why) => line(sentence(why)),
        Ok(WorldReply::Help) => help(),
        Ok(WorldReply::Names(names)) => Bottle(names.iter().map(string).collect()),
        Ok(WorldReply::Made(name)) => line(name),
        Ok(WorldReply::Found { name, outcome }) => {
            let mut reply = line(format!("Object {name} found."));
            match outcome {
                Ok(outcome) => reply.0.extend(of_object(outcome)),
                Err(why) => reply.0.push(string(sentence(why))),
            }
            reply
        }
        Ok(WorldReply::Cleared) => line("Removed all world objects"),
        Ok(WorldReply::Synchronized) => line("ok"),
        Ok(WorldReply::Undone(change)) => line(match change {
            Change::Made(name) => format!("Undone: mk {name}."),
            Change::Changed(name) => format!("Undone: changing {name}."),
            Change::Cleared => "Undone: clr.".into(),
            Change::Loaded(file) => format!("Undone: load {file}."),
        }),
        Ok(WorldReply::Saved(file)) => line(format!("Saved {file}.")),
        Ok(WorldReply::Loaded { file, objects }) => line(format!("Loaded {objects} objects from {file}.")),
    }
}

fn of_object(outcome: &ObjectReply) -> Vec<Value> {
    let sentence = match outcome {
        // 16 numbers, column by column
        ObjectReply::Pose(pose) => return pose.to_homogeneous().iter().map(|x| Value::Float64(*x)).collect(),
        ObjectReply::AsSimulated => return vec![],
        ObjectReply::Grabbed => return vec![string("Robot found."), string("Marker found, grabbing object.")],
        ObjectReply::Released => return vec![string("Robot found."), string("Marker not found, releasing object.")],
        ObjectReply::Put => "Set Cartesian position of object.",
        ObjectReply::Turned => "Set rotation (about x,y,z in degrees).",
        ObjectReply::TurnedTo => "Set full rotation matrix.",
        ObjectReply::Class(ObjectClass::Obstacle) => "Changed object type to 'obstacle'.",
        ObjectReply::Class(ObjectClass::Target) => "Changed object type to 'target'.",
        ObjectReply::Class(ObjectClass::Ghost) => "Changed object type to 'ghost'.",
        ObjectReply::Removed => "Removed object",
    };
    vec![string(sentence)]
}

fn sentence(why: &WorldRefusal) -> String {
    match why {
        WorldRefusal::Unknown => "Unknown RPC command".into(),
        WorldRefusal::UnknownGeometry => "MK ERROR: Unknown geometry... use '(s)sph', '(s)cyl', or '(s)box'".into(),
        WorldRefusal::NotPositive(size) => match size {
            Size::SphereRadius => "Sphere radius must be greater than 0.",
            Size::CylinderRadius => "Cylinder radius must be greater than 0.",
            Size::CylinderHeight => "Cylinder height must be greater than 0.",
            Size::BoxWidth => "Box must have width > 0.",
            Size::BoxHeight => "Box must have height > 0.",
            Size::BoxDepth => "Box must have depth > 0.",
        }
        .into(),
        WorldRefusal::NewObject { sizes } => {
            format!("MK ERROR: give {sizes} size(s) and a position x y z, all numbers, in meters")
        }
        WorldRefusal::NoNumberLeft => "MK ERROR: no number is left".into(),
        WorldRefusal::Position => "SET ERROR: give x y z in meters.".into(),
        WorldRefusal::Rotation => {
            "ROT ERROR: give 3 angles in degrees, or the 9 numbers of a rotation matrix row by row.".into()
        }
        WorldRefusal::SimulatorPose => "parseSimRTBottle: invalid number of arguments supplied".into(),
        WorldRefusal::UnknownClass => {
            "Unknown definition, use 'obs', 'tgt' or 'gho' (or 'obstacle', 'target', 'ghost').".into()
        }
        WorldRefusal::Period => "Please provide the refresh period for the synchronization thread in seconds".into(),
        WorldRefusal::FileName => "Give the bare name of a file: letters, digits, '_', '-' and '.', no folders.".into(),
        WorldRefusal::NoObject(name) => format!("Object {name} not found."),
        WorldRefusal::Persistent => "Object is persistent and stays.".into(),
        WorldRefusal::NoRobot => "Robot not found.".into(),
        WorldRefusal::Scene(error) => error.to_string(),
        WorldRefusal::Full { most } => format!("There are {most} objects already; remove some first."),
        WorldRefusal::NothingToUndo => "Nothing to undo.".into(),
        WorldRefusal::NotUndone(why) => format!("Not undone: {}", sentence(why)),
        WorldRefusal::Busy { per_second } => {
            format!("Busy: the world takes {per_second} changes a second; send fewer.")
        }
        WorldRefusal::Model(why) => why.clone(),
        WorldRefusal::ModelSilent => "The model does not answer; the world may have changed in part.".into(),
        WorldRefusal::FilesOff => {
            "Saving and loading are off; set save_folder in the table [yarp] of the configuration.".into()
        }
        WorldRefusal::NotSaved(why) => format!("Not saved: {why}"),
        WorldRefusal::NotLoaded(why) => format!("Not loaded: {why}"),
        WorldRefusal::NotDone(why) => format!("Not done: {why}"),
    }
}

fn help() -> Bottle {
    let lines = [
        "OBJ is the name of an object, in one word (sph1) or two (sph 1). Lengths in meters.",
        "ls - names of all objects",
        "mk sph|ssph radius x y z - make a sphere",
        "mk cyl|scyl radius height x y z - make a cylinder along y",
        "mk box|sbox size_x size_y size_z x y z - make a box",
        "set OBJ x y z - put an object elsewhere",
        "rot OBJ rx ry rz - turn an object to these angles about x, y, z, degrees",
        "rot OBJ r00 r01 r02 r10 r11 r12 r20 r21 r22 - turn an object to this rotation matrix",
        "get OBJ - pose of an object: its 4x4 matrix, column by column",
        "def OBJ obs|tgt|gho - make it an obstacle, a target or a ghost (these words will do as well)",
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
