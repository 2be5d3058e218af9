//! The way back: what the reflex does while the filter is closed, from the stop to the word that all is well, or that it gave up.

use super::retreat::{Parted, Retreat};
use super::{Back, FROZEN, FROZEN_WAY, Phase, ReflexCore, ReflexOut, Then, Word};
use crate::controller::distance;
use crate::convoy::{Answer, Asked};
use crate::pulse::Pulse;
use mobee_contract::{Command, ControlMode, Event, Hold, Time};
use mobee_model::{Contact, Pair};
use std::time::Duration;

/// How long the robot may take to come to rest before it is stopped once more, to follow on its way, or to settle at its end.
const PATIENCE: Duration = Duration::from_secs(3);

impl ReflexCore {
    /// The filter is closed by us or for us.
    pub(super) fn act(
        &mut self,
        pulse: &Pulse,
        clock: Time,
        name: &dyn Fn(Pair) -> (String, String),
        out: &mut Vec<ReflexOut>,
    ) {
        let now = pulse.sample.at;
        let rules = self.rules.clone();
        let at_rest = pulse.speed < rules.rest_speed;
        match &mut self.phase {
            Phase::Watching => {}
            Phase::Stopping { token, since, then } => {
                let token = *token;
                self.floors.note(&pulse.contacts);
                if self.stop.is_ignored(pulse, &rules, clock) {
                    out.push(ReflexOut::Command(token, Command::Stop { motors: Vec::new() }));
                }
                if now >= *since + rules.reaction() && at_rest {
                    match then.clone() {
                        Then::Retreat(_) => self.ask(clock, out),
                        Then::Say(word) => self.say(token, word, clock, out),
                    }
                } else if now >= *since + PATIENCE {
                    let then = then.clone();
                    self.stop_again(token, then, (now, clock), out);
                } else if let Then::Retreat(_) = then {
                    self.convoy.coming(self.robot, clock);
                }
            }
            Phase::Retreating { token, retreat, back, violated, mark } => {
                let token = *token;
                if mark.0 != pulse.unchanged {
                    *mark = (pulse.unchanged, retreat.written().to_vec(), now);
                }
                let frozen = now.since(mark.2) >= FROZEN && distance(retreat.written(), &mark.1) > FROZEN_WAY;
                let broken = self.floors.broken(&pulse.contacts).copied();
                let newly_violated = pulse.violated.is_some() && !*violated;
                if frozen {
                    self.give_up(
                        token,
                        Hold::Stale,
                        "the encoders do not follow the set-points".into(),
                        (now, clock),
                        out,
                    );
                } else if broken.is_some() || newly_violated {
                    let what = blocked(broken, name);
                    self.give_up(token, Hold::RetreatBlocked, what, (now, clock), out);
                } else if retreat.waits(clock) >= PATIENCE {
                    let what = "the robot does not follow the set-points".into();
                    self.give_up(token, Hold::RetreatMissed, what, (now, clock), out);
                } else {
                    match retreat.step(&self.convoy, &pulse.sample, clock, &rules) {
                        Ok(command) => out.extend(command.map(|c| ReflexOut::Command(token, c))),
                        Err(Parted) => {
                            let then = Then::Retreat(Back { again: true, ..back.clone() });
                            out.push(ReflexOut::Command(token, Command::Stop { motors: Vec::new() }));
                            self.convoy.leave(self.robot);
                            self.turn(Phase::Stopping { token, since: clock, then }, clock);
                            return;
                        }
                    }
                    if retreat.is_over() {
                        let (retreat, violated) = (retreat.clone(), *violated);
                        let since = retreat.arrival(clock);
                        self.phase = Phase::Settling { token, since, retreat, violated };
                        out.push(ReflexOut::Word(Word::Settling));
                    }
                }
            }
            Phase::Settling { token, since, retreat, violated } => {
                let (token, way) = (*token, retreat.way());
                let broken = self.floors.broken(&pulse.contacts).copied();
                if broken.is_some() || (pulse.violated.is_some() && !*violated) {
                    let what = blocked(broken, name);
                    self.give_up(token, Hold::RetreatBlocked, what, (now, clock), out);
                } else if now >= *since + rules.reaction()
                    && at_rest
                    && distance(&pulse.sample.q, &way.end.1) <= rules.tolerance
                {
                    if way.blocked {
                        let what = "another robot, which stands in the way, can't go back farther".into();
                        self.give_up(token, Hold::RetreatBlocked, what, (now, clock), out);
                        return;
                    }
                    for pair in self.contacts.settle() {
                        out.push(ReflexOut::Event(Event::ContactEnded {
                            robot: rules.robot.clone(),
                            names: name(pair),
                        }));
                    }
                    self.say(token, Word::Back, clock, out);
                } else if now >= *since + PATIENCE {
                    self.give_up(
                        token,
                        Hold::RetreatMissed,
                        "the safe pose was not reached in time".into(),
                        (now, clock),
                        out,
                    );
                } else if at_rest {
                    out.extend(retreat.again(&pulse.sample, clock, &rules).map(|c| ReflexOut::Command(token, c)));
                }
            }
        }
    }

    /// The robot rests: ask for the way back, and begin it once it is known.
    pub(super) fn ask(&mut self, now: Time, out: &mut Vec<ReflexOut>) {
        let Phase::Stopping { token, then: Then::Retreat(back), .. } = &self.phase else { return };
        let (token, mut back) = (*token, back.clone());
        let (robot, id) = (self.rules.robot.clone(), back.motion.id);
        match self.convoy.ask(self.robot, now) {
            Answer::Wait => {}
            Answer::Bring => {
                let Back { motion, safe, again } = back;
                let (named, places) = (motion.named, motion.places);
                out.push(ReflexOut::Bring(Asked { robot: self.robot, safe, again, named, places }));
            }
            Answer::Go(way) => {
                if way.farther {
                    back.safe = way.end.clone();
                }
                self.stopped = way.motors.clone();
                let farther = way.farther.then(|| Word::Farther(way.end.clone(), way.motors.clone()));
                let retreat = Retreat::new(self.robot, way, &self.rules, now);
                let (poses, secs) = retreat.length();
                let near = self.floors.touched();
                out.push(ReflexOut::Event(Event::RetreatBegan { robot, id, poses, secs, near }));
                out.push(ReflexOut::Command(token, retreat.begin()));
                out.push(ReflexOut::Word(Word::Retreating));
                out.extend(farther.map(ReflexOut::Word));
                let mark = (Time::ZERO, retreat.written().to_vec(), now);
                let violated = self.violated;
                self.phase = Phase::Retreating { token, retreat, back, violated, mark };
            }
        }
    }

    fn give_up(&mut self, token: u64, reason: Hold, what: String, (seen, now): (Time, Time), out: &mut Vec<ReflexOut>) {
        out.push(ReflexOut::Command(token, Command::Stop { motors: Vec::new() }));
        out.push(ReflexOut::Event(Event::RetreatStopped { robot: self.rules.robot.clone(), reason, what, seen }));
        self.turn(Phase::Stopping { token, since: now, then: Then::Say(Word::GaveUp(reason)) }, now);
    }

    /// The robot does not come to rest, or its readings don't: stop it once more, and say nothing before it rests (I17). A
    /// path that it may have left long ago is not driven back.
    fn stop_again(&mut self, token: u64, then: Then, (seen, now): (Time, Time), out: &mut Vec<ReflexOut>) {
        if let Then::Say(_) = then {
            out.push(ReflexOut::Command(token, Command::Stop { motors: Vec::new() }));
            self.turn(Phase::Stopping { token, since: now, then }, now);
        } else {
            let what = "the robot did not come to rest in time".into();
            self.give_up(token, Hold::RetreatMissed, what, (seen, now), out);
        }
    }

    /// The robot rests: restore the control modes and tell.
    pub(super) fn say(&mut self, token: u64, word: Word, now: Time, out: &mut Vec<ReflexOut>) {
        let motors = self.stopped.to_vec();
        if !motors.is_empty() {
            out.push(ReflexOut::Command(token, Command::Mode { motors, mode: ControlMode::Position }));
        }
        out.push(ReflexOut::Word(word));
        self.turn(Phase::Watching, now);
    }
}

fn blocked(contact: Option<Contact>, name: &dyn Fn(Pair) -> (String, String)) -> String {
    let Some(c) = contact else { return "a constraint would be violated".into() };
    let (a, b) = name(c.pair);
    format!("{a} and {b} are at {:.1} mm", c.distance * 1e3)
}
