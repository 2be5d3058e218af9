//! The port filter: a part's control board that any YARP program commands as if it were the robot's own, and safely.
//!
//! The core is pure: it decides what becomes of a request, and is told what came of it.
//!
//! A robot that is only starting is waited for, at most two seconds. Then:
//!
//! | Request | While open | While closed |
//! |---|---|---|
//! | `[get] X ...` of the list in `reads.rs` | to the board, the reply byte for byte; a simulated robot's from its state | `[fail]` |
//! | `[set]` `pos* rel*` | a commit: absolute, finite, within limits, at the joint's reference speed; a joint that stands beyond a limit may stay there | `[fail]` |
//! | `[set] [vmos]`, `command:i` with `vmo* dpo*` | a stream, which ends when it goes quiet | `[fail]`, dropped |
//! | `[set]` `sto*` | brakes; of some moving joints only: holds these where they are | `[fail]` |
//! | `[set]` `vel* acc*` | kept and shown; this part's moves go by them, up to the greatest speed allowed | `[fail]` |
//! | `[set] [icmd]` with `pos posd vel mix`, `[set] [intm]` with `stif` | kept and shown; the driver sets the real ones | `[fail]` |
//! | fewer than two words | `[nak]` | `[fail]` |
//! | all else: limits, encoders, torque, PWM, PID, calibration, amplifiers, other modes, the unknown | `[fail]` | `[fail]` |
//!
//! A reply is the board's own but where the filter knows better: `[don]` is 0 while a motion's outcome is open (a client whose joints
//! have arrived waits for no other client's in the same transaction: gaze may stream all day), and modes
//! and references are the client's where it has set them. A connection whose motion failed gets `[fail]` once, whatever
//! it asks, so that a slow one can't take a rolled-back motion for a finished one; a `[fail]` that it got while the filter
//! was closed counts. A stream has no replies: one that failed is not heard until it was silent for half a second, or its
//! client's RPC connection has got the `[fail]`; one none of whose motors had a part in the contact goes on as the filter opens.

mod device;
mod lines;
mod motions;
mod patch;
mod reads;
#[cfg(test)]
mod tests;

pub(crate) use device::Boards;

use lines::Lines;
use mobee_contract::{Board, Commit, CommitId, Hold, MotionEnd, Setpoints, Status, Time, Verdict};
use mobee_model::Robot;
use mobee_yarp::board::{Ask, Get, Joints, Set, Shadow, ShadowAxis, Streamed, mode, reply};
use mobee_yarp::{Bottle, Field, JointData, Stamp, Vocab};
use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::Arc;

/// How near to its target a joint counts as there for a client that shares the transaction with others, deg.
const ARRIVED: f64 = 0.5;

/// What the core sees of the robot as a request comes in.
pub struct Seen<'a> {
    /// The time.
    pub now: Time,
    /// The time of day, seconds since 1970: what stamps tell.
    pub time_of_day: f64,
    /// The filter's state.
    pub status: Status,
    /// The robot's whole pose, rad.
    pub q: &'a [f64],
    /// How a motion ended.
    pub end_of: &'a dyn Fn(CommitId) -> Option<MotionEnd>,
    /// Which motors made a motion fail, if that is known.
    pub to_blame: &'a dyn Fn(CommitId) -> Option<BTreeSet<usize>>,
}

/// Whether no agent's command passes in this state. A robot that stands still after a retreat that failed, or with
/// something touching it, takes escapes: nobody needs to free it.
pub fn closed(status: Status) -> bool {
    match status {
        Status::Rest | Status::Moving | Status::Escaping => false,
        Status::Starting | Status::Stopping | Status::Retreating | Status::Settling => true,
        Status::Holding(hold) => {
            !matches!(hold, Hold::InContact | Hold::RetreatBlocked | Hold::HistoryTooShort | Hold::RetreatMissed)
        }
    }
}

/// What becomes of a request.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    /// This is the reply.
    Reply(Bottle),
    /// The request is a question, and goes to the board as it is; its reply to [`FilterCore::asked`], or if it has no words of its own,
    /// [`FilterCore::answer`] does.
    Ask,
    /// To be committed; the verdict to [`FilterCore::accepted`].
    Commit(Commit),
    /// To be streamed; the verdict to [`FilterCore::accepted`].
    Stream(Setpoints),
    /// Brake, then reply `[ok]`.
    Stop,
}

/// A client's connection to one of the boards.
#[derive(Clone, Debug, PartialEq)]
pub struct Client<'a> {
    /// The part, an index into the robot's.
    pub part: usize,
    /// The connection.
    pub connection: u64,
    /// The name it gave.
    pub from: &'a str,
    /// Whether it waits for a reply. One that does not never learns anything.
    pub listens: bool,
}

/// One part's board as the filter keeps it.
struct PartBoard {
    motors: Range<usize>,
    shadow: Shadow,
    /// Whether the client has set mode, reference speed, reference acceleration of each joint.
    set: Vec<[bool; 3]>,
    answers: Stamp,
}

/// The core of one robot's filter.
pub struct FilterCore {
    agent: Arc<str>,
    /// The share of a motor's greatest speed that clients may use.
    speed: f64,
    parts: Vec<PartBoard>,
    lines: Lines,
    sensed: Option<Time>,
}

impl FilterCore {
    /// A filter for all parts of a robot, standing at `q` (rad), whose clients may use this share of each motor's greatest
    /// speed.
    pub fn new(name: &str, robot: &Robot, board: &Board, q: &[f64], speed: f64) -> FilterCore {
        let axis = |(i, axis): (usize, &mobee_contract::Axis)| {
            let q = q.get(i).copied().unwrap_or_default().to_degrees();
            let (min, max) = (axis.min.to_degrees(), axis.max.to_degrees());
            ShadowAxis::at_rest(axis.name.clone(), min, max, axis.max_speed.to_degrees(), q)
        };
        let axes: Vec<ShadowAxis> = board.axes.iter().enumerate().map(axis).collect();
        let part = |part: &mobee_model::Part| {
            let own = axes.get(part.motors.clone()).unwrap_or_default().to_vec();
            PartBoard {
                motors: part.motors.clone(),
                set: vec![[false; 3]; own.len()],
                shadow: Shadow { axes: own },
                answers: Stamp::default(),
            }
        };
        FilterCore {
            agent: format!("{name}/filter").into(),
            speed,
            parts: robot.parts.iter().map(part).collect(),
            lines: Lines::default(),
            sensed: None,
        }
    }

    /// The name that its motions go by.
    pub fn agent(&self) -> Arc<str> {
        self.agent.clone()
    }

    /// The reference speeds and accelerations that a real board has (deg/s, deg/s^2), read once at the start.
    pub fn learn(&mut self, part: usize, speeds: &[f64], accelerations: &[f64]) {
        let Some(part) = self.parts.get_mut(part) else { return };
        for (axis, speed) in part.shadow.axes.iter_mut().zip(speeds) {
            axis.ref_speed = *speed;
        }
        for (axis, acceleration) in part.shadow.axes.iter_mut().zip(accelerations) {
            axis.ref_acc = *acceleration;
        }
    }

    /// A request came.
    pub fn request(&mut self, client: &Client, request: &Bottle, seen: &Seen) -> Step {
        self.lines.hear(client, seen);
        if closed(seen.status) || self.lines.failed(client) {
            return Step::Reply(self.fail(client));
        }
        let Some(axes) = self.parts.get(client.part).map(|p| p.shadow.axes.len()) else {
            return Step::Reply(reply::fail());
        };
        if request.0.len() < 2 {
            return Step::Reply(reply::nak());
        }
        if reads::allowed(request) {
            return Step::Ask;
        }
        match Ask::parse(request).filter(|ask| ask.fits(axes)) {
            Some(Ask::Set(set)) => self.set(client, &set, seen).unwrap_or_else(|| Step::Reply(reply::fail())),
            _ => Step::Reply(reply::fail()),
        }
    }

    /// A command of `command:i` came; `None`: nothing is to be done.
    pub fn streamed(&mut self, client: &Client, head: &Bottle, body: &[f64], seen: &Seen) -> Option<Step> {
        self.lines.hear(client, seen);
        // it is heard while the filter is closed, too: who never paused has not been silent
        let deaf = self.lines.deaf(client, seen.now);
        if deaf || closed(seen.status) {
            return None;
        }
        let axes = self.parts.get(client.part)?.shadow.axes.len();
        match Streamed::parse(head, body, axes)? {
            Streamed::Velocity(joints, values) => self.velocities(client, &joints, &values),
            Streamed::Direct(joints, values) => self.directs(client, &joints, &values),
            Streamed::Move(values) => self.moves(client, &Joints::All, &values, seen),
        }
    }

    fn set(&mut self, client: &Client, set: &Set, seen: &Seen) -> Option<Step> {
        match set {
            Set::Move { joints, values, relative } => {
                let mut values = values.clone();
                if *relative {
                    let part = self.parts.get(client.part)?;
                    for (value, joint) in values.iter_mut().zip(joints.on(part.shadow.axes.len())?) {
                        *value += seen.q.get(part.motors.start + joint)?.to_degrees();
                    }
                }
                self.moves(client, joints, &values, seen)
            }
            Set::Velocity(values) => self.velocities(client, &Joints::All, values),
            Set::Stop(joints) => self.stop(client, joints, seen),
            // never passed on: the board would go by them in whatever motion it is told next
            Set::Speed(joints, values) => self.refer(client.part, joints, 1, values, |axis| &mut axis.ref_speed),
            Set::Acceleration(joints, values) => self.refer(client.part, joints, 2, values, |axis| &mut axis.ref_acc),
            Set::Mode(joints, modes) => {
                let known = [mode::POSITION, mode::DIRECT, mode::VELOCITY, mode::MIXED];
                modes.iter().all(|m| known.contains(m)).then_some(())?;
                self.keep(client.part, joints, 0, modes, |axis, mode: &Vocab| axis.mode = *mode)
            }
            Set::Interaction(_, modes) => modes.iter().all(|m| *m == mode::STIFF).then(|| Step::Reply(reply::ok())),
            Set::Limits(..) | Set::SpeedLimits(..) | Set::ResetEncoders(_) | Set::Encoders(..) => None,
        }
    }

    /// Keeps a setting of some joints.
    fn keep<T>(
        &mut self,
        part: usize,
        joints: &Joints,
        which: usize,
        values: &[T],
        put: impl Fn(&mut ShadowAxis, &T),
    ) -> Option<Step> {
        let part = self.parts.get_mut(part)?;
        for (joint, value) in joints.on(part.shadow.axes.len())?.into_iter().zip(values) {
            put(part.shadow.axes.get_mut(joint)?, value);
            *part.set.get_mut(joint)?.get_mut(which)? = true;
        }
        Some(Step::Reply(reply::ok()))
    }

    /// Keeps references. Boards take the amount: a negative one means the same.
    fn refer(
        &mut self,
        part: usize,
        joints: &Joints,
        which: usize,
        values: &[f64],
        slot: fn(&mut ShadowAxis) -> &mut f64,
    ) -> Option<Step> {
        values.iter().all(|v| v.is_finite()).then_some(())?;
        self.keep(part, joints, which, values, |axis, v| *slot(axis) = v.abs())
    }

    /// The verdict on a commit or a stream: the reply.
    pub fn accepted(&mut self, client: &Client, step: &Step, verdict: &Verdict, seen: &Seen) -> Bottle {
        if let Ok(id) = verdict {
            let motors = match step {
                Step::Commit(commit) => commit.target.motors.as_slice(),
                Step::Stream(setpoints) => setpoints.motors.as_slice(),
                _ => &[],
            };
            self.lines.moves(client, *id, motors);
            self.show(client.part, step);
        }
        if closed(seen.status) {
            return self.fail(client);
        }
        if verdict.is_ok() { reply::ok() } else { reply::fail() }
    }

    /// A board with words of its own replied: what the client gets. `None`: the reply as it came.
    pub fn asked(
        &mut self,
        client: &Client,
        request: &Bottle,
        replied: Option<&Bottle>,
        seen: &Seen,
    ) -> Option<Bottle> {
        self.lines.hear(client, seen);
        if closed(seen.status) || self.lines.failed(client) {
            return Some(self.fail(client));
        }
        let Some(replied) = replied else { return Some(reply::fail()) };
        let part = self.parts.get(client.part)?;
        let Some(Ask::Get(get)) = Ask::parse(request) else { return None };
        patch::patched(&get, replied, part, &self.under_way(seen))
    }

    /// The answer to what would be asked of the board, from what is known, for a robot whose board has no words.
    pub fn answer(&mut self, client: &Client, request: &Bottle, seen: &Seen) -> Bottle {
        self.lines.hear(client, seen);
        if closed(seen.status) || self.lines.failed(client) {
            return self.fail(client);
        }
        let moving = self.under_way(seen);
        let Some(part) = self.parts.get_mut(client.part) else { return reply::fail() };
        part.answers = part.answers.next(seen.time_of_day);
        let Some(answer) = part.shadow.answer(request, part.answers) else { return reply::fail() };
        match Ask::parse(request) {
            Some(Ask::Get(get @ Get::Done(_))) => patch::patched(&get, &answer, part, &moving).unwrap_or(answer),
            _ => answer,
        }
    }

    /// The motors that are not done yet, whatever the board thinks: the outcome of their motion is open. A client whose motors have
    /// all arrived does not wait for the other clients in the same transaction.
    fn under_way(&self, seen: &Seen) -> BTreeSet<usize> {
        self.lines.under_way(seen, |motor| {
            let part = self.parts.iter().find(|part| part.motors.contains(&motor));
            let axis = part.and_then(|part| part.shadow.axes.get(motor - part.motors.start));
            axis.zip(seen.q.get(motor)).is_some_and(|(axis, q)| (q.to_degrees() - axis.target).abs() <= ARRIVED)
        })
    }

    /// A new reading of the whole robot.
    pub fn sense(&mut self, at: Time, q: &[f64], status: Status) {
        let secs = self.sensed.map(|last| at.since(last).as_secs_f64());
        self.sensed = Some(at);
        let under_way = !matches!(status, Status::Rest | Status::Holding(_) | Status::Starting);
        for part in &mut self.parts {
            for (axis, q) in part.shadow.axes.iter_mut().zip(q.get(part.motors.clone()).unwrap_or_default()) {
                let q = q.to_degrees();
                let speed = match secs {
                    Some(secs) if secs > 1e-4 => (q - axis.q) / secs,
                    _ => axis.speed,
                };
                (axis.q, axis.speed) = (q, speed);
                axis.done = !under_way || speed.abs() < 0.5;
            }
        }
    }

    /// A part's state as it is shown: as its board told it, with all that it carries, or for a simulated robot what is known;
    /// with the modes that the client has set.
    pub fn state(&self, part: usize, told: Option<JointData>) -> Option<JointData> {
        let part = self.parts.get(part)?;
        // readings tell positions; velocities are their differences, and no more can be had of them
        let acceleration = Field::unknown(part.shadow.axes.len());
        let own = JointData { acceleration, ..part.shadow.joint_data() };
        let Some(mut told) = told else { return Some(own) };
        patch::shown(part, own, &mut told);
        Some(told)
    }

    /// A connection ended.
    pub fn gone(&mut self, connection: u64) {
        self.lines.gone(connection);
    }

    /// `[fail]`, of which the client learns if it listens.
    fn fail(&mut self, client: &Client) -> Bottle {
        if client.listens {
            self.lines.told(client);
        }
        reply::fail()
    }
}
