//! What really happens, beside what the system says of it: contacts computed anew from every second pose, and the boards' true speeds.
//! A checker of the journal can't see what was never told; a witness can.

mod joint;
mod pushed;

pub use joint::Joint;

use joint::stopped_by;
use mobee_contract::{CommandKind, Event, Hold, MotorUnits, Pose, Status, Time, Writer};
use mobee_model::{Contact, Pair, Scene, ShapeId, Sweep};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// How much nearer than its margin a pair must be, meters: the robots' poses in a scene are a reading apart.
const NEARER: f64 = 0.003;
/// How much nearer than its margin, or than as it began, a pair may come during the retreat, meters: 1 mm, and as above.
const DEEPER: f64 = 0.001 + NEARER;
/// The same of two robots that are both retreating, meters (I14).
const TOGETHER: f64 = 0.001;
/// Encoders that are farther off than this say nothing of where the motors are, rad.
const LIE: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// How far robots are looked for about each other, meters: beyond the margins in use.
const NEAR: f64 = 0.02;
/// How many control periods a contact may go unanswered.
const PERIODS: u32 = 3;
/// In how many control periods an escape sets out.
const SETS_OUT: u32 = 2;
/// How long a closed robot may take to come to rest: late commands, a lease that runs out, braking.
const BRAKES: Duration = Duration::from_millis(1500);
/// How long a robot whose readings get nowhere may go on: its lease, and braking.
const BLIND: Duration = Duration::from_millis(700);
/// How many times the speed that counts as rest is a motion.
const MOVES: f64 = 4.0;
/// For how long motors may go on behind readings that are equal bit for bit, and how far after that, rad.
const UNSEEN: (Duration, f64) = (Duration::from_millis(1500), std::f64::consts::PI / 180.0);
/// When nothing at all happened, or nobody looked, for so long, the process was suspended.
const SUSPENDED: Duration = Duration::from_millis(100);
/// How long after something was done to the run from outside nobody is held to an instant: an actor may stall.
const DISTURBED: Duration = Duration::from_secs(3);

/// Sees all robots of a run.
#[derive(Debug, Default)]
pub struct Witness {
    scene: Option<Arc<Scene>>,
    poses: Vec<Pose>,
    robots: Vec<Seen>,
    /// How near robots really come to each other, between the readings as well.
    sweep: Option<Sweep>,
    /// The least distances of pairs of robots since they set out on what is to be taken back, where below the margin, meters.
    least: BTreeMap<Pair, f64>,
    /// When the boards of the robots are going to report faults.
    faults: Vec<Vec<Time>>,
    /// From when to when the boards of the robots are later than they state: robots that go back on one clock are not together then.
    late: Vec<Vec<(Time, Time)>>,
    /// When something was done to the run last, and what happened last.
    disturbed: Time,
    now: Time,
    /// When the speeds were looked at last, and since when the process has not been suspended.
    looked: Time,
    woke: Time,
    /// What several robots did during the retreat at once.
    pub joint: Joint,
    /// What was seen to be broken: the invariant, and a sentence.
    pub found: Vec<(&'static str, String)>,
}

#[derive(Debug)]
struct Seen {
    name: String,
    units: MotorUnits,
    margin: f64,
    /// Whether its joints give way: it may come half as near on the way back as it has been, since its sag differs.
    gives: bool,
    period: Duration,
    rest_speed: f64,
    /// Whether its controller has a reflex.
    reflex: bool,
    status: Status,
    /// Whether its filter is open, and since when that, or its status, is so.
    open: bool,
    since: Time,
    poses: u64,
    /// When its last pose came through.
    last: Time,
    /// Since when it is too near to something.
    near: Option<Time>,
    /// While it is retreating: the pairs below the margin as that began.
    back: Option<Vec<Contact>>,
    /// Whether a motion of it is open, and whether that is being taken back together with another's.
    moves: bool,
    joint: bool,
    /// Since when its retreat waits for another robot, or was stopped to begin anew: what comes near meanwhile is another's doing, and it
    /// rests.
    waits: Option<Time>,
    /// The plan of its retreat, by its poses and the bits of its seconds, and whether it holds up all who go along.
    plan: (usize, u64),
    holds_up: bool,
    /// Whether its encoders have told the truth since that motion began.
    honest: bool,
    /// While it escapes: the pairs that were near as it set out, and when it did.
    escape: (Option<Vec<Contact>>, Time),
    /// The newest reading that differed from the one before, and since when it is so in the motion under way.
    news: Option<(Pose, Time)>,
    /// Where the motors really were when that had been so for too long.
    late: Option<Vec<f64>>,
    /// When its board reports a fault: the beginnings that are still to come.
    faults: Vec<Time>,
    /// When its board began to report one, with the filter open since.
    fault: Option<Time>,
    /// Since when a motor that is held is pushed on.
    pushed: Option<Time>,
}

impl Seen {
    fn new(name: &str, (margin, period, rest_speed): (f64, Duration, f64), at: Time) -> Seen {
        Seen {
            name: name.into(),
            units: MotorUnits::default(),
            margin,
            gives: false,
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
            late: None,
            faults: Vec::new(),
            fault: None,
            pushed: None,
        }
    }

    /// A motion begins: readings may have been equal while it rested.
    fn sets_out(&mut self, now: Time) {
        self.news.iter_mut().for_each(|(_, since)| *since = now);
        self.late = None;
    }

    /// Which promise is to be kept now, and what is too near for it if it was not near from the start.
    fn watched(&self) -> Option<(&'static str, f64)> {
        match (&self.back, self.open, self.status) {
            (Some(_), false, _) if self.waits.is_none() => Some(("I9", self.margin - self.granted(self.margin))),
            (None, true, Status::Moving) if self.reflex => Some(("I19", self.margin - NEARER)),
            (None, true, Status::Escaping) => Some(("I24", self.margin - self.granted(self.margin))),
            _ => None,
        }
    }

    /// By how much a pair may come nearer than that while it is taken back or escapes, m.
    fn granted(&self, least: f64) -> f64 {
        if self.gives { DEEPER.max(0.5 * least + NEARER) } else { DEEPER }
    }

    /// Whether a contact that is nearer than [`Seen::watched`] says is too near.
    fn is_too_near(&self, contact: &Contact) -> bool {
        let escape = self.escape.0.iter().flatten().filter(|_| self.status == Status::Escaping);
        let start = self.back.iter().flatten().chain(escape).find(|c| c.pair == contact.pair);
        start.is_none_or(|start| contact.distance < start.distance - self.granted(start.distance))
    }
}

impl Witness {
    /// A new scene.
    pub fn scene(&mut self, scene: &Arc<Scene>) {
        self.poses.resize_with(scene.robots().len(), || Vec::new().into());
        for (pose, home) in self.poses.iter_mut().zip(scene.home()) {
            if pose.is_empty() {
                *pose = home;
            }
        }
        match &mut self.sweep {
            Some(sweep) => sweep.set_scene(scene.clone()),
            // farther than any margin, so that the margins of robots that are told later count as well
            None => self.sweep = Some(Sweep::new(scene.clone(), NEAR)),
        }
        self.scene = Some(scene.clone());
    }

    /// When each robot's board is going to report faults, in order of time.
    pub fn board_faults(&mut self, faults: Vec<Vec<Time>>) {
        self.faults = faults;
    }

    /// From when to when each robot's board is later than it states.
    pub fn late_boards(&mut self, late: Vec<Vec<(Time, Time)>>) {
        self.late = late;
    }

    /// An event.
    pub fn event(&mut self, at: Time, event: &Event) {
        self.pass(at);
        match event {
            Event::Injected { .. } | Event::Died { .. } | Event::Restarted { .. } => self.disturbed = at,
            Event::Robot { robot, motors, sliding, margin, period, rest_speed, deflection, .. } => {
                let period = Duration::try_from_secs_f64(*period).unwrap_or_default();
                let rules = (*margin, period, *rest_speed);
                let units = MotorUnits::new(motors.len(), sliding);
                if let Some(known) = self.robots.iter_mut().find(|r| r.name == *robot) {
                    (known.margin, known.period, known.rest_speed) = rules;
                    (known.units, known.gives) = (units, *deflection > 0.0);
                } else {
                    let mut seen = Seen::new(robot, rules, at);
                    (seen.units, seen.gives) = (units, *deflection > 0.0);
                    seen.faults = self.faults.get(self.robots.len()).cloned().unwrap_or_default();
                    self.robots.push(seen);
                }
            }
            Event::Controller { robot, reflex, .. } => self.turn(robot, |r| r.reflex = *reflex),
            Event::Enabled { robot, .. } => self.turn(robot, |r| {
                (r.open, r.since) = (true, at);
                r.sets_out(at);
            }),
            Event::Commit { robot, .. } => {
                self.sets_out(robot);
                self.turn(robot, |r| {
                    r.escape = (None, at);
                    (r.moves, r.honest) = (true, true);
                    r.sets_out(at);
                });
            }
            Event::Outcome { robot, .. } => self.turn(robot, |r| (r.moves, r.joint) = (false, false)),
            Event::Amended { robot, .. } => self.turn(robot, |r| r.sets_out(at)),
            Event::Disabled { robot, .. } => {
                self.turn(robot, |r| (r.open, r.since, r.back, r.waits, r.fault) = (false, at, None, None, None));
            }
            Event::RetreatBegan { robot, near, poses, secs, .. } => {
                self.turn(robot, |r| {
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
                self.turn(robot, |r| (r.waits, r.holds_up) = (Some(at), true));
            }
            // the robots of a joint retreat part: until its own begins anew, one that stopped rests, and what comes near is another's doing
            Event::Command { robot, writer: Writer::Reflex, kind: CommandKind::Stop, .. } => {
                self.turn(robot, |r| r.waits = r.waits.or(Some(at)).filter(|_| r.back.is_some()));
            }
            Event::RetreatGoesOn { robot } => self.turn(robot, |r| (r.waits, r.holds_up) = (None, false)),
            Event::RetreatStopped { robot, reason, what, .. } => {
                if self.robots.iter().any(|r| r.name == *robot && r.joint) {
                    *self.joint.stopped.entry(stopped_by(*reason, what)).or_default() += 1;
                }
                self.turn(robot, |r| (r.back, r.waits, r.joint) = (None, None, false));
            }
            Event::State { robot, status } => self.turn(robot, |r| {
                (r.status, r.since) = (*status, at);
                r.back = r.back.take().filter(|_| matches!(status, Status::Stopping | Status::Retreating));
            }),
            _ => {}
        }
    }

    fn turn(&mut self, robot: &str, change: impl FnMut(&mut Seen)) {
        self.robots.iter_mut().filter(|r| r.name == robot).for_each(change);
    }

    /// Time passes: a board that reports a fault has its filter closed within [`PERIODS`] (I28).
    fn pass(&mut self, now: Time) {
        // the process was suspended: nobody acted
        if now.since(self.now) > SUSPENDED {
            self.disturbed = now;
        }
        self.now = self.now.max(now);
        let disturbed = now.since(self.disturbed) < DISTURBED && self.disturbed > Time::ZERO;
        for seen in &mut self.robots {
            while seen.faults.first().is_some_and(|at| *at <= now) {
                let at = seen.faults.remove(0);
                // a driver that does not read hears of no fault, either
                let reads = at.since(seen.last) <= seen.period;
                seen.fault = seen.fault.or(Some(at).filter(|_| seen.open && reads && !disturbed));
            }
            let late = seen.fault.take_if(|at| now.since(*at) > seen.period * PERIODS);
            if let Some(at) = late.filter(|_| !disturbed) {
                let what =
                    format!("{}: its board reports a fault since {at}, and its filter is open at {now}", seen.name);
                self.found.push(("I28", what));
            }
        }
    }

    /// A pose that was read, and where the motors really were.
    pub fn truth(&mut self, robot: usize, at: Time, q: &Pose, truth: &[f64]) {
        let Some(seen) = self.robots.get_mut(robot) else { return };
        // who is led astray by its encoders is elsewhere than everybody believes
        seen.honest &= q.len() == truth.len() && q.iter().zip(truth).all(|(q, is)| (q - is).abs() <= LIE);
        match &seen.news {
            Some((last, since)) if *last == *q => {
                if at.since(*since) <= UNSEEN.0 {
                    return;
                }
                let then = seen.late.get_or_insert_with(|| truth.to_vec());
                let way = then.iter().zip(truth).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                if way > UNSEEN.1 {
                    let name = &seen.name;
                    let way = seen.units.told(way, 1);
                    let more = UNSEEN.0.as_secs_f64();
                    let what = format!(
                        "{name}: the readings are equal since {since}, and {more} s later a motor goes on by {way} at {at}"
                    );
                    self.found.push(("I26", what));
                }
            }
            _ => (seen.news, seen.late) = (Some((q.clone(), at)), None),
        }
    }

    /// A pose that was read.
    pub fn pose(&mut self, robot: usize, at: Time, q: &Pose) {
        self.pass(at);
        // the position of a robot without readings is not known
        let unseen: Vec<bool> = self.robots.iter().map(|r| r.status == Status::Holding(Hold::Stale)).collect();
        let (Some(seen), Some(pose)) = (self.robots.get_mut(robot), self.poses.get_mut(robot)) else { return };
        *pose = q.clone();
        (seen.poses, seen.last) = (seen.poses + 1, at);
        let (Some(seen), Some(scene)) = (self.robots.get_mut(robot), &self.scene) else { return };
        let Some((promise, within)) = seen.watched() else {
            seen.near = None;
            return;
        };
        // what is put onto it as it sets out is not its doing: it is judged from its first readings on
        if promise == "I24" && (seen.escape.0.is_none() || at.since(seen.escape.1) <= seen.period * SETS_OUT) {
            let known = seen.escape.0.get_or_insert_default();
            // an encoder may begin to lie meanwhile: the deepest of them counts
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
        let near = *seen.near.get_or_insert(at);
        if at.since(near) > seen.period * PERIODS {
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

    /// A robot sets out on a motion: what it passed before then is not taken back, unless another is still on its way.
    fn sets_out(&mut self, robot: &str) {
        let named = |of: ShapeId| of.robot().and_then(|i| self.robots.get(i));
        let other = |(a, b): &Pair| [named(*a), named(*b)].into_iter().flatten().find(|r| r.name != robot);
        let of = |(a, b): &Pair| [named(*a), named(*b)].into_iter().flatten().any(|r| r.name == robot);
        self.least.retain(|pair, _| !of(pair) || other(pair).is_some_and(|r| r.moves));
    }

    /// Where the motors of all robots really are, at one instant: how near those come to each other that are retreating (I14).
    pub fn really(&mut self, at: Time, truth: &[Vec<f64>]) {
        let (Some(sweep), Some(scene)) = (&mut self.sweep, &self.scene) else { return };
        for c in sweep.to(truth) {
            let of = |shape: ShapeId| shape.robot().and_then(|robot| self.robots.get(robot));
            let (Some(a), Some(b)) = (of(c.pair.0), of(c.pair.1)) else { continue };
            let margin = a.margin.min(b.margin);
            let is_held_up = |r: &Seen| self.robots.iter().any(|o| o.back.is_some() && o.holds_up && o.plan == r.plan);
            let goes_back = |r: &Seen| r.back.is_some() && r.waits.is_none() && !is_held_up(r);
            if !(goes_back(a) && goes_back(b)) {
                let least = self.least.entry(c.pair).or_insert(margin);
                *least = least.min(c.distance);
                continue;
            }
            let start = self.least.get(&c.pair).copied().unwrap_or(margin);
            // what comes too near is stopped by its reflex all the same (I9)
            let late = |shape: ShapeId| shape.robot().and_then(|robot| self.late.get(robot)).into_iter().flatten();
            let is_late = late(c.pair.0).chain(late(c.pair.1)).any(|(from, to)| (*from..*to + DISTURBED).contains(&at));
            if start - c.distance <= self.joint.nearer || !(a.honest && b.honest) || is_late {
                continue;
            }
            self.joint.nearer = start - c.distance;
            if self.joint.nearer > TOGETHER {
                let a = scene.label(c.pair.0);
                let b = scene.label(c.pair.1);
                let [now, start] = [c.distance, start].map(|m| m * 1e3);
                let what = format!("{a} and {b} are at {now:.1} mm during the retreat of both, below {start:.1} mm");
                self.found.push(("I14", format!("{what} at {at}")));
            }
        }
    }

    /// How fast the fastest motor of a robot really is, rad/s. Wants to be told again and again: a long time without a look is one in
    /// which the process was suspended, and nobody is held to it.
    pub fn speed(&mut self, robot: usize, at: Time, speed: f64) {
        if at.since(self.looked) > SUSPENDED {
            self.woke = at;
        }
        self.looked = at;
        let lasts = |since: Time| at.since(since.max(self.woke));
        let Some(seen) = self.robots.get(robot) else { return };
        if speed <= MOVES * seen.rest_speed {
            return;
        }
        let name = &seen.name;
        let status = seen.status;
        let since = seen.since;
        let speed = seen.units.told_speed(speed, 2);
        let goes_back = matches!(status, Status::Retreating | Status::Settling);
        if !seen.open && !goes_back && lasts(since) > BRAKES {
            let what = format!("{name}: moves at {speed} at {at}, though closed and {status:?} since {since}");
            self.found.push(("I17", what));
        }
        if let Some(waits) = seen.waits.filter(|waits| lasts(*waits) > BRAKES) {
            let what = format!("{name}: moves at {speed} at {at}, though its retreat waits since {waits}");
            self.found.push(("I9", what));
        }
        if lasts(seen.last) > BLIND {
            let what = format!("{name}: moves at {speed} at {at}, and no reading came through since {}", seen.last);
            self.found.push(("I8", what));
        }
    }
}

#[cfg(test)]
mod tests;
