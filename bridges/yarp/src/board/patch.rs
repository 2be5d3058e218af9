//! Corrections of a board's own answers by the filter.

use super::{client_mode, kind, vocab};
use mobee_filter::filter::{BoardAxis, KnownBetter};
use mobee_yarp::{Bottle, JointData, Value, Vocab};

/// Position of the value, or of the list of values, in a reply.
const VALUES: usize = 2;

/// Corrects the board's reply; `None` if it is right.
pub(super) fn corrected(known: &KnownBetter, reply: &Bottle) -> Option<Bottle> {
    let mut changed = reply.clone();
    let place = changed.0.get_mut(VALUES)?;
    match known {
        KnownBetter::Nothing => return None,
        KnownBetter::NotDone => {
            if let Value::Int32(done) = place {
                *done = 0;
            }
        }
        KnownBetter::Modes(modes) => overlay(place, modes, |mode, theirs| {
            let theirs = Vocab(u32::try_from(theirs.as_i64()?).ok()?);
            client_mode(theirs).map(|_| Value::Vocab(vocab(*mode)))
        }),
        KnownBetter::References(values) => {
            overlay(place, values, |(value, motion), _| Some(Value::Float64(kind(*motion).to_wire(*value))));
        }
    }
    (changed != *reply).then_some(changed)
}

/// Replaces the values of a reply by known ones, joint by joint.
fn overlay<T>(place: &mut Value, known: &[Option<T>], own: impl Fn(&T, &Value) -> Option<Value>) {
    let slots: Vec<&mut Value> = match place {
        Value::List(values) => values.0.iter_mut().collect(),
        one => vec![one],
    };
    for (known, slot) in known.iter().zip(slots) {
        if let Some(value) = known.as_ref().and_then(|known| own(known, slot)) {
            *slot = value;
        }
    }
}

/// Corrects the state of a real board, and adds fields that the board does not send, because it has `state:o`
/// only.
pub(super) fn shown(axes: &[BoardAxis], own: JointData, mut told: JointData) -> JointData {
    if told.velocity.valid().is_none() {
        told.velocity = own.velocity;
    }
    if told.control_modes.valid().is_none() {
        (told.control_modes, told.interaction_modes) = (own.control_modes, own.interaction_modes);
        return told;
    }
    for ((slot, own), axis) in told.control_modes.values.iter_mut().zip(&own.control_modes.values).zip(axes) {
        let theirs = Vocab(u32::from_le_bytes(slot.to_le_bytes()));
        if axis.set.mode && client_mode(theirs).is_some() {
            *slot = *own;
        }
    }
    told
}
