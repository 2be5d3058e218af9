//! The brake of one board: stops go out on a line of their own, so that none waits for the answer to something else.
//!
//! An order that is under way when a stop overtakes it may be carried out after it: the hand stops the board once more on
//! the line of the orders. A stop goes to the joints that move or were commanded to, and one that shows no effect in the readings is
//! sent again: to the joints that go on as before. A joint that sinks is none of them: a board that takes the measured position for the
//! new target would lower it with each stop.

use super::cell::{SharedBoards, instant};
use super::hand::Halt;
use super::motion::MeasuredSpeeds;
use super::remote::StopLine;
use mobee_yarp::board::{Ask, Get, Joints, Set, reply};
use mobee_yarp::{Bottle, CallError};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch;
use tokio::time::{MissedTickBehavior, interval};

/// How often it is looked whether the board obeys.
const LOOK: Duration = Duration::from_millis(20);
/// How often the line is tried while the board rests, s: one that broke unnoticed would cost a stop the time to connect.
const TRIED: f64 = 0.5;
/// A stop has an effect if it takes off this share of a joint's speed, from one look at its effect to the next.
const SLOWER: f64 = 0.75;
/// Slower than this (deg/s) a joint may just as well sink as go on.
const SINKS: f64 = 15.0;
/// A joint that sinks after a stop has come to rest by then, s: one that still moves goes on.
const SUNK: f64 = 0.5;
/// A joint that was slower than this (deg/s) as it was stopped had no direction yet.
const STILL: f64 = 1.0;

/// The brake of one board.
pub struct Brake {
    /// What is known of the board.
    pub cell: Arc<SharedBoards>,
    /// The board's index.
    pub index: usize,
    /// First part of the board's port names.
    pub port: String,
    /// The line that nothing else uses.
    pub line: Box<dyn StopLine>,
    /// Everything stops.
    pub halt: watch::Receiver<Arc<Halt>>,
    /// How late the board may act, s.
    pub latency: f64,
}

impl Brake {
    /// Works until it is told to end; stops the board then.
    pub async fn work(mut self, mut end: watch::Receiver<bool>) {
        let mut look = interval(LOOK);
        look.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let (mut effect, mut tried) = (None, f64::NEG_INFINITY);
        // the first word on a line is a stop
        let mut open = false;
        loop {
            tokio::select! {
                biased;
                _ = end.changed() => break,
                _ = self.halt.changed() => {
                    let halt = self.halt.borrow_and_update().clone();
                    let ticket = halt.tickets.get(self.index).copied().unwrap_or_default();
                    effect = None;
                    if let Some(joints) = halt.stops(self.index) {
                        effect = Some(self.watch(ticket, joints.clone()));
                        open = self.stop(joints).await;
                    }
                }
                _ = look.tick() => {
                    if !open || self.is_doubted() {
                        open = self.stop(Joints::All).await;
                    } else if let Some(joints) = self.shows_none(&mut effect) {
                        tracing::warn!(board = self.port, "a stop shows no effect, and is sent again");
                        open = self.stop(joints).await;
                    } else if self.is_idle() && self.now() >= tried + TRIED {
                        tried = self.now();
                        open = self.is_good().await;
                    }
                }
            }
        }
        self.stop(Joints::All).await;
    }

    fn now(&self) -> f64 {
        self.cell.secs(instant())
    }

    /// Whether the board is ours to stop: another program that drives it is not disturbed (F13).
    fn is_ours(&self) -> bool {
        self.cell.is_ours(self.index)
    }

    /// Whether the line has to show anew that it is good.
    fn is_doubted(&self) -> bool {
        self.cell.lock().boards.get(self.index).is_some_and(|known| known.brake.is_some())
    }

    /// Says a stop; whether the line is good. Drivers are told if it is not: without a brake a board is not used.
    async fn stop(&mut self, joints: Joints) -> bool {
        if !self.is_ours() {
            return false;
        }
        // not given up for the next one, as a question is: to connect anew for each would leave a slow board without a line
        let asked = self.now();
        let answer = self.line.say(&Ask::Set(Set::Stop(joints))).await;
        self.answered(asked, &answer);
        let trouble = match answer {
            Ok(answer) if reply::is_ok(&answer) => None,
            Ok(answer) => Some(format!("{}: it answers {answer} to a stop", self.port)),
            Err(error) => Some(format!("{}: no way for stops: {error}", self.port)),
        };
        let good = trouble.is_none();
        if let Some(known) = self.cell.lock().boards.get_mut(self.index) {
            known.brake = trouble;
        }
        self.cell.ring();
        good
    }

    /// Asks whether the line is good, but not on when there is a stop to say: the line is connected anew then.
    async fn is_good(&mut self) -> bool {
        let asked = self.now();
        let mut halt = self.halt.clone();
        let answer = tokio::select! {
            biased;
            Ok(()) = halt.changed() => return false,
            answer = self.line.say(&Ask::Get(Get::Axes)) => answer,
        };
        self.answered(asked, &answer);
        answer.is_ok()
    }

    fn answered(&self, asked: f64, answer: &Result<Bottle, CallError>) {
        let now = self.now();
        if let (Ok(answer), Some(known)) = (answer, self.cell.lock().boards.get_mut(self.index)) {
            known.answered(asked, now, answer);
        }
    }

    /// Whether a question on this line would keep no stop waiting: nothing moves.
    fn is_idle(&self) -> bool {
        self.is_ours() && self.cell.lock().boards.get(self.index).is_some_and(|known| !known.motions.is_busy())
    }

    fn watch(&self, ticket: u64, joints: Joints) -> Effect {
        let said = self.now();
        let speeds =
            self.cell.lock().boards.get(self.index).map(|known| known.motions.speeds(said - super::motion::WHILE));
        let speeds = match speeds {
            Some(MeasuredSpeeds::At(speeds)) => Some(speeds),
            _ => None,
        };
        Effect { ticket, joints, said, first: speeds.clone(), speeds, sent: said }
    }

    /// The joints that the last stop is to be sent to again.
    fn shows_none(&self, effect: &mut Option<Effect>) -> Option<Joints> {
        let watched = effect.as_mut()?;
        let now = self.now();
        let inner = self.cell.lock();
        let known = inner.boards.get(self.index)?;
        if known.moved > watched.ticket || self.cell.is_let_go() {
            *effect = None;
            return None;
        }
        if now < watched.said + self.latency + super::motion::WHILE {
            return None;
        }
        match watched.seen(now, known.motions.speeds(watched.said + self.latency)) {
            Seen::Rest => {
                *effect = None;
                None
            }
            Seen::Slower => None,
            Seen::Nothing(joints) => Some(joints),
        }
    }
}

/// What a stop does, as far as the readings show.
#[derive(Debug)]
struct Effect {
    /// The halt's ticket: what is ordered after it may move.
    ticket: u64,
    /// What was stopped.
    joints: Joints,
    /// When it was said last, or seen to have an effect, s.
    said: f64,
    /// How fast the joints were as they were stopped, and at the last look, deg/s.
    first: Option<Vec<f64>>,
    speeds: Option<Vec<f64>>,
    /// When it was sent last, s.
    sent: f64,
}

#[derive(Debug, PartialEq)]
enum Seen {
    Rest,
    Slower,
    /// It goes on, at least with these joints.
    Nothing(Joints),
}

impl Effect {
    /// The speeds of the joints since the stop should act, if readings show them.
    fn seen(&mut self, now: f64, speeds: MeasuredSpeeds) -> Seen {
        self.said = now;
        let speeds = match speeds {
            MeasuredSpeeds::Rest => return Seen::Rest,
            // without readings nothing shows whether they obey
            MeasuredSpeeds::Unknown => return Seen::Nothing(self.joints.clone()),
            MeasuredSpeeds::At(speeds) => speeds,
        };
        let before = self.speeds.replace(speeds.clone());
        let of = |list: &Option<Vec<f64>>, j: usize| list.as_ref().and_then(|list| list.get(j)).copied();
        let goes_on = |(j, speed): (usize, &f64)| {
            let stopped = match &self.joints {
                Joints::All => true,
                Joints::One(joint) => *joint == j,
                Joints::Group(joints) => joints.contains(&j),
            };
            let same_way = of(&self.first, j).is_none_or(|first| first.abs() < STILL || first * speed > 0.0);
            let unchecked = of(&before, j).is_none_or(|before| speed.abs() > SLOWER * before.abs());
            stopped && same_way && unchecked
        };
        let going: Vec<usize> = speeds.iter().enumerate().filter(|(j, v)| goes_on((*j, v))).map(|(j, _)| j).collect();
        if going.is_empty() {
            return Seen::Slower;
        }
        let fast = going.iter().any(|j| speeds.get(*j).is_some_and(|speed| speed.abs() >= SINKS));
        if !fast && now < self.sent + SUNK {
            return Seen::Slower;
        }
        self.sent = now;
        Seen::Nothing(Joints::Group(going))
    }
}

#[cfg(test)]
mod tests;
