//! The retreat: what the reflex does while the filter is closed, from the stop to the word that all is well, or that it gave up.

use super::retreat::{Parted, Retreat};
use super::{Back, FROZEN, FROZEN_WAY, Names, Phase, ReflexCore, ReflexOut, ReflexReport, Step, Then};
use crate::distance;
use crate::joint_retreat::{Answer, Asked};
use crate::pulse::Pulse;
use mobee_contract::{Command, ControlMode, Event, Hold, Time};
use mobee_model::Contact;
use std::time::Duration;

/// How long the robot may take to come to rest before it is stopped once more, to follow on its way, or to settle at its end.
const PATIENCE: Duration = Duration::from_secs(3);

impl ReflexCore {
    /// The filter is closed by us or for us.
    pub(super) fn act(&mut self, pulse: &Pulse, step: &mut Step) {
        let (rules, names) = (step.rules, step.names);
        // what a reading shows is judged by when it was read, what is written is spaced by the clock
        let (sampled_at, now) = (pulse.sample.at, step.now);
        let at_rest = pulse.speed < rules.rest_speed;
        match &mut self.phase {
            Phase::Watching => {}
            Phase::Stopping { token, since, then } => {
                let token = *token;
                self.floors.note(&pulse.contacts);
                if self.stop.is_ignored(pulse, rules, now) {
                    step.stop(token);
                }
                if sampled_at >= *since + rules.reaction() && at_rest {
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
            Phase::Retreating { token, retreat, back, violated, mark } => {
                let token = *token;
                if mark.0 != pulse.unchanged {
                    *mark = (pulse.unchanged, retreat.written().to_vec(), sampled_at);
                }
                let frozen = sampled_at.since(mark.2) >= FROZEN && distance(retreat.written(), &mark.1) > FROZEN_WAY;
                let broken = self.floors.broken(&pulse.contacts).copied();
                let newly_violated = pulse.violated.is_some() && !*violated;
                if frozen {
                    self.give_up(
                        token,
                        Hold::Stale,
                        "the encoders do not follow the set-points".into(),
                        sampled_at,
                        step,
                    );
                } else if broken.is_some() || newly_violated {
                    let what = blocked(broken, names);
                    self.give_up(token, Hold::RetreatBlocked, what, sampled_at, step);
                } else if retreat.waits(now) >= PATIENCE {
                    let what = "the robot does not follow the set-points".into();
                    self.give_up(token, Hold::RetreatMissed, what, sampled_at, step);
                } else {
                    match retreat.step(step.joint_retreat, &pulse.sample, now, rules) {
                        Ok(command) => step.out.extend(command.map(|c| ReflexOut::Command(token, c))),
                        Err(Parted) => {
                            let then = Then::Retreat(Back { again: true, ..back.clone() });
                            step.stop(token);
                            step.joint_retreat.leave(self.robot);
                            self.turn(Phase::Stopping { token, since: now, then }, step);
                            return;
                        }
                    }
                    if retreat.is_over() {
                        let (retreat, violated) = (retreat.clone(), *violated);
                        let since = retreat.arrival(now);
                        self.phase = Phase::Settling { token, since, retreat, violated };
                        step.out.push(ReflexOut::ReflexReport(ReflexReport::Settling));
                    }
                }
            }
            Phase::Settling { token, since, retreat, violated } => {
                let (token, way) = (*token, retreat.way());
                let broken = self.floors.broken(&pulse.contacts).copied();
                if broken.is_some() || (pulse.violated.is_some() && !*violated) {
                    let what = blocked(broken, names);
                    self.give_up(token, Hold::RetreatBlocked, what, sampled_at, step);
                } else if sampled_at >= *since + rules.reaction()
                    && at_rest
                    && distance(&pulse.sample.q, &way.end.1) <= rules.tolerance
                {
                    if way.blocked {
                        let what = "another robot, which stands in the way, can't go back farther".into();
                        self.give_up(token, Hold::RetreatBlocked, what, sampled_at, step);
                        return;
                    }
                    for pair in self.contacts.settle() {
                        step.emit(Event::ContactEnded { robot: step.robot(), names: names(pair) });
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
                    step.out.extend(retreat.again(&pulse.sample, now, rules).map(|c| ReflexOut::Command(token, c)));
                }
            }
        }
    }

    /// The robot rests: ask for the retreat, and begin it once it is known.
    pub(super) fn ask(&mut self, step: &mut Step) {
        let Phase::Stopping { token, then: Then::Retreat(back), .. } = &self.phase else { return };
        let (token, mut back) = (*token, back.clone());
        let (robot, id) = (step.robot(), back.motion.id);
        match step.joint_retreat.ask(self.robot, step.now) {
            Answer::Wait => {}
            Answer::Bring => {
                let Back { motion, safe, again } = back;
                let (named, places) = (motion.named, motion.places);
                step.out.push(ReflexOut::Bring(Asked { robot: self.robot, safe, again, named, places }));
            }
            Answer::Go(way) => {
                if way.farther {
                    back.safe = way.end.clone();
                }
                self.stopped = way.motors.clone();
                let farther = way.farther.then(|| ReflexReport::Farther(way.end.clone(), way.motors.clone()));
                let retreat = Retreat::new(self.robot, way, step.rules, step.now);
                let (poses, secs) = retreat.length();
                let near = self.floors.touched();
                step.emit(Event::RetreatBegan { robot, id, poses, secs, near });
                step.out.push(ReflexOut::Command(token, retreat.begin()));
                step.out.push(ReflexOut::ReflexReport(ReflexReport::Retreating));
                step.out.extend(farther.map(ReflexOut::ReflexReport));
                let mark = (Time::ZERO, retreat.written().to_vec(), step.now);
                let violated = self.violated;
                self.phase = Phase::Retreating { token, retreat, back, violated, mark };
            }
        }
    }

    fn give_up(&mut self, token: u64, reason: Hold, what: String, seen: Time, step: &mut Step) {
        step.stop(token);
        step.emit(Event::RetreatStopped { robot: step.robot(), reason, what, seen });
        self.turn(Phase::Stopping { token, since: step.now, then: Then::Say(ReflexReport::GaveUp(reason)) }, step);
    }

    /// The robot does not come to rest, or its readings don't: stop it once more, and say nothing before it rests (I17). A
    /// path that it may have left long ago is not driven back.
    fn stop_again(&mut self, token: u64, then: Then, seen: Time, step: &mut Step) {
        if let Then::Say(_) = then {
            step.stop(token);
            self.turn(Phase::Stopping { token, since: step.now, then }, step);
        } else {
            let what = "the robot did not come to rest in time".into();
            self.give_up(token, Hold::RetreatMissed, what, seen, step);
        }
    }

    /// The robot rests: restore the control modes and tell.
    pub(super) fn say(&mut self, token: u64, word: ReflexReport, step: &mut Step) {
        let motors = self.stopped.to_vec();
        if !motors.is_empty() {
            step.out.push(ReflexOut::Command(token, Command::Mode { motors, mode: ControlMode::Position }));
        }
        step.out.push(ReflexOut::ReflexReport(word));
        self.turn(Phase::Watching, step);
    }
}

fn blocked(contact: Option<Contact>, names: &Names) -> String {
    let Some(c) = contact else { return "a constraint would be violated".into() };
    let (a, b) = names(c.pair);
    format!("{a} and {b} are at {:.1} mm", c.distance * 1e3)
}
