//! A part's board as seen by YARP programs: conversion of port messages to the filter's requests, and back.
//!
//! | words | request |
//! |---|---|
//! | `[get] X ...` of the list in `reads.rs` | query |
//! | `[set]` `pos* rel*`, `command:i` with `poss` | move |
//! | `[set] [vmos]`, `command:i` with `vmo*`; with `dpo*` | velocities; direct positions |
//! | `[set]` `sto*` | stop |
//! | `[set]` `vel*`; `acc*` | reference speeds; accelerations |
//! | `[set] [icmd]` with `pos posd vel mix`; `[set] [intm]` with `stif` | control modes; stiffness |
//! | fewer than two words | incomplete |
//! | all others | unknown |
//!
//! Boards use meters for prismatic joints, the filter millimeters: requests are converted when they are
//! parsed, answers and states when they are encoded. A real board's own answers pass unchanged.
//!
//! Accepted is `[ok]`, refused `[fail]`, malformed `[nak]`; joints that are not done are `[don]` 0.

mod patch;
mod reads;
#[cfg(test)]
mod tests;

use mobee_filter::filter::{BoardAxis, BoardReply, BoardRequest, ClientMode, KnownBetter, Question};
use mobee_model::JointMotion;
use mobee_yarp::board::{
    Ask, Get, JointKind, Joints, Quantity, Set, Shadow, ShadowAxis, Streamed, Units, mode, reply as words,
};
use mobee_yarp::{Bottle, JointData, JointField, Stamp, Value, Vocab};

/// Units of a board's joints.
pub(crate) fn units(axes: &[BoardAxis]) -> Units {
    Units::new(axes.iter().map(|axis| kind(axis.motion)))
}

/// Parses a request of `rpc:i` to a board with these joints.
pub(crate) fn parse(request: &Bottle, units: &Units) -> BoardRequest {
    if request.0.len() < 2 {
        return BoardRequest::Incomplete;
    }
    let axes = units.axes();
    let parsed = Ask::parse(request).filter(|parsed| parsed.fits(axes)).map(|parsed| units.ask_from_wire(parsed));
    if reads::allowed(request) {
        let question = match parsed {
            Some(Ask::Get(get)) => question(&get, axes),
            _ => None,
        };
        return BoardRequest::Question(question.unwrap_or(Question::Other));
    }
    let order = match parsed {
        Some(Ask::Set(set)) => order(set, axes),
        _ => None,
    };
    order.unwrap_or(BoardRequest::Unknown)
}

fn question(get: &Get, axes: usize) -> Option<Question> {
    match get {
        Get::Done(joints) => joints.on(axes).map(Question::Done),
        Get::Modes(joints) => joints.on(axes).map(Question::Modes),
        Get::Values(Quantity::ReferenceSpeed, joints) => joints.on(axes).map(Question::Speeds),
        Get::Values(Quantity::ReferenceAcceleration, joints) => joints.on(axes).map(Question::Accelerations),
        _ => None,
    }
}

fn order(set: Set, axes: usize) -> Option<BoardRequest> {
    Some(match set {
        Set::Move { joints, values, relative } => BoardRequest::Move { joints: joints.on(axes)?, values, relative },
        Set::Velocity(values) => BoardRequest::Velocity { joints: Joints::All.on(axes)?, values },
        Set::Stop(joints) => BoardRequest::Stop(joints.on(axes)?),
        Set::Speed(joints, values) => BoardRequest::Speed { joints: joints.on(axes)?, values },
        Set::Acceleration(joints, values) => BoardRequest::Acceleration { joints: joints.on(axes)?, values },
        Set::Mode(joints, modes) => {
            let modes: Option<_> = modes.into_iter().map(client_mode).collect();
            BoardRequest::Mode { joints: joints.on(axes)?, modes: modes? }
        }
        Set::Interaction(_, modes) if modes.iter().all(|m| *m == mode::STIFF) => BoardRequest::BeStiff,
        Set::Interaction(..) | Set::Limits(..) | Set::SpeedLimits(..) | Set::ResetEncoders(_) | Set::Encoders(..) => {
            return None;
        }
    })
}

/// Parses a message of `command:i`.
pub(crate) fn streamed(head: &Bottle, body: &[f64], units: &Units) -> BoardRequest {
    let axes = units.axes();
    let request = Streamed::parse(head, body, axes).and_then(|streamed| {
        Some(match units.streamed_from_wire(streamed) {
            Streamed::Velocity(joints, values) => BoardRequest::Velocity { joints: joints.on(axes)?, values },
            Streamed::Direct(joints, values) => BoardRequest::Direct { joints: joints.on(axes)?, values },
            Streamed::Move(values) => BoardRequest::Move { joints: Joints::All.on(axes)?, values, relative: false },
        })
    });
    request.unwrap_or(BoardRequest::Unknown)
}

/// Bottle of a short reply.
pub(crate) fn reply(reply: BoardReply) -> Bottle {
    match reply {
        BoardReply::Accepted => words::ok(),
        BoardReply::Refused => words::fail(),
        BoardReply::Malformed => words::nak(),
    }
}

/// Answers a query for a board that has no protocol of its own, from the state of its joints.
pub(crate) fn answer(axes: &[BoardAxis], known: &KnownBetter, request: &Bottle, stamp: Stamp) -> Bottle {
    let Some(answer) = shadow(axes).answer(request, stamp) else { return words::fail() };
    corrected(known, &answer).unwrap_or(answer)
}

/// Corrects a board's own answer; `None` if it is right.
pub(crate) fn corrected(known: &KnownBetter, answer: &Bottle) -> Option<Bottle> {
    patch::corrected(known, answer)
}

/// References in a board's answer, in our units.
pub(crate) fn references(answer: &Bottle, units: &Units) -> Option<Vec<f64>> {
    let read = answer.get(2).and_then(Value::as_list).and_then(Bottle::numbers)?;
    Some(read.into_iter().enumerate().map(|(j, v)| units.kind(j).from_wire(v)).collect())
}

/// State that a part's board publishes: that of the real board, or for a simulated robot the one known; with
/// the modes that clients have set.
pub(crate) fn state(axes: &[BoardAxis], told: Option<JointData>) -> JointData {
    // a reading has positions only, and velocities are their differences: accelerations can't be derived from
    // them
    let own = JointData { acceleration: JointField::unknown(axes.len()), ..shadow(axes).joint_data() };
    match told {
        None => own,
        Some(told) => patch::shown(axes, own, told),
    }
}

fn shadow(axes: &[BoardAxis]) -> Shadow {
    let axis = |axis: &BoardAxis| {
        let mut shown = ShadowAxis {
            speed: axis.speed,
            target: axis.target,
            ref_speed: axis.ref_speed,
            ref_acc: axis.ref_acc,
            mode: vocab(axis.mode),
            done: axis.done,
            vel_ref: axis.velocity,
            direct_ref: axis.direct,
            ..ShadowAxis::at_rest(axis.name.clone(), axis.min, axis.max, axis.max_speed, axis.q)
        };
        shown.count_as(kind(axis.motion));
        shown
    };
    Shadow { axes: axes.iter().map(axis).collect() }
}

/// Joint kind of a board for a joint motion of the model.
fn kind(motion: JointMotion) -> JointKind {
    match motion {
        JointMotion::Turn => JointKind::Revolute,
        JointMotion::Slide => JointKind::Prismatic,
    }
}

const MODES: [(ClientMode, Vocab); 4] = [
    (ClientMode::Position, mode::POSITION),
    (ClientMode::PositionDirect, mode::DIRECT),
    (ClientMode::Velocity, mode::VELOCITY),
    (ClientMode::Mixed, mode::MIXED),
];

/// Mode of a vocab; `None` if clients may not set it.
fn client_mode(word: Vocab) -> Option<ClientMode> {
    MODES.iter().find(|(_, vocab)| *vocab == word).map(|(mode, _)| *mode)
}

fn vocab(mode: ClientMode) -> Vocab {
    MODES.iter().find(|(m, _)| *m == mode).map_or(mode::UNKNOWN, |(_, vocab)| *vocab)
}
