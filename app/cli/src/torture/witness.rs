//! Checks the true course of a run against the system's reports: contacts computed from every second pose, and the
//! boards' true speeds. A check of the journal can't see events that were never reported; a witness can.

mod joint;
mod pushed;

pub use joint::Joint;

use joint::stopped_by;
use mobee_contract::{CommandKind, Event, Hold, MotorUnits, Pose, Status, Time, Writer};
use mobee_model::{Contact, Pair, Scene, ShapeId, Sweep};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// Distance below the margin at which a pair counts as too close, meters: the robots' poses in a scene are one reading
/// apart.
const READING_SKEW_M: f64 = 0.003;
/// Distance by which a pair may get closer during a retreat than its margin or its start, meters: 1 mm, and as above.
const RETREAT_TOLERANCE_M: f64 = 0.001 + READING_SKEW_M;
/// The same for two robots that are both retreating, meters (I14).
const JOINT_TOLERANCE_M: f64 = 0.001;
/// Encoder error above which readings don't show where the motors are, rad.
const MAX_ENCODER_ERROR_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// Distance up to which pairs of robots are tracked, meters: beyond the margins in use.
const TRACKED_DISTANCE_M: f64 = 0.02;
/// Maximum number of control periods until a contact is answered.
const RESPONSE_PERIODS: u32 = 3;
/// Number of control periods in which an escape starts.
const ESCAPE_START_PERIODS: u32 = 2;
/// Time in which a robot with a closed filter must stop: late commands, a lease that expires, braking.
const STOP_TIME: Duration = Duration::from_millis(1500);
/// Time in which a robot whose readings are lost must stop: its lease, and braking.
const BLIND_STOP_TIME: Duration = Duration::from_millis(700);
/// Ratio to the rest speed above which a motor is in motion.
const MOTION_SPEED_RATIO: f64 = 4.0;
/// Distance that motors may move behind bitwise equal readings before that can be noticed, rad.
const UNNOTICED_RAD: f64 = std::f64::consts::PI / 180.0;
/// Time for which motors may move on behind them, and the distance that they may move after it, rad.
const EQUAL_READINGS_LIMIT: (Duration, f64) = (Duration::from_millis(1500), std::f64::consts::PI / 180.0);
/// Gap between events or speed samples after which the process counts as suspended.
const SUSPENSION_GAP: Duration = Duration::from_millis(100);
/// Time after an external disturbance in which timing promises are not checked: an actor may stall.
const DISTURBANCE_TIME: Duration = Duration::from_secs(3);

/// Observes all robots of a run.
#[derive(Debug, Default)]
pub struct Witness {
    scene: Option<Arc<Scene>>,
    /// Time of its last edit: a reading from before shows no contact with an object that was added then.
    edited: Time,
    poses: Vec<Pose>,
    robots: Vec<WatchedRobot>,
    /// Tracks the true distances between robots, also between readings.
    sweep: Option<Sweep>,
    /// Minimum distances of pairs of robots since the motions that a retreat rolls back began, meters; pairs below the
    /// margin only.
    least: BTreeMap<Pair, f64>,
    /// Times at which the robots' boards will report faults.
    faults: Vec<Vec<Time>>,
    /// Intervals in which the robots' boards are later than stated: robots that retreat on one clock are then not
    /// synchronous.
    late: Vec<Vec<(Time, Time)>>,
    /// Time of the last disturbance.
    disturbed: Time,
    /// Time of the last event or reading.
    now: Time,
    /// Time of the last speed sample.
    looked: Time,
    /// Time since which the process has not been suspended.
    woke: Time,
    /// Retreats of several robots at once.
    pub joint: Joint,
    /// Violations: the invariant, and a sentence.
    pub found: Vec<(&'static str, String)>,
}

#[derive(Debug)]
struct WatchedRobot {
    name: String,
    units: MotorUnits,
    margin: f64,
    /// True if its joints are compliant: its sag differs, so it may come half as close during the retreat as it has
    /// been.
    is_compliant: bool,
    /// Distance by which its joints may rest beside their commanded positions, rad.
    sags: f64,
    period: Duration,
    rest_speed: f64,
    /// True if its controller has a reflex.
    reflex: bool,
    status: Status,
    /// True if its filter is open.
    open: bool,
    /// Time of the last change of `open` or of its status.
    since: Time,
    poses: u64,
    /// Time of its last pose.
    last: Time,
    /// Time since which it is too close to something.
    near: Option<Time>,
    /// During its retreat: the pairs below the margin at its start.
    back: Option<Vec<Contact>>,
    /// True if a motion of it is open.
    moves: bool,
    /// True if it takes part in a joint retreat.
    joint: bool,
    /// Time since which its retreat waits for another robot, or was stopped to be replanned. It rests then, and
    /// contacts are caused by other robots.
    waits: Option<Time>,
    /// The plan of its retreat: its number of poses and the bits of its duration.
    plan: (usize, u64),
    /// True if it blocks all robots of its retreat group.
    holds_up: bool,
    /// True if its encoders have been correct since the motion began.
    honest: bool,
    /// During an escape: the pairs that were close at its start, and the time of the start.
    escape: (Option<Vec<Contact>>, Time),
    /// The newest reading that differed from the previous one, and the time since which a motor moves behind it.
    news: Option<(Pose, Time)>,
    /// The true positions of the motors at that reading, or as the motion set out.
    rested: Option<Vec<f64>>,
    /// The true positions of the motors when the reading had been unchanged for too long.
    late: Option<Vec<f64>>,
    /// Times at which its board will report a fault.
    faults: Vec<Time>,
    /// Time since which its board reports a fault while the filter is open.
    fault: Option<Time>,
    /// Time since which a blocked motor is pushed.
    pushed: Option<Time>,
}

impl WatchedRobot {
    fn new(name: &str, (margin, period, rest_speed): (f64, Duration, f64), at: Time) -> WatchedRobot {
        WatchedRobot {
            name: name.into(),
            units: MotorUnits::default(),
            margin,
            is_compliant: false,
            sags: 0.0,
            period,
            rest_speed,
            reflex: true,
            status: Status::Starting,
            open: false,
            since: at,
            poses: 0,
            last: at,
            near: None,
            back: None,
            moves: false,
            joint: false,
            waits: None,
            plan: (0, 0),
            holds_up: false,
            honest: true,
            escape: (None, at),
            news: None,
            rested: None,
            late: None,
            faults: Vec::new(),
            fault: None,
            pushed: None,
        }
    }

    /// Starts a motion: readings may have been equal while the robot rested.
    fn sets_out(&mut self, now: Time) {
        self.news.iter_mut().for_each(|(_, since)| *since = now);
        (self.rested, self.late) = (None, None);
    }

    /// The promise to check now, and the distance below which a new contact breaks it.
    fn active_promise(&self) -> Option<(&'static str, f64)> {
        match (&self.back, self.open, self.status) {
            (Some(_), false, _) if self.waits.is_none() => {
                Some(("I9", self.margin - self.allowed_approach(self.margin)))
            }
            (None, true, Status::Moving) if self.reflex => Some(("I19", self.margin - READING_SKEW_M)),
            (None, true, Status::Escaping) => Some(("I24", self.margin - self.allowed_approach(self.margin))),
            _ => None,
        }
    }

    /// Distance by which a pair may get closer while the motion is rolled back or an escape runs, meters.
    fn allowed_approach(&self, least: f64) -> f64 {
        if self.is_compliant { RETREAT_TOLERANCE_M.max(0.5 * least + READING_SKEW_M) } else { RETREAT_TOLERANCE_M }
    }

    /// True if a contact below the distance of [`WatchedRobot::active_promise`] breaks the promise: those at the start may
    /// stay.
    fn is_too_near(&self, contact: &Contact) -> bool {
        let escape = self.escape.0.iter().flatten().filter(|_| self.status == Status::Escaping);
        let start = self.back.iter().flatten().chain(escape).find(|c| c.pair == contact.pair);
        start.is_none_or(|start| contact.distance < start.distance - self.allowed_approach(start.distance))
    }
}

impl Witness {
    /// Sets the scene after an edit at this time.
    pub fn scene(&mut self, at: Time, scene: &Arc<Scene>) {
        self.edited = at;
        self.poses.resize_with(scene.robots().len(), || Vec::new().into());
        for (pose, home) in self.poses.iter_mut().zip(scene.home()) {
            if pose.is_empty() {
                *pose = home;
            }
        }
        match &mut self.sweep {
            Some(sweep) => sweep.set_scene(scene.clone()),
            // beyond any margin, so that margins of robots reported later count as well
            None => self.sweep = Some(Sweep::new(scene.clone(), TRACKED_DISTANCE_M)),
        }
        self.scene = Some(scene.clone());
    }

    /// Sets the times at which each robot's board will report faults, in order.
    pub fn board_faults(&mut self, faults: Vec<Vec<Time>>) {
        self.faults = faults;
    }

    /// Sets the intervals in which each robot's board is later than it states.
    pub fn late_boards(&mut self, late: Vec<Vec<(Time, Time)>>) {
        self.late = late;
    }

    /// Processes an event.
    pub fn event(&mut self, at: Time, event: &Event) {
        self.pass(at);
        match event {
            Event::Injected { .. } | Event::Died { .. } | Event::Restarted { .. } => self.disturbed = at,
            Event::Robot { robot, motors, sliding, margin, period, rest_speed, deflection, hold_error, .. } => {
                let period = Duration::try_from_secs_f64(*period).unwrap_or_default();
                let rules = (*margin, period, *rest_speed);
                let units = MotorUnits::new(motors.len(), sliding);
                if let Some(known) = self.robots.iter_mut().find(|r| r.name == *robot) {
                    (known.margin, known.period, known.rest_speed) = rules;
                    (known.units, known.is_compliant, known.sags) = (units, *deflection > 0.0, *hold_error);
                } else {
                    let mut seen = WatchedRobot::new(robot, rules, at);
                    (seen.units, seen.is_compliant, seen.sags) = (units, *deflection > 0.0, *hold_error);
                    seen.faults = self.faults.get(self.robots.len()).cloned().unwrap_or_default();
                    self.robots.push(seen);
                }
            }
            Event::Controller { robot, reflex, .. } => self.update(robot, |r| r.reflex = *reflex),
            Event::Enabled { robot, .. } => self.update(robot, |r| {
                (r.open, r.since) = (true, at);
                r.sets_out(at);
            }),
            Event::Commit { robot, .. } => {
                self.sets_out(robot);
                self.update(robot, |r| {
                    r.escape = (None, at);
                    (r.moves, r.honest) = (true, true);
                    r.sets_out(at);
                });
            }
            Event::Outcome { robot, .. } => self.update(robot, |r| (r.moves, r.joint) = (false, false)),
            Event::Amended { robot, .. } => self.update(robot, |r| r.sets_out(at)),
            Event::Disabled { robot, .. } => {
                self.update(robot, |r| (r.open, r.since, r.back, r.waits, r.fault) = (false, at, None, None, None));
            }
            Event::RetreatBegan { robot, near, poses, secs, .. } => {
                self.update(robot, |r| {
                    (r.back, r.waits) = (Some(near.clone()), None);
                    (r.plan, r.holds_up) = ((*poses, secs.to_bits()), false);
                    r.sets_out(at);
                });
                if self.robots.iter().filter(|r| r.back.is_some()).count() > 1 {
                    self.joint.times += 1;
                    for seen in self.robots.iter_mut().filter(|r| r.back.is_some() && !r.joint) {
                        seen.joint = true;
                        self.joint.retreats += 1;
                    }
                }
            }
            Event::RetreatWaits { robot, .. } => {
                self.joint.waited += 1;
                self.update(robot, |r| (r.waits, r.holds_up) = (Some(at), true));
            }
            // after a joint retreat breaks up, a stopped robot rests until its own retreat begins; contacts are caused
            // by others
            Event::Command { robot, writer: Writer::Reflex, kind: CommandKind::Stop, .. } => {
                self.update(robot, |r| r.waits = r.waits.or(Some(at)).filter(|_| r.back.is_some()));
            }
            Event::RetreatGoesOn { robot } => self.update(robot, |r| (r.waits, r.holds_up) = (None, false)),
            Event::RetreatStopped { robot, reason, what, .. } => {
                if self.robots.iter().any(|r| r.name == *robot && r.joint) {
                    *self.joint.stopped.entry(stopped_by(*reason, what)).or_default() += 1;
                }
                self.update(robot, |r| (r.back, r.waits, r.joint) = (None, None, false));
            }
            Event::State { robot, status } => self.update(robot, |r| {
                (r.status, r.since) = (*status, at);
                r.back = r.back.take().filter(|_| matches!(status, Status::Stopping | Status::Retreating));
            }),
            _ => {}
        }
    }

    fn update(&mut self, robot: &str, change: impl FnMut(&mut WatchedRobot)) {
        self.robots.iter_mut().filter(|r| r.name == robot).for_each(change);
    }

    /// Advances the time, and checks I28: the filter closes within [`RESPONSE_PERIODS`] after a board reports a fault.
    fn pass(&mut self, now: Time) {
        // the process was suspended: no actor ran
        if now.since(self.now) > SUSPENSION_GAP {
            self.disturbed = now;
        }
        self.now = self.now.max(now);
        let disturbed = now.since(self.disturbed) < DISTURBANCE_TIME && self.disturbed > Time::ZERO;
        for seen in &mut self.robots {
            while seen.faults.first().is_some_and(|at| *at <= now) {
                let at = seen.faults.remove(0);
                // a driver that does not read receives no fault, either
                let reads = at.since(seen.last) <= seen.period;
                seen.fault = seen.fault.or(Some(at).filter(|_| seen.open && reads && !disturbed));
            }
            let late = seen.fault.take_if(|at| now.since(*at) > seen.period * RESPONSE_PERIODS);
            if let Some(at) = late.filter(|_| !disturbed) {
                let what =
                    format!("{}: its board reports a fault since {at}, and its filter is open at {now}", seen.name);
                self.found.push(("I28", what));
            }
        }
    }

    /// Processes a pose that was read, and the true positions of the motors.
    pub fn truth(&mut self, robot: usize, at: Time, q: &Pose, truth: &[f64]) {
        let Some(seen) = self.robots.get_mut(robot) else { return };
        // a robot with wrong encoders is not where its readings are
        seen.honest &=
            q.len() == truth.len() && q.iter().zip(truth).all(|(q, is)| (q - is).abs() <= MAX_ENCODER_ERROR_RAD);
        let moved = |from: &[f64]| from.iter().zip(truth).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        match &mut seen.news {
            Some((last, since)) if *last == *q => {
                // The recorded path of a retreat may begin with a rest, or a slow part, whose readings are equal.
                if seen.late.is_none() && moved(seen.rested.get_or_insert_with(|| truth.to_vec())) <= UNNOTICED_RAD {
                    *since = at;
                }
                if at.since(*since) <= EQUAL_READINGS_LIMIT.0 {
                    return;
                }
                let way = moved(seen.late.get_or_insert_with(|| truth.to_vec()));
                // a board whose stop holds the measured position lets a loaded joint sink by its sag
                if way > EQUAL_READINGS_LIMIT.1 + seen.sags {
                    let name = &seen.name;
                    let way = seen.units.told(way, 1);
                    let more = EQUAL_READINGS_LIMIT.0.as_secs_f64();
                    let what = format!(
                        "{name}: a motor moves behind equal readings since {since}, and {more} s later it goes on by {way} at {at}"
                    );
                    self.found.push(("I26", what));
                }
            }
            _ => (seen.news, seen.rested, seen.late) = (Some((q.clone(), at)), None, None),
        }
    }

    /// Processes a pose that was read.
    pub fn pose(&mut self, robot: usize, at: Time, q: &Pose) {
        self.pass(at);
        // the position of a robot without readings is not known
        let unseen: Vec<bool> = self.robots.iter().map(|r| r.status == Status::Holding(Hold::Stale)).collect();
        let (Some(seen), Some(pose)) = (self.robots.get_mut(robot), self.poses.get_mut(robot)) else { return };
        *pose = q.clone();
        (seen.poses, seen.last) = (seen.poses + 1, at);
        let (Some(seen), Some(scene)) = (self.robots.get_mut(robot), &self.scene) else { return };
        let Some((promise, within)) = seen.active_promise() else {
            seen.near = None;
            return;
        };
        // objects put onto the robot at the start of an escape are not its fault: judge it from its first readings on
        if promise == "I24"
            && (seen.escape.0.is_none() || at.since(seen.escape.1) <= seen.period * ESCAPE_START_PERIODS)
        {
            let known = seen.escape.0.get_or_insert_default();
            // an encoder may begin to be wrong during the start: the deepest contact counts
            for contact in scene.contacts(&self.poses, seen.margin) {
                match known.iter_mut().find(|known| known.pair == contact.pair) {
                    Some(known) if known.distance <= contact.distance => {}
                    Some(known) => *known = contact,
                    None => known.push(contact),
                }
            }
        }
        if !seen.poses.is_multiple_of(2) {
            return;
        }
        let is_own = |s: ShapeId| s.robot() == Some(robot);
        let is_seen = |s: ShapeId| s.robot().and_then(|of| unseen.get(of)).is_none_or(|unseen| !unseen);
        let counts = |(a, b): Pair| (is_own(a) || is_own(b)) && is_seen(a) && is_seen(b);
        let own = |c: &Contact| counts(c.pair) && c.distance < within && seen.is_too_near(c);
        let Some(contact) = scene.contacts(&self.poses, within).into_iter().find(own) else {
            seen.near = None;
            return;
        };
        let near = *seen.near.get_or_insert(at.max(self.edited));
        if at.since(near) > seen.period * RESPONSE_PERIODS {
            let a = scene.label(contact.pair.0);
            let b = scene.label(contact.pair.1);
            let mm = contact.distance * 1e3;
            let name = &seen.name;
            let state = match promise {
                "I24" => "the escape that deepens it goes on",
                _ if seen.open => "the filter is open",
                _ => "the retreat goes on",
            };
            self.found.push((promise, format!("{name}: {a} and {b} are at {mm:.1} mm at {at}, and {state}")));
        }
    }

    /// Starts a motion of a robot: distances from before are not rolled back, unless the other robot still moves.
    fn sets_out(&mut self, robot: &str) {
        let named = |of: ShapeId| of.robot().and_then(|i| self.robots.get(i));
        let other = |(a, b): &Pair| [named(*a), named(*b)].into_iter().flatten().find(|r| r.name != robot);
        let of = |(a, b): &Pair| [named(*a), named(*b)].into_iter().flatten().any(|r| r.name == robot);
        self.least.retain(|pair, _| !of(pair) || other(pair).is_some_and(|r| r.moves));
    }

    /// Processes the true positions of all motors at one instant: checks the distances between retreating robots (I14).
    pub fn true_positions(&mut self, at: Time, truth: &[Vec<f64>]) {
        let (Some(sweep), Some(scene)) = (&mut self.sweep, &self.scene) else { return };
        for c in sweep.to(truth) {
            let of = |shape: ShapeId| shape.robot().and_then(|robot| self.robots.get(robot));
            let (Some(a), Some(b)) = (of(c.pair.0), of(c.pair.1)) else { continue };
            let margin = a.margin.min(b.margin);
            let is_held_up =
                |r: &WatchedRobot| self.robots.iter().any(|o| o.back.is_some() && o.holds_up && o.plan == r.plan);
            let goes_back = |r: &WatchedRobot| r.back.is_some() && r.waits.is_none() && !is_held_up(r);
            if !(goes_back(a) && goes_back(b)) {
                let least = self.least.entry(c.pair).or_insert(margin);
                *least = least.min(c.distance);
                continue;
            }
            let start = self.least.get(&c.pair).copied().unwrap_or(margin);
            // the reflex of a robot that comes too close stops it anyway (I9)
            let late = |shape: ShapeId| shape.robot().and_then(|robot| self.late.get(robot)).into_iter().flatten();
            let is_late =
                late(c.pair.0).chain(late(c.pair.1)).any(|(from, to)| (*from..*to + DISTURBANCE_TIME).contains(&at));
            if start - c.distance <= self.joint.nearer || !(a.honest && b.honest) || is_late {
                continue;
            }
            self.joint.nearer = start - c.distance;
            // arms that sag do so differently on the way back: as for I9
            let sags = a.is_compliant || b.is_compliant;
            let tolerance = if sags { JOINT_TOLERANCE_M.max(0.5 * start) } else { JOINT_TOLERANCE_M };
            if self.joint.nearer > tolerance {
                let a = scene.label(c.pair.0);
                let b = scene.label(c.pair.1);
                let [now, start] = [c.distance, start].map(|m| m * 1e3);
                let what = format!("{a} and {b} are at {now:.1} mm during the retreat of both, below {start:.1} mm");
                self.found.push(("I14", format!("{what} at {at}")));
            }
        }
    }

    /// Processes the true speed of a robot's fastest motor, rad/s. Must be called often: a long gap means that the
    /// process was suspended, and timing promises are not checked.
    pub fn speed(&mut self, robot: usize, at: Time, speed: f64) {
        if at.since(self.looked) > SUSPENSION_GAP {
            self.woke = at;
        }
        self.looked = at;
        let lasts = |since: Time| at.since(since.max(self.woke));
        let Some(seen) = self.robots.get(robot) else { return };
        if speed <= MOTION_SPEED_RATIO * seen.rest_speed {
            return;
        }
        let name = &seen.name;
        let status = seen.status;
        let since = seen.since;
        let speed = seen.units.told_speed(speed, 2);
        let goes_back = matches!(status, Status::Retreating | Status::Settling);
        if !seen.open && !goes_back && lasts(since) > STOP_TIME {
            let what = format!("{name}: moves at {speed} at {at}, though closed and {status:?} since {since}");
            self.found.push(("I17", what));
        }
        if let Some(waits) = seen.waits.filter(|waits| lasts(*waits) > STOP_TIME) {
            let what = format!("{name}: moves at {speed} at {at}, though its retreat waits since {waits}");
            self.found.push(("I9", what));
        }
        if lasts(seen.last) > BLIND_STOP_TIME {
            let what = format!("{name}: moves at {speed} at {at}, and no reading came through since {}", seen.last);
            self.found.push(("I8", what));
        }
    }
}

#[cfg(test)]
mod tests;
