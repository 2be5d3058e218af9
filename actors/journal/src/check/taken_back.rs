//! I22: a motion is rolled back if a contact begins in it, a constraint is violated, a motor stalls, its target
//! is missed, or its agent dies. An escape has no retreat.
//!
//! If measured configurations are available, the retreat is also judged by them ([`RetreatPace`]). Its end is
//! judged by the last set-points: it leads to the safe pose, or to an earlier rest only to let another robot
//! pass.

use super::retreat_pace::RetreatPace;
use super::{FoundViolations, Invariant};
use crate::journal::JournalLine;
use mobee_contract::MAX_BRIDGED_TIME;
use mobee_contract::distance;
use mobee_contract::{Cause, CommandKind, Event, Hold, MotorUnits, Outcome, Pose, Status, Time, Writer};
use std::collections::BTreeMap;

/// Time by which a stream is undone, s, unless the journal states another.
const UNDO: f64 = 0.5;

#[derive(Default)]
pub(super) struct TakenBack {
    robots: BTreeMap<String, RollbackWatch>,
    gave_up: bool,
}

#[derive(Default)]
struct RollbackWatch {
    units: MotorUnits,
    period: f64,
    tolerance: f64,
    rest_speed: f64,
    /// One count of its encoders, rad.
    resolution: f64,
    /// Deflection of its joints under an external load, rad.
    bends: f64,
    /// Sag of its arm, rad: new commands correct it at the end of a retreat.
    sags: f64,
    newest: Option<(Time, Pose)>,
    safe: Option<Pose>,
    motion: RollbackMotion,
    /// True if it holds because an actor of its controller was restarted.
    restarted: bool,
    /// Path of the open motion, if it has a safe pose and the journal states its motors.
    way: Option<RetreatPace>,
    fresh: f64,
    undo: f64,
}

#[derive(Default)]
struct RollbackMotion {
    /// True if a motion with a safe pose is open.
    open: bool,
    /// Reason for which it must be rolled back, for messages.
    cause: Option<&'static str>,
    /// True if it is rolled back although an actor of the robot's controller died in it: the journal then
    /// states no other cause.
    after_all: bool,
    /// True if a retreat was driven.
    driven: bool,
    /// True if the retreat was driven to its last configuration.
    settling: bool,
    /// True if it ended there without having reached the safe pose.
    missed: bool,
    /// True if set-points of its retreat were dropped, so that the last ones written are not its end.
    dropped: bool,
    /// True if the journal explains another end.
    excused: bool,
    /// Number of stops that the reflex has commanded.
    stops: u32,
    /// Time of its acceptance, if it consists of set-points alone.
    stream: Option<Time>,
    /// Time at which the filter closed.
    closed: Option<Time>,
}

fn in_words(cause: &Cause) -> Option<&'static str> {
    match cause {
        Cause::Contact(_) => Some("a contact"),
        Cause::Foreseen(_) => Some("a contact that was foreseen"),
        Cause::Stall { .. } => Some("a motor that stalled"),
        Cause::ExternalTorque { .. } => Some("a torque from outside"),
        Cause::Constraint { .. } => Some("a constraint"),
        Cause::TargetMissed => Some("a target that was missed"),
        Cause::AgentDied => Some("its agent's death"),
        _ => None,
    }
}

impl RollbackWatch {
    fn start_motion(&mut self, escape: bool, motors: &[(usize, f64)], stream: Option<Time>) {
        self.motion = RollbackMotion { open: !escape, stream, ..RollbackMotion::default() };
        let way = (!escape && !motors.is_empty())
            .then(|| RetreatPace::new(motors, self.rest_speed, self.period, &self.units));
        self.way = way.map(|mut way| {
            way.counts(self.resolution);
            if self.sags > 0.0 {
                way.sags(self.sags);
            }
            self.newest.iter().for_each(|(at, q)| _ = way.take(*at, q));
            way
        });
    }

    /// Takes a change of the robot's status. A robot that holds after a restart is stopped only to be rolled
    /// back.
    fn enters(&mut self, status: Status) {
        let restarted = std::mem::replace(&mut self.restarted, status == Status::Holding(Hold::Restarted));
        match status {
            Status::Settling => self.motion.settling = true,
            Status::Stopping => self.motion.after_all |= restarted,
            Status::Holding(Hold::ShuttingDown | Hold::Stale | Hold::Restarted) => self.excuse(),
            _ => {}
        }
    }

    fn excuse(&mut self) {
        self.motion.excused = true;
        self.way = None;
    }

    /// The retreat was aborted. If it reached its end without reaching the safe pose, its last set-points must
    /// have led there.
    fn stopped(&mut self, reason: Hold) {
        let led = self.motion.settling && !self.motion.dropped && !self.motion.excused;
        self.motion.missed = reason == Hold::RetreatMissed && led;
        self.excuse();
    }

    /// The motion is rolled back to a configuration recorded at the given time. That applies to streams only.
    /// It goes back at least by the controller's setting, and not beyond the beginning of the stream. A move is
    /// rolled back completely.
    fn undone_to(&mut self, q: &Pose, recorded: Time) -> Option<String> {
        self.safe = Some(q.clone());
        let (Some(begun), Some(closed)) = (self.motion.stream, self.motion.closed) else {
            return Some("is taken back to where it was on its way, though a move is taken back whole".into());
        };
        let secs = closed.secs() - recorded.secs();
        if secs + 1e-6 < self.undo {
            return Some(format!("is taken back to where it was {secs:.3} s before, and not {} s", self.undo));
        }
        if recorded.secs() + self.fresh < begun.secs() {
            return Some("is taken back to where it was before its stream began".into());
        }
        let was = self.way.as_ref().and_then(|way| way.was_at(recorded))?;
        let away = distance(was, q);
        (away > self.tolerance).then(|| format!("was {} from where it is taken back to", self.units.told(away, 2)))
    }

    /// Checks the last set-points of a retreat that missed its end: a violation if they don't lead to the safe
    /// pose.
    fn misled(&mut self, last: &[(usize, f64)]) -> Option<String> {
        let safe = self.safe.as_ref().filter(|_| std::mem::take(&mut self.motion.missed))?;
        let (sent, end): (Vec<f64>, Vec<f64>) = last.iter().filter_map(|(m, q)| Some((q, safe.get(*m)?))).unzip();
        let away = distance(&sent, &end);
        (away > self.tolerance).then(|| format!("led to {} from its safe pose", self.units.told(away, 2)))
    }

    fn ended(&mut self, id: u64, outcome: Outcome) -> Option<String> {
        let motion = std::mem::take(&mut self.motion);
        let way = self.way.take();
        let cause = motion.cause.filter(|_| motion.open && !motion.excused)?;
        if outcome != Outcome::RolledBack {
            return Some(format!("commit {id} was to be taken back for {cause}, and ended otherwise"));
        }
        if !motion.driven {
            return Some(format!("commit {id} was rolled back for {cause} without a retreat"));
        }
        way?.end()
    }
}

impl Invariant for TakenBack {
    fn on(&mut self, line: &JournalLine, found: &mut FoundViolations<'_>) {
        let wrong = match &line.event {
            Event::Controller { robot, undo, .. } => self.of(robot, |r| r.undo = undo.unwrap_or(UNDO)),
            Event::Robot {
                robot,
                motors,
                sliding,
                period,
                tolerance,
                rest_speed,
                fresh,
                hold_error,
                resolution,
                deflection,
                ..
            } => {
                let robot = self.robots.entry(robot.clone()).or_default();
                robot.fresh = *fresh;
                robot.sags = *hold_error;
                robot.resolution = *resolution;
                robot.bends = *deflection;
                robot.period = *period;
                robot.tolerance = *tolerance;
                robot.rest_speed = *rest_speed;
                robot.units = MotorUnits::new(motors.len(), sliding);
                None
            }
            Event::SafePose { robot, q, .. } => self.of(robot, |r| r.safe = Some(q.clone())),
            Event::SafePoseMoved { robot, q, recorded: Some(at), .. } => self.with(robot, |r| r.undone_to(q, *at)),
            Event::SafePoseMoved { robot, q, .. } => self.moved(robot, q),
            Event::Commit { robot, escape, motors, stream, .. } => {
                self.of(robot, |r| r.start_motion(*escape, motors, stream.then_some(line.at)))
            }
            Event::Amended { robot, motors, stream, .. } => self.of(robot, |r| {
                r.motion.stream = r.motion.stream.filter(|_| *stream || motors.is_empty());
                r.way.iter_mut().for_each(|way| way.join(motors));
            }),
            Event::Disabled { robot, cause, .. } => self.of(robot, |r| {
                // Any other cause, or a second closing, ends the retreat.
                if r.motion.cause.is_some() || in_words(cause).is_none() {
                    r.excuse();
                }
                r.motion.cause = r.motion.cause.or(in_words(cause));
                r.motion.closed = r.motion.closed.or(Some(line.at));
                // A robot that is held by something waits where it is held.
                if matches!(cause, Cause::Stall { .. } | Cause::ExternalTorque { .. }) {
                    r.way.iter_mut().for_each(RetreatPace::is_late);
                    // Bent joints relax on a path of their own, so the measured path is no reference.
                    r.way = r.way.take().filter(|_| r.bends <= 0.0);
                }
            }),
            Event::Bridged { robot, since, until, .. } => self.with(robot, |r| {
                r.way.iter_mut().for_each(RetreatPace::bridge);
                let secs = until.since(*since);
                (secs > MAX_BRIDGED_TIME)
                    .then(|| format!("bridges a gap of {:.3} s in its readings", secs.as_secs_f64()))
            }),
            Event::RetreatBegan { robot, .. } => self.of(robot, |r| {
                (r.motion.driven, r.motion.settling) = (true, false);
                r.way.iter_mut().for_each(|way| way.begin_retreat(line.at));
            }),
            Event::RetreatWaits { .. } => self.all_taken_back(RetreatPace::halts),
            Event::State { robot, status } => self.of(robot, |r| r.enters(*status)),
            Event::RetreatStopped { robot, reason, .. } => self.of(robot, |r| r.stopped(*reason)),
            Event::CommandDropped { robot, writer, .. } => self.of(robot, |r| {
                r.motion.missed = false;
                r.motion.dropped |= *writer == Writer::Reflex;
            }),
            Event::Streamed { robot, writer: Writer::Reflex, last, .. } => self.with(robot, |r| r.misled(last)),
            Event::Command { robot, writer: Writer::Reflex, kind, .. } if *kind == CommandKind::Move => {
                self.of(robot, |r| r.way.iter_mut().for_each(RetreatPace::is_moved))
            }
            Event::Command { robot, writer: Writer::Reflex, kind, .. } if *kind == CommandKind::Stop => {
                self.reflex_stops(robot)
            }
            Event::Died { actor, .. } if !actor.ends_with("/agent") => self.excuse_all(),
            Event::Resumed { .. } => self.excuse_all(),
            Event::GaveUp { .. } => {
                self.gave_up = true;
                self.excuse_all()
            }
            Event::Outcome { robot, id, outcome, .. } => {
                let gave_up = self.gave_up;
                self.with(robot, |r| r.ended(id.0, *outcome).filter(|_| !gave_up))
            }
            _ => None,
        };
        wrong.into_iter().for_each(|what| found.report(what));
    }

    fn pose(&mut self, robot: &str, at: Time, q: &Pose, found: &mut FoundViolations<'_>) {
        let Some(state) = self.robots.get_mut(robot) else { return };
        state.newest = Some((at, q.clone()));
        let wrong = state.way.as_mut().and_then(|way| way.take(at, q));
        found.report_all(wrong.map(|what| format!("{robot}: {what}")));
    }

    fn blind(&mut self, robot: &str) {
        _ = self.of(robot, |r| r.way = None);
    }
}

impl TakenBack {
    fn excuse_all(&mut self) -> Option<String> {
        self.robots.values_mut().for_each(RollbackWatch::excuse);
        None
    }

    /// A second stop before the retreat shows that a board responds late. Set-points reach it as late, and
    /// every robot in the same retreat waits for it, so the duration of these retreats is not judged.
    fn reflex_stops(&mut self, robot: &str) -> Option<String> {
        let motion = &mut self.robots.entry(robot.into()).or_default().motion;
        motion.stops += 1;
        if motion.stops > 1 && !motion.driven { self.all_taken_back(RetreatPace::is_late) } else { None }
    }

    /// Applies a change to all robots that are rolled back: they wait for each other.
    fn all_taken_back(&mut self, change: impl Fn(&mut RetreatPace)) -> Option<String> {
        let taken_back = self.robots.values_mut().filter(|r| r.motion.cause.is_some());
        taken_back.flat_map(|r| &mut r.way).for_each(change);
        None
    }

    /// The safe pose of a motion moved. During the retreat that is allowed only to let another robot pass that
    /// is also rolled back.
    fn moved(&mut self, robot: &str, q: &Pose) -> Option<String> {
        let goes_back = |m: &RollbackMotion| m.open && (m.cause.is_some() || m.after_all);
        let taken_back = |(name, r): (&String, &RollbackWatch)| name != robot && goes_back(&r.motion);
        let for_another = self.robots.iter().any(taken_back);
        self.with(robot, |r| {
            r.safe = Some(q.clone());
            let driven = r.motion.driven && !r.motion.excused;
            r.way.iter_mut().filter(|_| driven).for_each(RetreatPace::forget);
            (driven && !for_another).then(|| "is taken back farther than to its safe pose, and lets nobody pass".into())
        })
    }

    fn of(&mut self, robot: &str, change: impl FnOnce(&mut RollbackWatch)) -> Option<String> {
        self.with(robot, |r| {
            change(r);
            None
        })
    }

    fn with(&mut self, robot: &str, change: impl FnOnce(&mut RollbackWatch) -> Option<String>) -> Option<String> {
        let what = change(self.robots.entry(robot.into()).or_default())?;
        Some(format!("{robot}: {what}"))
    }
}
