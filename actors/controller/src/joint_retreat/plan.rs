//! Where each robot's retreat ends, and how all get there on one clock.
//!
//! Each ends at its own safe pose, if those that go on pass it there. What was recorded does: until the younger safe
//! pose all move as they did, and while a robot rested where it now rests, the others passed it once already. The rest
//! is checked, before anything is driven: where it is not free, the robot that would stand in the way goes back to its
//! previous recorded rest, too; if there is none, the one that can't pass stops where the common past ends.
//!
//! Times here are those of the recorded past, running backwards; a way's own seconds run forwards from its beginning.
//! Poses are in rad, distances between robots in meters.

mod ease;
mod straight;

use crate::history::Recorded;
use crate::ledger::{Places, SafePose, home};
use crate::{RELEASE, Rules, distance};
use mobee_contract::{Axis, Pose, Time};
use mobee_model::{Contact, Robot, Scene, ShapeId, Sweep};
use std::sync::Arc;

/// Share of a motor's greatest speed that a set-point may ask for: what is left is for catching up.
const SHARE: f64 = 0.95;
/// How far thinned way-points may be off the recorded path, rad: at an arm's length of a meter 4 mm, less than half of
/// the usual margin.
const THIN: f64 = 0.004;
/// How many poses of a sweep cost as much as to see whether a robot may rest where it ends.
const AT_ONCE: usize = 8;

/// A robot that is to be taken back.
#[derive(Clone, Debug)]
pub struct Participant {
    /// Its index in the scene.
    pub robot: usize,
    /// Its rules.
    pub rules: Arc<Rules>,
    /// What was recorded without a gap, oldest first.
    pub past: Vec<Recorded>,
    /// Which of these the safe pose was taken from.
    pub start: usize,
    /// Which of these it goes back to: that one, or a later one of a stream that is not undone whole.
    pub end: usize,
    /// The safe pose.
    pub safe: Pose,
    /// Whether it is another try after a failed one: it goes by itself.
    pub again: bool,
    /// Whether its way begins straight off something that no model knows.
    pub pressed: bool,
    /// The motors that its motion has named.
    pub named: Arc<[usize]>,
    /// Where its motors had been sent when the motion began.
    pub places: Places,
    /// What is where.
    pub scene: Arc<Scene>,
    /// Where all robots of the scene are, rad.
    pub poses: Vec<Pose>,
}

impl Participant {
    /// Cuts off a detour: what was recorded after the robot first was about where it is now, at a reading or between
    /// two. A retreat that failed has been recorded, too: gone back whole, the next try would lead into what stopped it
    /// before it leads back out.
    pub fn without_detour(&mut self) {
        let near = 2.0 * self.rules.tolerance;
        let Some(here) = self.past.last().map(|r| r.q.clone()) else { return };
        let passed = |(i, pair): (usize, &[Recorded])| {
            let [a, b] = pair else { return None };
            let passed = passing(a, b, &here);
            (distance(&passed.q, &here) <= near).then_some((i, passed))
        };
        let first = self.past.windows(2).enumerate().skip(self.end).find_map(passed);
        if let Some((before, passed)) = first {
            self.past.truncate(before + 1);
            if self.past.last().is_some_and(|last| last.at < passed.at) {
                self.past.push(passed);
            }
        }
    }

    /// The contacts of the robot in a pose, with the other robots at `poses`, up to this distance, m.
    fn near(&self, q: &Pose, poses: &[Pose], distance: f64) -> Vec<Contact> {
        let mut poses = poses.to_vec();
        poses.get_mut(self.robot).into_iter().for_each(|own| *own = q.clone());
        let own = |shape: ShapeId| shape.robot() == Some(self.robot);
        let mut all = self.scene.contacts(&poses, distance);
        all.retain(|c| own(c.pair.0) || own(c.pair.1));
        all
    }

    /// Whether a pose violates no constraint of the robot.
    fn bears(&self, q: &Pose) -> bool {
        let bears = |robot: &Arc<Robot>| robot.violated(q).next().is_none();
        self.scene.robots().get(self.robot).is_none_or(bears)
    }

    /// Whether the robot may rest in this recorded pose, with the other robots at `poses`: nothing is nearer than where a
    /// contact ends, but what was as near at the safe pose and does not touch, and no constraint is violated.
    fn is_free(&self, index: usize, poses: &[Pose]) -> bool {
        let Some(recorded) = self.past.get(index) else { return false };
        let near = |q: &Pose| self.near(q, poses, self.rules.margin + RELEASE);
        let there = near(&recorded.q);
        if there.iter().any(|c| c.distance < self.rules.margin) || !self.bears(&recorded.q) {
            return false;
        }
        let safe = if there.is_empty() { Vec::new() } else { near(&self.safe) };
        there.iter().all(|c| safe.iter().any(|s| s.pair == c.pair))
    }
}

/// When and where a robot that went straight from one reading to the next was nearest to a pose.
fn passing(a: &Recorded, b: &Recorded, pose: &[f64]) -> Recorded {
    let along = |of: &[f64]| a.q.iter().zip(b.q.iter()).zip(of).map(|((a, b), q)| (b - a) * (q - a)).sum::<f64>();
    let part = (along(pose) / along(&b.q).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    let mut passed = b.clone();
    passed.at = a.at + b.at.since(a.at).mul_f64(part);
    passed.q = a.q.iter().zip(b.q.iter()).map(|(a, b)| a + (b - a) * part).collect();
    passed
}

/// One robot's retreat.
#[derive(Clone, Debug, PartialEq)]
pub struct RetreatPath {
    /// Seconds from the way's beginning, and the pose there: these times are those of all robots that go together.
    pub points: Vec<(f64, Pose)>,
    /// The motors that go it, in order: no other is written to.
    pub motors: Arc<[usize]>,
    /// Whether it is streamed; else the points are few, and moved to.
    pub direct: bool,
    /// Where it ends.
    pub end: SafePose,
    /// Whether that is an earlier rest than the safe pose.
    pub farther: bool,
    /// Whether it ends too early, since another robot stands in the way.
    pub blocked: bool,
    /// Whether it leads off something that no model knows: joints that this has bent come along late.
    pub pressed: bool,
}

impl RetreatPath {
    /// What a whole pose says of the motors that go it.
    pub fn of(&self, q: &[f64]) -> Vec<f64> {
        self.motors.iter().filter_map(|m| q.get(*m)).copied().collect()
    }

    /// How far it goes until its last pose is written: seconds, or way-points that are reached before.
    pub fn end(&self) -> f64 {
        if self.direct {
            self.points.last().map_or(0.0, |(t, _)| *t)
        } else {
            self.points.len().saturating_sub(1) as f64
        }
    }
}

/// A plan for robots that go together. Checked in slices by whoever asks, since all reflexes wait for it and none may
/// be held up.
#[derive(Clone, Debug)]
pub struct Plan {
    /// One for each robot.
    legs: Vec<Leg>,
    /// All times at which one of them was recorded, newest first.
    times: Vec<Time>,
    /// Which of these is to be checked next.
    next: usize,
    /// Whether its robots begin anew: what they were on the way is recorded, too, so that theirs lead there and back again.
    anew: bool,
    /// What is where.
    scene: Arc<Scene>,
    /// Looks for contacts from pose to pose, and between them, while there is something to be checked.
    sweep: Option<Sweep>,
}

/// One robot's part of a plan.
#[derive(Clone, Debug)]
struct Leg {
    /// The robot.
    who: Participant,
    /// Which recorded pose it ends at.
    end: usize,
    /// Since when the robot had rested there, as it was recorded: until then the others passed it where it will rest.
    rested: Time,
    /// Whether it ends too early, since another stands in its way.
    blocked: bool,
    /// Whether it is yet to be seen that the robot may rest where it ends: at its safe pose it may.
    unproved: bool,
}

impl Leg {
    /// When the pose was recorded that it ends at.
    fn ends_at(&self) -> Time {
        self.who.past.get(self.end).map_or(Time::ZERO, |r| r.at)
    }

    /// Whether the robot was at rest in this recorded pose.
    fn rests(&self, index: usize) -> bool {
        self.who.past.get(index).is_some_and(|r| r.speed < self.who.rules.rest_speed)
    }

    /// Whether the robot is, when the clock is back at that time, where it was recorded then.
    fn is_as_recorded(&self, time: Time) -> bool {
        self.ends_at() <= time || self.rested <= time
    }

    /// The first reading of the rest that the robot ends in.
    fn rest_began(&self) -> usize {
        (0..=self.end).rev().take_while(|i| *i == self.end || self.rests(*i)).last().unwrap_or(self.end)
    }

    /// Ends at this recorded pose.
    fn end_at(&mut self, index: usize) {
        self.end = index;
        let began = self.rest_began();
        self.rested = self.who.past.get(began).map_or(Time::ZERO, |r| r.at);
    }

    /// Goes back to the rest before the one it ends in, if one was recorded: whether it does. Only to a rest, which is
    /// a pose that somebody meant.
    fn go_farther(&mut self) -> bool {
        let earlier = (0..self.rest_began()).rev().find(|i| self.rests(*i));
        let found = earlier.filter(|_| !self.blocked);
        found.into_iter().for_each(|index| self.end_at(index));
        found.is_some()
    }

    /// Stops at that time, on its way: not at its safe pose, so that its retreat fails, and holds.
    fn stop_at(&mut self, time: Time) {
        self.end = self.who.past.partition_point(|r| r.at < time).min(self.who.past.len().saturating_sub(1));
        (self.rested, self.blocked) = (self.ends_at(), true);
    }

    /// Where the robot rested, as it was recorded.
    fn recorded(&self) -> Pose {
        let recorded = self.who.past.get(self.end).map(|r| r.q.clone());
        recorded.filter(|_| self.end != self.who.start).unwrap_or_else(|| self.who.safe.clone())
    }

    /// Where it is sent at its end: motors that had been sent to where they then rested are sent there again.
    fn last_pose(&self) -> Pose {
        let (places, tolerance) = (&self.who.places, self.who.rules.tolerance);
        let sent = |(m, q): (usize, &f64)| home(places.get(m).copied().flatten(), *q, tolerance);
        self.recorded().iter().enumerate().map(sent).collect()
    }

    /// The motors that it writes to: those of its motion; and, if it goes farther, those that were sent elsewhere since
    /// then.
    fn motors(&self) -> Arc<[usize]> {
        if self.end >= self.who.start {
            return self.who.named.clone();
        }
        let (then, half) = (self.recorded(), 0.5 * self.who.rules.tolerance);
        let moved = |m: &usize| match (then.get(*m), self.who.safe.get(*m), self.who.places.get(*m)) {
            (Some(then), Some(safe), Some(Some(_))) => (then - safe).abs() > half,
            _ => false,
        };
        (0..then.len()).filter(|m| self.who.named.contains(m) || moved(m)).collect()
    }

    /// Where it is when the clock is back at that time, and whether it moved from there.
    fn at(&self, time: Time) -> (Pose, bool) {
        if time < self.ends_at() {
            return (self.last_pose(), false);
        }
        let after = self.who.past.partition_point(|r| r.at <= time);
        let before = after.checked_sub(1).and_then(|i| self.who.past.get(i));
        let (Some(a), Some(b)) = (before, self.who.past.get(after)) else {
            return (before.map_or_else(|| self.last_pose(), |r| r.q.clone()), false);
        };
        let moved = a.speed.min(b.speed) >= self.who.rules.rest_speed;
        if time == self.ends_at() {
            return (self.last_pose(), moved);
        }
        let part = time.since(a.at).as_secs_f64() / b.at.since(a.at).as_secs_f64().max(1e-9);
        (a.q.iter().zip(b.q.iter()).map(|(a, b)| a + (b - a) * part).collect(), moved)
    }
}

impl Plan {
    /// A plan that has yet to be checked; none for nobody.
    pub fn new(participants: Vec<Participant>) -> Option<Plan> {
        let scene = participants.first()?.scene.clone();
        let leg = |who: Participant| {
            let (end, unproved) = (who.end, who.end > who.start);
            let mut leg = Leg { who, end, rested: Time::ZERO, blocked: false, unproved };
            leg.end_at(end);
            leg
        };
        let legs: Vec<Leg> = participants.into_iter().map(leg).collect();
        let mut times: Vec<Time> = legs.iter().flat_map(|l| l.who.past.iter().map(|r| r.at)).collect();
        times.sort_unstable_by(|a, b| b.cmp(a));
        times.dedup();
        Some(Plan { legs, times, next: 0, anew: false, scene, sweep: None })
    }

    /// The same for robots that begin anew, or not.
    pub fn anew(self, anew: bool) -> Plan {
        Plan { anew, ..self }
    }

    /// Checks so many poses more; whether all is checked now. Whoever gives way changes what the others pass: then all
    /// is checked from the beginning. That ends, since each gives way only towards its past, or once for good.
    pub fn check(&mut self, poses: usize) -> bool {
        let mut left = poses;
        while let Some(leg) = self.legs.iter().position(|leg| leg.unproved) {
            let Some(rest) = left.checked_sub(AT_ONCE) else { return false };
            left = rest;
            self.prove(leg);
        }
        while let Some(time) = self.times.get(self.next).copied() {
            if self.legs.iter().all(|l| l.ends_at() >= time) {
                break;
            }
            if self.legs.iter().all(|l| l.is_as_recorded(time)) {
                self.next += 1; // so it was
                self.sweep.iter_mut().for_each(Sweep::jump);
                continue;
            }
            if left == 0 {
                return false;
            }
            left -= 1;
            let all = self.meet(time);
            // two that pass each other as recorded are no reason, wherever a third one stands by now
            let recorded = |leg: usize| self.legs.get(leg).is_some_and(|l| l.is_as_recorded(time));
            let met = all.into_iter().find(|(a, b)| !(recorded(*a) && recorded(*b)));
            self.next = match met {
                Some((a, b)) if self.give_way(a, b) => {
                    self.sweep.iter_mut().for_each(Sweep::jump);
                    0
                }
                _ => self.next + 1,
            };
        }
        self.sweep = None;
        true
    }

    /// Sees whether a robot may rest where it ends; if not, it ends one recorded pose earlier, at its safe pose at last.
    fn prove(&mut self, leg: usize) {
        let Some(time) = self.legs.get(leg).map(Leg::ends_at) else { return };
        let mut poses = self.legs.first().map(|leg| leg.who.poses.clone()).unwrap_or_default();
        for other in &self.legs {
            poses.get_mut(other.who.robot).into_iter().for_each(|pose| *pose = other.at(time).0);
        }
        let Some(leg) = self.legs.get_mut(leg) else { return };
        leg.unproved = leg.end > leg.who.start && !leg.who.is_free(leg.end, &poses);
        if leg.unproved {
            leg.end_at(leg.end - 1);
        }
    }

    /// Those of them that are too near to each other when the clock is back at that time, or on the way there.
    fn meet(&mut self, time: Time) -> Vec<(usize, usize)> {
        let mut poses = self.scene.home();
        for leg in &self.legs {
            if let Some(pose) = poses.get_mut(leg.who.robot) {
                *pose = leg.at(time).0;
            }
        }
        // the widest of them: who keeps more distance is not to be brought nearer by who keeps less
        let margin = self.legs.iter().map(|l| l.who.rules.margin).fold(0.0, f64::max);
        let sweep = self.sweep.get_or_insert_with(|| Sweep::new(self.scene.clone(), margin + RELEASE));
        let leg_of = |shape: ShapeId| self.legs.iter().position(|l| Some(l.who.robot) == shape.robot());
        let found = sweep.to(&poses).iter().filter_map(|c| Some((leg_of(c.pair.0)?, leg_of(c.pair.1)?)));
        found.filter(|(a, b)| a != b).collect()
    }

    /// One of two that would meet ends elsewhere: the one that would have rested longer goes farther, else the other
    /// stops where all still move as they did. Whether that changed anything.
    fn give_way(&mut self, a: usize, b: usize) -> bool {
        let common = self.legs.iter().map(Leg::ends_at).max().unwrap_or_default();
        let time = |leg: usize| self.legs.get(leg).map_or(Time::ZERO, Leg::ends_at);
        let (younger, older) = if time(a) >= time(b) { (a, b) } else { (b, a) };
        if self.legs.get_mut(younger).is_some_and(Leg::go_farther) {
            return true;
        }
        match self.legs.get_mut(older).filter(|l| !l.blocked && l.ends_at() < common) {
            Some(leg) => {
                leg.stop_at(common);
                true
            }
            None => false,
        }
    }

    /// The ways, in the participants' order: the past backwards at the recorded rate (Algorithm 6), but for when all of
    /// them rested, and no faster than the motors can; set-points gain and lose speed so that a robot that lags can do
    /// so with them.
    pub fn ways(&self) -> Vec<RetreatPath> {
        let last = self.legs.iter().map(Leg::ends_at).min().unwrap_or_default();
        let mut points: Vec<(f64, Pose)> = Vec::new();
        let (mut later, mut dwelt) = (None, false);
        for time in self.times.iter().take_while(|t| **t > last).chain([&last]) {
            let at: Vec<(Pose, bool)> = self.legs.iter().map(|l| l.at(*time)).collect();
            let all: Pose = at.iter().flat_map(|(q, _)| q.iter().copied()).collect();
            if let Some(later) = later.replace(*time) {
                let moved = at.iter().any(|(_, moved)| *moved);
                if !moved && dwelt {
                    points.pop();
                }
                dwelt = !moved;
                let recorded = if moved { later.since(*time).as_secs_f64() } else { 0.0 };
                // a rest of all takes no time, a motion as long as it did, and neither less than the motors need
                let (then, least) = points.last().map_or((0.0, 0.0), |(then, q)| (*then, self.least(q, &all)));
                points.push((then + recorded.max(least), all));
            } else {
                points.push((0.0, all));
            }
        }
        let direct = self.legs.iter().all(|l| l.who.rules.position_direct);
        points = if direct { ease::eased(&points, &self.accelerations(), self.anew) } else { thin(points) };
        let mut from = 0;
        let way = |leg: &Leg| {
            let motors = from..from + leg.who.safe.len();
            from = motors.end;
            let own = |(t, q): &(f64, Pose)| (*t, q.get(motors.clone()).unwrap_or_default().into());
            RetreatPath {
                points: points.iter().map(own).collect(),
                motors: leg.motors(),
                direct,
                end: SafePose { since: leg.ends_at(), q: leg.recorded() },
                farther: leg.end < leg.who.start,
                blocked: leg.blocked,
                pressed: leg.who.pressed,
            }
        };
        self.legs.iter().map(way).collect()
    }

    /// How long the motors need at least from one pose of all robots to another, seconds: a motion of a second may have
    /// been recorded as two readings with a rest between them, and must not be gone back as one.
    fn least(&self, from: &[f64], to: &[f64]) -> f64 {
        let axes = self.legs.iter().flat_map(|l| l.who.rules.axes.iter());
        let secs = |(axis, (a, b)): (&Axis, (&f64, &f64))| (a - b).abs() / (axis.max_speed * SHARE);
        axes.zip(from.iter().zip(to)).map(secs).fold(0.0, f64::max)
    }

    /// The greatest accelerations of all robots' motors, rad/s^2.
    fn accelerations(&self) -> Vec<f64> {
        self.legs.iter().flat_map(|l| l.who.rules.axes.iter()).map(|axis| axis.max_acceleration).collect()
    }
}

/// The points at which the path turns by more than [`THIN`]: a board plans between few moves, and stops at each.
fn thin(points: Vec<(f64, Pose)>) -> Vec<(f64, Pose)> {
    let mut kept: Vec<(f64, Pose)> = Vec::new();
    let mut from = 0;
    for (i, point) in points.iter().enumerate() {
        let (Some((_, a)), Some(before)) = (points.get(from), i.checked_sub(1)) else {
            kept.push(point.clone());
            continue;
        };
        let straight = points.iter().enumerate().take(i).skip(from).all(|(k, (_, p))| {
            let part = (k - from) as f64 / (i - from) as f64;
            let on_line: Vec<f64> = a.iter().zip(point.1.iter()).map(|(a, b)| a + (b - a) * part).collect();
            distance(&on_line, p) <= THIN
        });
        if !straight {
            kept.extend(points.get(before).cloned());
            from = before;
        }
    }
    kept.extend(points.last().cloned());
    kept
}

#[cfg(test)]
mod tests;
