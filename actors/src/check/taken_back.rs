//! I22: what is taken back: a motion in which a contact begins, a constraint is violated or a motor stalls, whose target is missed, or whose agent died. An
//! escape has no retreat.
//!
//! Where there are measured poses, the retreat is judged by them, too ([`RetreatPace`]). Where it leads is judged by what was written
//! last: to the safe pose, and to an earlier rest only to let another robot pass.

use super::retreat_pace::RetreatPace;
use super::{Found, Invariant};
use crate::record::journal::JournalLine;
use mobee_contract::{Cause, CommandKind, Event, Hold, MotorUnits, Outcome, Pose, Status, Time, Writer};
use mobee_controller::distance;
use std::collections::BTreeMap;

/// By how much a stream is undone unless the journal tells otherwise, s.
const UNDO: f64 = 0.5;

#[derive(Default)]
pub(super) struct TakenBack {
    robots: BTreeMap<String, Robot>,
    gave_up: bool,
}

#[derive(Default)]
struct Robot {
    units: MotorUnits,
    period: f64,
    tolerance: f64,
    rest_speed: f64,
    /// A count of its encoders, rad.
    resolution: f64,
    /// By how much its joints give way where something pushes them, rad.
    bends: f64,
    /// By how much its arm may sag, rad: it settles by new commands at the end of a retreat.
    sags: f64,
    newest: Option<(Time, Pose)>,
    safe: Option<Pose>,
    motion: Motion,
    /// Whether it holds since an actor of its controller was restarted.
    restarted: bool,
    /// The way of the open motion, if it has a safe pose and tells its motors.
    way: Option<RetreatPace>,
    fresh: f64,
    undo: f64,
}

#[derive(Default)]
struct Motion {
    /// Whether a motion is open that has a safe pose.
    open: bool,
    /// Why it is to be taken back, in words.
    cause: Option<&'static str>,
    /// Whether it is taken back after all, though an actor of the robot's controller died in it: the journal tells no other cause then.
    after_all: bool,
    /// Whether a retreat was driven, and to its last pose.
    driven: bool,
    settling: bool,
    /// Whether it ended there without being back.
    missed: bool,
    /// Whether set-points of its retreat were dropped, so that the last ones written are not its end.
    dropped: bool,
    /// Whether the journal says why it may end otherwise.
    excused: bool,
    /// How often the reflex has told it to stop.
    stops: u32,
    /// When it was accepted, if it consists of set-points alone.
    stream: Option<Time>,
    /// When the filter closed.
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

impl Robot {
    fn set_out(&mut self, escape: bool, motors: &[(usize, f64)], stream: Option<Time>) {
        self.motion = Motion { open: !escape, stream, ..Motion::default() };
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

    /// A robot that holds after a restart is stopped only to be taken back.
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

    /// The retreat was stopped. One that got to its end, and was not back, must have led there.
    fn stopped(&mut self, reason: Hold) {
        let led = self.motion.settling && !self.motion.dropped && !self.motion.excused;
        self.motion.missed = reason == Hold::RetreatMissed && led;
        self.excuse();
    }

    /// It is a stream that is taken back to where it was at that time: not farther than to its beginning, and by no less than
    /// its controller's setting. A move is taken back whole.
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

    /// What was written last during a retreat that missed its end, if that is not its end.
    fn misled(&mut self, last: &[(usize, f64)]) -> Option<String> {
        let safe = self.safe.as_ref().filter(|_| std::mem::take(&mut self.motion.missed))?;
        let (sent, end): (Vec<f64>, Vec<f64>) = last.iter().filter_map(|(m, q)| Some((q, safe.get(*m)?))).unzip();
        let away = distance(&sent, &end);
        (away > self.tolerance).then(|| format!("led to {} from its safe pose", self.units.told(away, 2)))
    }

    fn ended(&mut self, id: u64, outcome: Outcome) -> Option<String> {
        let (motion, way) = (std::mem::take(&mut self.motion), self.way.take());
        let cause = motion.cause.filter(|_| motion.open && !motion.excused)?;
        if outcome != Outcome::RolledBack {
            return Some(format!("commit {id} was to be taken back for {cause}, and ended otherwise"));
        }
        if !motion.driven {
            return Some(format!("commit {id} was rolled back for {cause} without a retreat"));
        }
        way?.over()
    }
}

impl Invariant for TakenBack {
    fn on(&mut self, line: &JournalLine, found: &mut Found<'_>) {
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
                (robot.fresh, robot.sags, robot.resolution) = (*fresh, *hold_error, *resolution);
                robot.bends = *deflection;
                (robot.period, robot.tolerance, robot.rest_speed) = (*period, *tolerance, *rest_speed);
                robot.units = MotorUnits::new(motors.len(), sliding);
                None
            }
            Event::SafePose { robot, q, .. } => self.of(robot, |r| r.safe = Some(q.clone())),
            Event::SafePoseMoved { robot, q, recorded: Some(at), .. } => self.with(robot, |r| r.undone_to(q, *at)),
            Event::SafePoseMoved { robot, q, .. } => self.moved(robot, q),
            Event::Commit { robot, escape, motors, stream, .. } => {
                self.of(robot, |r| r.set_out(*escape, motors, stream.then_some(line.at)))
            }
            Event::Amended { robot, motors, stream, .. } => self.of(robot, |r| {
                r.motion.stream = r.motion.stream.filter(|_| *stream || motors.is_empty());
                r.way.iter_mut().for_each(|way| way.join(motors));
            }),
            Event::Disabled { robot, cause, .. } => self.of(robot, |r| {
                // anything else, or a second closing, ends the retreat
                if r.motion.cause.is_some() || in_words(cause).is_none() {
                    r.excuse();
                }
                r.motion.cause = r.motion.cause.or(in_words(cause));
                r.motion.closed = r.motion.closed.or(Some(line.at));
                // held by something, it waits where it sticks
                if matches!(cause, Cause::Stall { .. } | Cause::ExternalTorque { .. }) {
                    r.way.iter_mut().for_each(RetreatPace::is_late);
                    // an arm whose joints it has bent leaves it on a line of its own: how it was shaken is no path
                    r.way = r.way.take().filter(|_| r.bends <= 0.0);
                }
            }),
            Event::RetreatBegan { robot, .. } => self.of(robot, |r| {
                (r.motion.driven, r.motion.settling) = (true, false);
                r.way.iter_mut().for_each(|way| way.turn(line.at));
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
                self.told_to_stop(robot)
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
        wrong.into_iter().for_each(|what| found.say(what));
    }

    fn pose(&mut self, robot: &str, at: Time, q: &Pose, found: &mut Found<'_>) {
        let Some(state) = self.robots.get_mut(robot) else { return };
        state.newest = Some((at, q.clone()));
        let wrong = state.way.as_mut().and_then(|way| way.take(at, q));
        found.say_all(wrong.map(|what| format!("{robot}: {what}")));
    }

    fn blind(&mut self, robot: &str) {
        _ = self.of(robot, |r| r.way = None);
    }
}

impl TakenBack {
    fn excuse_all(&mut self) -> Option<String> {
        self.robots.values_mut().for_each(Robot::excuse);
        None
    }

    /// Told twice, a board does not heed in time: set-points come to it as late, and whoever goes back with it waits for it, so that
    /// nothing is said by how long that takes.
    fn told_to_stop(&mut self, robot: &str) -> Option<String> {
        let motion = &mut self.robots.entry(robot.into()).or_default().motion;
        motion.stops += 1;
        if motion.stops > 1 && !motion.driven { self.all_taken_back(RetreatPace::is_late) } else { None }
    }

    /// Who goes back with somebody waits with it.
    fn all_taken_back(&mut self, change: impl Fn(&mut RetreatPace)) -> Option<String> {
        let taken_back = self.robots.values_mut().filter(|r| r.motion.cause.is_some());
        taken_back.flat_map(|r| &mut r.way).for_each(change);
        None
    }

    /// The safe pose of a motion moved. During the retreat, to let another robot pass that is taken back, too.
    fn moved(&mut self, robot: &str, q: &Pose) -> Option<String> {
        let goes_back = |m: &Motion| m.open && (m.cause.is_some() || m.after_all);
        let taken_back = |(name, r): (&String, &Robot)| name != robot && goes_back(&r.motion);
        let for_another = self.robots.iter().any(taken_back);
        self.with(robot, |r| {
            r.safe = Some(q.clone());
            let driven = r.motion.driven && !r.motion.excused;
            r.way.iter_mut().filter(|_| driven).for_each(RetreatPace::forget);
            (driven && !for_another).then(|| "is taken back farther than to its safe pose, and lets nobody pass".into())
        })
    }

    fn of(&mut self, robot: &str, change: impl FnOnce(&mut Robot)) -> Option<String> {
        self.with(robot, |r| {
            change(r);
            None
        })
    }

    fn with(&mut self, robot: &str, change: impl FnOnce(&mut Robot) -> Option<String>) -> Option<String> {
        let what = change(self.robots.entry(robot.into()).or_default())?;
        Some(format!("{robot}: {what}"))
    }
}
