//! Plan of a joint retreat: the end of each robot's path, and the paths of all robots on one clock.
//!
//! Each robot ends at its own safe pose if the others can pass it there. The recording proves most of this: until the
//! younger safe pose all robots move as they did, and while a robot rested where it now rests, the others have passed
//! it once already. The rest is checked before any motion. Where it is not free, the blocking robot retreats farther,
//! to its previous recorded rest; if there is none, the robot that cannot pass stops where the common past ends.
//!
//! Times here are those of the recorded past, running backwards; the seconds of a path run forwards from its
//! beginning. Configurations are in rad, distances between robots in meters.

mod ease;
mod straight;

use crate::history::Recorded;
use crate::ledger::{Places, SafePose, home};
use crate::{RELEASE, Rules};
use mobee_contract::{Axis, Pose, Time, distance};
use mobee_model::{Contact, Robot, Scene, ShapeId, Sweep};
use std::sync::Arc;

/// Greatest speed of set-points, as a share of a motor's greatest speed: the rest is for catching up.
const MAX_SPEED_SHARE: f64 = 0.95;
/// Greatest deviation of simplified way-points from the recorded path, rad: 4 mm at an arm's length of a meter, less
/// than half of the usual margin.
const PATH_TOLERANCE: f64 = 0.004;
/// Cost of checking whether a robot may rest at its end, in configurations of a sweep.
const REST_CHECK_COST: usize = 8;

/// A robot that is to retreat, and its recording.
#[derive(Clone, Debug)]
pub struct Participant {
    /// Index in the scene.
    pub robot: usize,
    /// Parameters of its controller.
    pub rules: Arc<Rules>,
    /// Recorded configurations without a gap, oldest first.
    pub past: Vec<Recorded>,
    /// Index in `past` of the safe pose.
    pub start: usize,
    /// Index in `past` of the retreat's end: the safe pose, or a later configuration of a stream that is undone
    /// partially.
    pub end: usize,
    /// Safe pose.
    pub safe: Pose,
    /// True if this is a retry after a failed retreat: it is planned alone.
    pub again: bool,
    /// True if its path begins with a straight line away from an obstacle that is not in the model.
    pub pressed: bool,
    /// Motors named by the motion, and those that a contact has bent.
    pub named: Arc<[usize]>,
    /// Commanded positions of the motors at the beginning of the motion.
    pub places: Places,
    /// Scene.
    pub scene: Arc<Scene>,
    /// Configurations of all robots of the scene, rad.
    pub poses: Vec<Pose>,
}

impl Participant {
    /// Removes a detour: all recordings after the robot first was close to its present configuration, at a reading or
    /// between two. A failed retreat was recorded as well: a retry along it would lead into the obstruction before it
    /// leads back out.
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

    /// Contacts of the robot in a configuration, with the other robots at `poses`, up to this distance, m.
    fn near(&self, q: &Pose, poses: &[Pose], distance: f64) -> Vec<Contact> {
        let mut poses = poses.to_vec();
        poses.get_mut(self.robot).into_iter().for_each(|own| *own = q.clone());
        let own = |shape: ShapeId| shape.robot() == Some(self.robot);
        let mut all = self.scene.contacts(&poses, distance);
        all.retain(|c| own(c.pair.0) || own(c.pair.1));
        all
    }

    /// Returns whether a configuration violates no constraint of the robot.
    fn satisfies_constraints(&self, q: &Pose) -> bool {
        let satisfies_constraints = |robot: &Arc<Robot>| robot.violated(q).next().is_none();
        self.scene.robots().get(self.robot).is_none_or(satisfies_constraints)
    }

    /// Returns whether the robot may rest in this recorded configuration, with the other robots at `poses`. All pairs
    /// must be beyond the distance at which a contact ends, unless they are that close at the safe pose as well and
    /// do not touch; and no constraint may be violated.
    fn is_free(&self, index: usize, poses: &[Pose]) -> bool {
        let Some(recorded) = self.past.get(index) else { return false };
        let near = |q: &Pose| self.near(q, poses, self.rules.margin + RELEASE);
        let there = near(&recorded.q);
        if there.iter().any(|c| c.distance < self.rules.margin) || !self.satisfies_constraints(&recorded.q) {
            return false;
        }
        let safe = if there.is_empty() { Vec::new() } else { near(&self.safe) };
        there.iter().all(|c| safe.iter().any(|s| s.pair == c.pair))
    }
}

/// Point of the straight line between two readings that is nearest to a configuration, with its time.
fn passing(a: &Recorded, b: &Recorded, pose: &[f64]) -> Recorded {
    let along = |of: &[f64]| a.q.iter().zip(b.q.iter()).zip(of).map(|((a, b), q)| (b - a) * (q - a)).sum::<f64>();
    let part = (along(pose) / along(&b.q).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    let mut passed = b.clone();
    passed.at = a.at + b.at.since(a.at).mul_f64(part);
    passed.q = a.q.iter().zip(b.q.iter()).map(|(a, b)| a + (b - a) * part).collect();
    passed
}

/// Retreat path of one robot.
#[derive(Clone, Debug, PartialEq)]
pub struct RetreatPath {
    /// Seconds from the path's beginning, and the configuration there. All robots of the group have the same times.
    pub points: Vec<(f64, Pose)>,
    /// Motors that move on the path, in ascending order: no other motor is commanded.
    pub motors: Arc<[usize]>,
    /// True if the path is streamed; else the points are few, and the board moves to each.
    pub direct: bool,
    /// End of the path.
    pub end: SafePose,
    /// True if the end is an earlier rest than the safe pose.
    pub farther: bool,
    /// True if the path ends before the safe pose, since another robot blocks it.
    pub blocked: bool,
    /// True if the path leads away from an obstacle that is not in the model: joints bent by it follow late.
    pub pressed: bool,
}

impl RetreatPath {
    /// Selects the values of the path's motors from a whole configuration.
    pub fn of(&self, q: &[f64]) -> Vec<f64> {
        self.motors.iter().filter_map(|m| q.get(*m)).copied().collect()
    }

    /// Progress at which the last set-point is written: seconds, or number of way-points reached before.
    pub fn end(&self) -> f64 {
        if self.direct {
            self.points.last().map_or(0.0, |(t, _)| *t)
        } else {
            self.points.len().saturating_sub(1) as f64
        }
    }
}

/// Plan for a retreat group. The requesting reflexes check it in slices, since all reflexes wait for it and none may
/// be delayed.
#[derive(Clone, Debug)]
pub struct JointRetreatPlan {
    /// One leg per robot.
    legs: Vec<RetreatLeg>,
    /// Times of all recordings, newest first.
    times: Vec<Time>,
    /// Index of the next time to check.
    next: usize,
    /// True if the robots are replanned: their retreat so far was recorded as well, so that their paths lead there
    /// and back again.
    replan: bool,
    /// Scene.
    scene: Arc<Scene>,
    /// Collision check from configuration to configuration, and between them, while the plan is being checked.
    sweep: Option<Sweep>,
}

/// Part of a plan for one robot.
#[derive(Clone, Debug)]
struct RetreatLeg {
    /// Robot and recording.
    participant: Participant,
    /// Index in `past` of the end.
    end: usize,
    /// Recorded time since which the robot had rested there: at and after that time the others passed it where it
    /// will rest.
    rested: Time,
    /// True if the leg ends early, since another robot blocks it.
    blocked: bool,
    /// True if it is yet to be checked that the robot may rest at the end. At its safe pose it may.
    end_unchecked: bool,
}

impl RetreatLeg {
    /// Recorded time of the end.
    fn ends_at(&self) -> Time {
        self.participant.past.get(self.end).map_or(Time::ZERO, |r| r.at)
    }

    /// Returns whether the robot was at rest in this recorded configuration.
    fn rests(&self, index: usize) -> bool {
        self.participant.past.get(index).is_some_and(|r| r.speed < self.participant.rules.rest_speed)
    }

    /// Returns whether the robot is, when the clock is back at that time, where it was recorded then.
    fn is_as_recorded(&self, time: Time) -> bool {
        (self.ends_at() <= time && !self.is_bridged(time)) || self.rested <= time
    }

    /// Returns whether the robot's path at that time was commanded and not measured.
    fn is_bridged(&self, time: Time) -> bool {
        let next = self.participant.past.partition_point(|r| r.at < time);
        self.participant.past.get(next).is_some_and(|r| r.bridged)
    }

    /// Index of the first reading of the rest at the end.
    fn rest_began(&self) -> usize {
        (0..=self.end).rev().take_while(|i| *i == self.end || self.rests(*i)).last().unwrap_or(self.end)
    }

    /// Sets the end to this recorded configuration.
    fn end_at(&mut self, index: usize) {
        self.end = index;
        let began = self.rest_began();
        self.rested = self.participant.past.get(began).map_or(Time::ZERO, |r| r.at);
    }

    /// Moves the end to the previous recorded rest, if there is one. Returns whether it did. Only a rest qualifies:
    /// it was an intended configuration.
    fn go_farther(&mut self) -> bool {
        let earlier = (0..self.rest_began()).rev().find(|i| self.rests(*i));
        let found = earlier.filter(|_| !self.blocked);
        found.into_iter().for_each(|index| self.end_at(index));
        found.is_some()
    }

    /// Ends the leg on its path, at that time. This is not the safe pose, so the retreat fails, and the robot holds.
    fn stop_at(&mut self, time: Time) {
        self.end =
            self.participant.past.partition_point(|r| r.at < time).min(self.participant.past.len().saturating_sub(1));
        self.rested = self.ends_at();
        self.blocked = true;
    }

    /// Recorded configuration at the end.
    fn recorded(&self) -> Pose {
        let recorded = self.participant.past.get(self.end).map(|r| r.q.clone());
        recorded.filter(|_| self.end != self.participant.start).unwrap_or_else(|| self.participant.safe.clone())
    }

    /// Last set-point: a motor that rested where it had been sent is sent there again.
    fn last_pose(&self) -> Pose {
        let places = &self.participant.places;
        let tolerance = self.participant.rules.tolerance;
        let sent = |(m, q): (usize, &f64)| home(places.get(m).copied().flatten(), *q, tolerance);
        self.recorded().iter().enumerate().map(sent).collect()
    }

    /// Motors of the path: those of the motion and those that a contact has bent; and if the path goes farther, also those that were sent elsewhere
    /// since then.
    fn motors(&self) -> Arc<[usize]> {
        if self.end >= self.participant.start {
            return self.participant.named.clone();
        }
        let then = self.recorded();
        let half = 0.5 * self.participant.rules.tolerance;
        let moved = |m: &usize| match (then.get(*m), self.participant.safe.get(*m), self.participant.places.get(*m)) {
            (Some(then), Some(safe), Some(Some(_))) => (then - safe).abs() > half,
            _ => false,
        };
        (0..then.len()).filter(|m| self.participant.named.contains(m) || moved(m)).collect()
    }

    /// Configuration when the clock is back at that time, and whether the robot moved there.
    fn at(&self, time: Time) -> (Pose, bool) {
        if time < self.ends_at() {
            return (self.last_pose(), false);
        }
        let after = self.participant.past.partition_point(|r| r.at <= time);
        let before = after.checked_sub(1).and_then(|i| self.participant.past.get(i));
        let (Some(a), Some(b)) = (before, self.participant.past.get(after)) else {
            return (before.map_or_else(|| self.last_pose(), |r| r.q.clone()), false);
        };
        let moved = a.speed.min(b.speed) >= self.participant.rules.rest_speed;
        if time == self.ends_at() {
            return (self.last_pose(), moved);
        }
        let part = time.since(a.at).as_secs_f64() / b.at.since(a.at).as_secs_f64().max(1e-9);
        (a.q.iter().zip(b.q.iter()).map(|(a, b)| a + (b - a) * part).collect(), moved)
    }
}

impl JointRetreatPlan {
    /// Creates an unchecked plan. Returns `None` without participants.
    pub fn new(participants: Vec<Participant>) -> Option<JointRetreatPlan> {
        let scene = participants.first()?.scene.clone();
        let leg = |participant: Participant| {
            let end = participant.end;
            let end_unchecked = end > participant.start;
            let mut leg = RetreatLeg { participant, end, rested: Time::ZERO, blocked: false, end_unchecked };
            leg.end_at(end);
            leg
        };
        let legs: Vec<RetreatLeg> = participants.into_iter().map(leg).collect();
        let mut times: Vec<Time> = legs.iter().flat_map(|l| l.participant.past.iter().map(|r| r.at)).collect();
        times.sort_unstable_by(|a, b| b.cmp(a));
        times.dedup();
        Some(JointRetreatPlan { legs, times, next: 0, replan: false, scene, sweep: None })
    }

    /// Sets whether the robots are replanned.
    pub fn replan(self, replan: bool) -> JointRetreatPlan {
        JointRetreatPlan { replan, ..self }
    }

    /// Checks up to this number of configurations. Returns whether the whole plan is checked. A robot that gives way
    /// changes what the others pass, so the check starts again. It terminates, since a robot gives way only towards
    /// its past, or once for good.
    pub fn check(&mut self, poses: usize) -> bool {
        let mut left = poses;
        while let Some(leg) = self.legs.iter().position(|leg| leg.end_unchecked) {
            let Some(rest) = left.checked_sub(REST_CHECK_COST) else { return false };
            left = rest;
            self.check_end(leg);
        }
        while let Some(time) = self.times.get(self.next).copied() {
            if self.legs.iter().all(|l| l.ends_at() >= time) {
                break;
            }
            if self.legs.iter().all(|l| l.is_as_recorded(time)) {
                self.next += 1; // as recorded
                self.sweep.iter_mut().for_each(Sweep::jump);
                continue;
            }
            if left == 0 {
                return false;
            }
            left -= 1;
            let all = self.colliding(time);
            // Two robots that pass each other as recorded need no change, wherever a third one stands by now.
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

    /// Checks whether a robot may rest at its end. If not, the end moves one recorded configuration back, to the safe
    /// pose at most.
    fn check_end(&mut self, leg: usize) {
        let Some(time) = self.legs.get(leg).map(RetreatLeg::ends_at) else { return };
        let mut poses = self.legs.first().map(|leg| leg.participant.poses.clone()).unwrap_or_default();
        for other in &self.legs {
            poses.get_mut(other.participant.robot).into_iter().for_each(|pose| *pose = other.at(time).0);
        }
        let Some(leg) = self.legs.get_mut(leg) else { return };
        leg.end_unchecked = leg.end > leg.participant.start && !leg.participant.is_free(leg.end, &poses);
        if leg.end_unchecked {
            leg.end_at(leg.end - 1);
        }
    }

    /// Returns the pairs of legs that are too close to each other when the clock is back at that time, or on the way
    /// there.
    fn colliding(&mut self, time: Time) -> Vec<(usize, usize)> {
        let mut poses = self.scene.home();
        for leg in &self.legs {
            if let Some(pose) = poses.get_mut(leg.participant.robot) {
                *pose = leg.at(time).0;
            }
        }
        // The widest margin: a robot with a wider margin must not be approached by one with a narrower margin.
        let margin = self.legs.iter().map(|l| l.participant.rules.margin).fold(0.0, f64::max);
        let sweep = self.sweep.get_or_insert_with(|| Sweep::new(self.scene.clone(), margin + RELEASE));
        let leg_of = |shape: ShapeId| self.legs.iter().position(|l| Some(l.participant.robot) == shape.robot());
        let found = sweep.to(&poses).iter().filter_map(|c| Some((leg_of(c.pair.0)?, leg_of(c.pair.1)?)));
        found.filter(|(a, b)| a != b).collect()
    }

    /// Changes the end of one of two robots that would collide: the robot that would have rested longer retreats
    /// farther; else the other one stops where all still move as they did. Returns whether anything changed.
    fn give_way(&mut self, a: usize, b: usize) -> bool {
        let common = self.legs.iter().map(RetreatLeg::ends_at).max().unwrap_or_default();
        let time = |leg: usize| self.legs.get(leg).map_or(Time::ZERO, RetreatLeg::ends_at);
        let (younger, older) = if time(a) >= time(b) { (a, b) } else { (b, a) };
        if self.legs.get_mut(younger).is_some_and(RetreatLeg::go_farther) {
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

    /// Computes the paths, in the participants' order: the past backwards at the recorded rate (Algorithm 6), without
    /// common rests, and no faster than the motors can. Set-points accelerate and brake such that a lagging robot can
    /// follow.
    pub fn paths(&self) -> Vec<RetreatPath> {
        let last = self.legs.iter().map(RetreatLeg::ends_at).min().unwrap_or_default();
        let mut points: Vec<(f64, Pose)> = Vec::new();
        let mut later = None;
        let mut dwelt = false;
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
                // A common rest takes no time, a motion its recorded time, and neither less than the motors need.
                let (then, least) = points.last().map_or((0.0, 0.0), |(then, q)| (*then, self.least(q, &all)));
                points.push((then + recorded.max(least), all));
            } else {
                points.push((0.0, all));
            }
        }
        let direct = self.legs.iter().all(|l| l.participant.rules.position_direct);
        points = if direct { ease::eased(&points, &self.accelerations(), self.replan) } else { simplify(points) };
        let mut from = 0;
        let path = |leg: &RetreatLeg| {
            let motors = from..from + leg.participant.safe.len();
            from = motors.end;
            let own = |(t, q): &(f64, Pose)| (*t, q.get(motors.clone()).unwrap_or_default().into());
            RetreatPath {
                points: points.iter().map(own).collect(),
                motors: leg.motors(),
                direct,
                end: SafePose { since: leg.ends_at(), q: leg.recorded() },
                farther: leg.end < leg.participant.start,
                blocked: leg.blocked,
                pressed: leg.participant.pressed,
            }
        };
        self.legs.iter().map(path).collect()
    }

    /// Least time that the motors need from one configuration of all robots to another, seconds. A motion of a second
    /// may have been recorded as two readings with a rest between them, and must not be driven as a jump.
    fn least(&self, from: &[f64], to: &[f64]) -> f64 {
        let axes = self.legs.iter().flat_map(|l| l.participant.rules.axes.iter());
        let secs = |(axis, (a, b)): (&Axis, (&f64, &f64))| (a - b).abs() / (axis.max_speed * MAX_SPEED_SHARE);
        axes.zip(from.iter().zip(to)).map(secs).fold(0.0, f64::max)
    }

    /// Greatest accelerations of all robots' motors, rad/s^2.
    fn accelerations(&self) -> Vec<f64> {
        self.legs.iter().flat_map(|l| l.participant.rules.axes.iter()).map(|axis| axis.max_acceleration).collect()
    }
}

/// Points at which the path bends by more than [`PATH_TOLERANCE`]: a board stops at each way-point, so there should
/// be few.
fn simplify(points: Vec<(f64, Pose)>) -> Vec<(f64, Pose)> {
    let mut simplified: Vec<(f64, Pose)> = Vec::new();
    let mut from = 0;
    for (i, point) in points.iter().enumerate() {
        let (Some((_, a)), Some(before)) = (points.get(from), i.checked_sub(1)) else {
            simplified.push(point.clone());
            continue;
        };
        let straight = points.iter().enumerate().take(i).skip(from).all(|(k, (_, p))| {
            let part = (k - from) as f64 / (i - from) as f64;
            let on_line: Vec<f64> = a.iter().zip(point.1.iter()).map(|(a, b)| a + (b - a) * part).collect();
            distance(&on_line, p) <= PATH_TOLERANCE
        });
        if !straight {
            simplified.extend(points.get(before).cloned());
            from = before;
        }
    }
    simplified.extend(points.last().cloned());
    simplified
}

#[cfg(test)]
mod tests;
