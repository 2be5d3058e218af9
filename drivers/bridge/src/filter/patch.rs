//! Where the filter knows better than the board's reply.

use super::PartBoard;
use mobee_yarp::board::{Get, Joints, Reading, ShadowAxis, mode};
use mobee_yarp::{Bottle, JointData, Value, Vocab};
use std::collections::BTreeSet;

/// The reply with what the filter knows better; `None` if it is right as it is.
pub(super) fn patched(get: &Get, reply: &Bottle, part: &PartBoard, moving: &BTreeSet<usize>) -> Option<Bottle> {
    let axes = part.shadow.axes.len();
    let mut changed = reply.clone();
    match get {
        Get::Done(joints) => {
            // a motion whose outcome is open is not done, whatever the board thinks
            let open = joints.on(axes)?.iter().any(|j| moving.contains(&(part.motors.start + j)));
            if open && let Some(slot @ Value::Int32(_)) = changed.0.get_mut(2) {
                *slot = Value::Int32(0);
            }
        }
        Get::Modes(joints) => overlay(joints, 2, 0, part, &mut changed, |axis, theirs| {
            // a mode that the board is in for reasons of its own (idle, fault, calibration) is shown as it is
            is_ordinary(Vocab(u32::try_from(theirs.as_i64()?).ok()?)).then_some(Value::Vocab(axis.mode))
        })?,
        Get::Values(Reading::ReferenceSpeed, joints) => {
            overlay(joints, 2, 1, part, &mut changed, |axis, _| Some(Value::Float64(axis.ref_speed)))?;
        }
        Get::Values(Reading::ReferenceAcceleration, joints) => {
            overlay(joints, 2, 2, part, &mut changed, |axis, _| Some(Value::Float64(axis.ref_acc)))?;
        }
        _ => return None,
    }
    (changed != *reply).then_some(changed)
}

/// Whether clients may set it, and the driver sets the real one.
fn is_ordinary(theirs: Vocab) -> bool {
    [mode::POSITION, mode::DIRECT, mode::VELOCITY, mode::MIXED].contains(&theirs)
}

/// Lays what the filter knows better over a state that the board told; and what it knows where the board told nothing, as one
/// does that has `state:o` alone.
pub(super) fn shown(part: &PartBoard, own: JointData, told: &mut JointData) {
    if told.velocity.valid().is_none() {
        told.velocity = own.velocity;
    }
    if told.control_modes.valid().is_none() {
        (told.control_modes, told.interaction_modes) = (own.control_modes, own.interaction_modes);
        return;
    }
    for ((slot, own), set) in told.control_modes.values.iter_mut().zip(&own.control_modes.values).zip(&part.set) {
        let theirs = Vocab(u32::from_le_bytes(slot.to_le_bytes()));
        if set.first() == Some(&true) && is_ordinary(theirs) {
            *slot = *own;
        }
    }
}

/// Lays what the client has set over a reply's values, joint by joint.
fn overlay(
    joints: &Joints,
    place: usize,
    which: usize,
    part: &PartBoard,
    reply: &mut Bottle,
    own: impl Fn(&ShadowAxis, &Value) -> Option<Value>,
) -> Option<()> {
    let list = joints.on(part.shadow.axes.len())?;
    let slots: Vec<&mut Value> = match reply.0.get_mut(place)? {
        Value::List(values) => values.0.iter_mut().collect(),
        one => vec![one],
    };
    for (joint, slot) in list.iter().zip(slots) {
        let was_set = part.set.get(*joint).and_then(|s| s.get(which)).copied().unwrap_or_default();
        if let Some(value) = part.shadow.axes.get(*joint).filter(|_| was_set).and_then(|axis| own(axis, slot)) {
            *slot = value;
        }
    }
    Some(())
}
