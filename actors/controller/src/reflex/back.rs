//! The retreat: what the reflex does while the filter is closed, from the stop to the word that all is well, or that it
//! gave up.
//!
//! The part of Algorithm 6 between "stop" and "open". The paper drives the recorded poses backwards and opens; a robot
//! whose readings may be late, frozen or wrong needs more: each phase has a time after which it gives up, what comes
//! nearer than it was stops it, and no word is said before the readings show rest (I9, I17).
//!
//! Two clocks: `sampled_at` is when a reading was taken, and judges what it shows; `now` is when it is heard, and
//! spaces what is written. Readings that were held up come in a bunch: judged by `now` they would prove a rest from
//! before the stop, and set-points spaced by `sampled_at` would be written all at once.

use super::contacts::EndedContact;
use super::floors::Floors;
use super::retreat::{Parted, Retreat};
use super::room::{Room, Way, another};
use super::{Back, FROZEN, FROZEN_WAY, Names, Phase, ReflexCore, ReflexOut, ReflexReport, Step, Still, Then};
use crate::joint_retreat::{Asked, RetreatReply};
use crate::ledger::Underway;
use crate::look_ahead::Foreseen;
use crate::pulse::Pulse;
use crate::{Rules, distance};
use mobee_contract::{Command, ControlMode, Event, Hold, Time};
use mobee_model::Contact;
use std::time::Duration;

/// How long the robot may take to come to rest before it is stopped once more, to follow on its way, or to settle at
/// its end. Long beside braking, so that only what does not obey is given up.
const PATIENCE: Duration = Duration::from_secs(3);

/// A robot that still creeps this long after its stop has had its effect is held.
const HELD: Duration = Duration::from_millis(200);
/// Greatest speed of creeping, rad/s.
const CREEPS: f64 = 5.0 * std::f64::consts::PI / 180.0;

impl ReflexCore {
    /// A reading while the filter is closed by us or for us.
    ///
    /// In each phase what forbids going on is asked before what would end it: a robot that has arrived in contact has
    /// not arrived. `close`: the pairs that the retreat may not bring nearer, as they are now.
    pub(super) fn act(&mut self, pulse: &Pulse, close: &[Contact], step: &mut Step) {
        let (rules, names) = (step.rules, step.names);
        // what a reading shows is judged by when it was read, what is written is spaced by the clock
        let (sampled_at, now) = (pulse.sample.at, step.now);
        let at_rest = pulse.speed < rules.rest_speed;
        if matches!(self.phase, Phase::Retreating { .. } | Phase::Settling { .. }) {
            self.passed.note(&self.near);
        }
        let ahead = self.foreseen_on_the_way(pulse, step);
        match &mut self.phase {
            Phase::Watching => {}
            Phase::Stopping { token, since, then } => {
                let token = *token;
                // while it brakes it goes on into what it touched: the way back leads through there once more, and may
                self.floors.note(&self.near);
                if self.stop.is_ignored(pulse, rules, now) {
                    step.stop(token);
                }
                // an earlier reading at rest may be from before the stop had its effect
                let (held, pressed) = match then {
                    Then::Retreat(back) => (
                        is_held(pulse, *since, rules),
                        back.motion.pressed && rules.gives() && rules.position_direct && !back.again,
                    ),
                    Then::Say(_) => (false, false),
                };
                // what pushes something is not to be braked into it: set-points to where it is take the load off at once
                if pressed && sampled_at > *since || sampled_at >= *since + rules.reaction() && (at_rest || held) {
                    match then.clone() {
                        Then::Retreat(_) => self.ask(step),
                        Then::Say(word) => self.say(token, word, step),
                    }
                } else if sampled_at >= *since + PATIENCE {
                    let then = then.clone();
                    self.stop_again(token, then, sampled_at, step);
                } else if let Then::Retreat(_) = then {
                    step.joint_retreat.coming(self.robot, now);
                }
            }
            Phase::Retreating { token, retreat, back, violated, still, room } => {
                let token = *token;
                // joints that are hooked stand still on the first line
                if still.unchanged != pulse.unchanged || retreat.takes_load_off() {
                    let (unchanged, written) = (pulse.unchanged, retreat.written().to_vec());
                    *still = Still { unchanged, written, sampled_at };
                }
                // by the way of the set-points, too: at a recorded rest readings may well be equal for long
                if retreat.brakes() {
                    self.floors.note(&self.near);
                }
                let long = sampled_at.since(still.sampled_at) >= FROZEN;
                let frozen = long && distance(retreat.written(), &still.written) > FROZEN_WAY;
                let met = self.floors.broken(close, rules);
                let broken = met.or_else(|| self.floors.broken(&ahead, rules)).copied();
                let foreseen = met.is_none();
                // one that was violated as the retreat began is what it leads out of
                let newly_violated = pulse.violated.is_some() && !*violated;
                let rests = at_rest && retreat.is_where_sent(&pulse.sample, rules);
                let way = room.look(broken.as_ref(), (foreseen, rests), self.robot, step.joint_retreat, now);
                // a board that plans from way-point to way-point goes on by itself
                let stops = way == Way::Blocked || (way == Way::Waits && !retreat.way().direct);
                if frozen {
                    self.give_up(
                        token,
                        Hold::Stale,
                        "the encoders do not follow the set-points".into(),
                        sampled_at,
                        step,
                    );
                } else if stops || newly_violated {
                    let what = blocked(broken, pulse.violated.is_some(), names);
                    self.give_up(token, Hold::RetreatBlocked, what, sampled_at, step);
                } else if retreat.waits(now) >= PATIENCE {
                    let what = "the robot does not follow the set-points".into();
                    self.give_up(token, Hold::RetreatMissed, what, sampled_at, step);
                } else {
                    tell(way, room, self.robot, broken, sampled_at, step);
                    let done = match way {
                        Way::Waits | Way::Stays => retreat.stay(step.joint_retreat, &pulse.sample, now, rules),
                        _ => retreat.step(step.joint_retreat, &pulse.sample, now, rules),
                    };
                    match done {
                        Ok(command) => step.out.extend(command.map(|c| ReflexOut::Command(token, c))),
                        Err(Parted) => {
                            let back = back.clone();
                            self.part(token, back, step);
                            return;
                        }
                    }
                    if retreat.is_over() {
                        let (retreat, back, violated, room) = (retreat.clone(), back.clone(), *violated, *room);
                        // no `turn`: it stays where it is on the common clock, for those that are still under way
                        let since = retreat.arrival(now);
                        self.phase = Phase::Settling { token, since, retreat, back, violated, room };
                        step.out.push(ReflexOut::ReflexReport(ReflexReport::Settling));
                    }
                }
            }
            Phase::Settling { token, back, .. } if step.joint_retreat.begins_anew(self.robot, now) => {
                let (token, back) = (*token, back.clone());
                self.part(token, back, step);
            }
            Phase::Settling { token, since, retreat, back, violated, room } => {
                let (token, way) = (*token, retreat.way());
                let broken = self.floors.broken(close, rules).copied();
                // where it was sent it stays: who drives into it there is waited for as on the way
                let met = room.look(broken.as_ref(), (false, at_rest), self.robot, step.joint_retreat, now);
                if met == Way::Blocked || (pulse.violated.is_some() && !*violated) {
                    let what = blocked(broken, pulse.violated.is_some(), names);
                    self.give_up(token, Hold::RetreatBlocked, what, sampled_at, step);
                } else if met != Way::Free {
                    tell(met, room, self.robot, broken, sampled_at, step);
                    *since = now;
                } else if sampled_at >= *since + rules.reaction()
                    && at_rest
                    && distance(&pulse.sample.q, &way.end.q) <= rules.tolerance
                {
                    // it came as far as it was sent, but that is not its safe pose
                    if way.blocked {
                        let what = "another robot, which stands in the way, can't go back farther".into();
                        self.give_up(token, Hold::RetreatBlocked, what, sampled_at, step);
                        return;
                    }
                    // let in by itself, it would soon be in the way of those who are not back yet
                    if !step.joint_retreat.is_over(self.robot, now) {
                        return;
                    }
                    // as it set out the others were elsewhere: where they wait for it now, all go on through what they have passed
                    if !back.again && stands_in_the_way(self.robot, close, step) {
                        let back = back.clone();
                        self.part(token, back, step);
                        return;
                    }
                    // at the safe pose it was free: a distance within the hysteresis is no contact there
                    for EndedContact { pair, depth } in self.contacts.settle() {
                        step.emit(Event::ContactEnded { robot: step.robot(), names: names(pair), depth });
                    }
                    self.say(token, ReflexReport::Back, step);
                } else if sampled_at >= *since + PATIENCE {
                    self.give_up(
                        token,
                        Hold::RetreatMissed,
                        "the safe pose was not reached in time".into(),
                        sampled_at,
                        step,
                    );
                } else if at_rest {
                    // beside its end: the last set-point may have been lost as the lease ran out
                    step.out.extend(retreat.again(&pulse.sample, now, rules).map(|c| ReflexOut::Command(token, c)));
                }
            }
        }
    }

    /// The contacts that the retreat must not come to: with objects that were put where they are since the motion set out, and with robots
    /// that don't go along. Of all others the path is as free as it was driven, and a robot that is about to turn into a corner of it is not
    /// stopped by what is beyond. A board that goes on by itself gives up where it waits: robots stop it only by the margin.
    fn foreseen_on_the_way(&self, pulse: &Pulse, step: &Step) -> Vec<Contact> {
        let Phase::Retreating { retreat, .. } = &self.phase else { return Vec::new() };
        let direct = retreat.way().direct;
        let counts = |f: &&Foreseen| {
            let meets = direct && another(&f.contact, self.robot).is_some() && !self.goes_along(&f.contact, step);
            f.edited > self.epoch || meets
        };
        pulse.foreseen.iter().filter(counts).map(|f| f.contact).collect()
    }

    /// The robot rests: ask for the retreat, and begin it once it is known.
    ///
    /// Asked at each reading until there is an answer: others that are coming to rest are waited for, and the plan is
    /// checked in slices.
    pub(super) fn ask(&mut self, step: &mut Step) {
        let Phase::Stopping { token, then: Then::Retreat(back), .. } = &self.phase else { return };
        let (token, mut back) = (*token, back.clone());
        let (robot, id) = (step.robot(), back.motion.id);
        match step.joint_retreat.ask(self.robot, step.now) {
            RetreatReply::Wait => {}
            RetreatReply::Bring => {
                let Back { motion, safe, again } = back;
                let Underway { named, places, extent, pressed, .. } = motion;
                let robot = self.robot;
                step.out.push(ReflexOut::Bring(Asked { robot, safe, again, named, places, extent, pressed }));
            }
            RetreatReply::Go(way) => {
                // another robot has to pass where this one would rest: an earlier rest is its safe pose from now on, and what the
                // motions since then passed is passed again
                if way.farther {
                    self.floors.join(self.lately.since(way.end.since));
                }
                self.stopped = way.motors.clone();
                let elsewhere = way.end.since != back.safe.since && !way.blocked;
                let (to, motors, stream) = (way.end.clone(), way.motors.clone(), !way.farther);
                if elsewhere {
                    back.safe = to.clone();
                }
                let elsewhere = elsewhere.then_some(ReflexReport::EndsAt { to, motors, stream });
                let retreat = Retreat::new(self.robot, way, step.rules, step.now);
                let (poses, secs) = retreat.length();
                let near = self.floors.touched();
                step.emit(Event::RetreatBegan { robot, id, poses, secs, near });
                step.out.push(ReflexOut::Command(token, retreat.begin()));
                step.out.push(ReflexOut::ReflexReport(ReflexReport::Retreating));
                step.out.extend(elsewhere.map(ReflexOut::ReflexReport));
                let written = retreat.written().to_vec();
                let still = Still { unchanged: Time::ZERO, written, sampled_at: step.now };
                let violated = self.violated;
                let room = Room::default();
                self.passed = Floors::default();
                self.phase = Phase::Retreating { token, retreat, back, violated, still, room };
            }
        }
    }

    /// Those who went along do so no more: the robot stops, and asks for another way. The plan was for all of them: without one that was
    /// lost it proves nothing, so each goes by itself; where ways cross, all go together, through what they have passed.
    fn part(&mut self, token: u64, back: Back, step: &mut Step) {
        let anew = step.joint_retreat.begins_anew(self.robot, step.now);
        if anew {
            self.floors.join(std::mem::take(&mut self.passed));
        }
        step.stop(token);
        let then = Then::Retreat(Back { again: !anew, ..back });
        self.turn(Phase::Stopping { token, since: step.now, then }, step);
    }

    /// The retreat ends where it is: stop, tell the journal why, and say so to supervise once the robot rests. `seen`
    /// is when the reading was taken that shows the reason.
    fn give_up(&mut self, token: u64, reason: Hold, what: String, seen: Time, step: &mut Step) {
        step.stop(token);
        step.emit(Event::RetreatStopped { robot: step.robot(), reason, what, seen });
        self.turn(Phase::Stopping { token, since: step.now, then: Then::Say(ReflexReport::GaveUp(reason)) }, step);
    }

    /// The robot does not come to rest, or its readings don't: stop it once more, and say nothing before it rests
    /// (I17). A path that it may have left long ago is not driven back.
    fn stop_again(&mut self, token: u64, then: Then, seen: Time, step: &mut Step) {
        if let Then::Say(_) = then {
            step.stop(token);
            self.turn(Phase::Stopping { token, since: step.now, then }, step);
        } else {
            let what = "the robot did not come to rest in time".into();
            self.give_up(token, Hold::RetreatMissed, what, seen, step);
        }
    }

    /// The robot rests: restore the control modes and tell. The modes first: supervise may open the filter by the very
    /// next reading, and an agent's move in the mode of set-points would be a jump.
    pub(super) fn say(&mut self, token: u64, word: ReflexReport, step: &mut Step) {
        let motors = self.stopped.to_vec();
        if !motors.is_empty() {
            step.out.push(ReflexOut::Command(token, Command::Mode { motors, mode: ControlMode::Position }));
        }
        step.out.push(ReflexOut::ReflexReport(word));
        self.turn(Phase::Watching, step);
    }
}

/// True for a pressing arm, which creeps along the obstacle and does not come to rest: the retreat begins from slow and takes the load off.
fn is_held(pulse: &Pulse, stopped: Time, rules: &Rules) -> bool {
    rules.gives() && pulse.speed < CREEPS && pulse.sample.at >= stopped + rules.reaction() + HELD
}

/// What others are to know of a retreat that waits from now on, or goes on: those it may be in the way of, and the journal.
fn tell(way: Way, room: &Room, robot: usize, met: Option<Contact>, seen: Time, step: &mut Step) {
    match way {
        Way::Waits => {
            let what = blocked(met, false, step.names);
            step.emit(Event::RetreatWaits { robot: step.robot(), what, seen });
        }
        Way::GoesOn => step.emit(Event::RetreatGoesOn { robot: step.robot() }),
        Way::Stays => {}
        Way::Free | Way::Blocked => return,
    }
    step.joint_retreat.wait(robot, room.waits());
}

/// Whether the robot touches one that waits for it on its own way back: they begin anew then, together.
fn stands_in_the_way(robot: usize, close: &[Contact], step: &Step) -> bool {
    let touches = close.iter().filter(|c| c.distance < step.rules.margin);
    let mut others = touches.filter_map(|c| another(c, robot));
    others.any(|other| step.joint_retreat.stands_in_the_way(robot, other))
}

/// Why a retreat is blocked, in words: by this contact, or, without one, by a constraint, or by a robot that does not halt.
fn blocked(contact: Option<Contact>, violated: bool, names: &Names) -> String {
    let Some(c) = contact else {
        let what =
            if violated { "a constraint would be violated" } else { "the robot does not rest where it was sent" };
        return what.into();
    };
    let (a, b) = names(c.pair);
    format!("{a} and {b} are at {:.1} mm", c.distance * 1e3)
}

#[cfg(test)]
mod tests;
