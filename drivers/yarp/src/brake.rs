//! Brake of one board: stops go out on their own connection, so that no stop waits for the answer to another
//! request.
//!
//! An order in progress when a stop overtakes it may be executed after the stop; the hand therefore stops the
//! board again on the connection of the orders. A stop goes to the joints that move or were commanded to. If
//! the readings show no effect, it is sent again to the joints that keep moving as before. A sinking joint is
//! excluded: a board that takes the measured position as its new target would lower the joint with each stop.

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

/// Period of the check whether the board obeys.
const CHECK_PERIOD: Duration = Duration::from_millis(20);
/// Period of the connection test while the board rests, s. A connection that broke unnoticed would delay a
/// stop by the time to connect.
const PROBE_PERIOD_S: f64 = 0.5;
/// Largest share of a joint's speed that may remain from one check to the next for the stop to count as
/// effective.
const MAX_REMAINING_SHARE: f64 = 0.75;
/// Speed below which a moving joint may be sinking instead, deg/s.
const SINKING_SPEED_DEG_S: f64 = 15.0;
/// Time after a stop within which a sinking joint has settled, s. A joint that still moves then has not
/// stopped.
const SETTLING_TIME_S: f64 = 0.5;
/// Speed below which the direction of motion of a stopped joint is undefined, deg/s.
const REST_SPEED_DEG_S: f64 = 1.0;

/// Brake of one board.
pub struct Brake {
    /// State shared with the drivers.
    pub cell: Arc<SharedBoards>,
    /// Index of the board.
    pub index: usize,
    /// Prefix of the board's port names.
    pub port: String,
    /// Connection used for stops only.
    pub line: Box<dyn StopLine>,
    /// Newest stop request.
    pub halt: watch::Receiver<Arc<Halt>>,
    /// Latest delay after which the board may act, s.
    pub latency: f64,
}

impl Brake {
    /// Runs until `end` changes, then stops the board.
    pub async fn work(mut self, mut end: watch::Receiver<bool>) {
        let mut look = interval(CHECK_PERIOD);
        look.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut effect = None;
        let mut tried = f64::NEG_INFINITY;
        // the first message on a connection is a stop
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
                    } else if self.is_idle() && self.now() >= tried + PROBE_PERIOD_S {
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

    /// True if the board is ours to stop. If another program drives it, it is left alone (F13).
    fn is_ours(&self) -> bool {
        self.cell.is_ours(self.index)
    }

    /// True if the connection has to prove itself again.
    fn is_doubted(&self) -> bool {
        self.cell.lock().boards.get(self.index).is_some_and(|known| known.brake.is_some())
    }

    /// Sends a stop and returns whether the connection works. Drivers are notified if it does not: without a
    /// brake a board is not used.
    async fn stop(&mut self, joints: Joints) -> bool {
        if !self.is_ours() {
            return false;
        }
        // not aborted in favor of the next stop, unlike a query: reconnecting for each would leave a slow
        // board without a connection
        let sent_at = self.now();
        let answer = self.line.send(&Ask::Set(Set::Stop(joints))).await;
        self.answered(sent_at, &answer);
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

    /// Tests the connection. Aborts if a stop is due, which then reconnects.
    async fn is_good(&mut self) -> bool {
        let sent_at = self.now();
        let mut halt = self.halt.clone();
        let answer = tokio::select! {
            biased;
            Ok(()) = halt.changed() => return false,
            answer = self.line.send(&Ask::Get(Get::Axes)) => answer,
        };
        self.answered(sent_at, &answer);
        answer.is_ok()
    }

    fn answered(&self, sent_at: f64, answer: &Result<Bottle, CallError>) {
        let now = self.now();
        if let (Ok(answer), Some(known)) = (answer, self.cell.lock().boards.get_mut(self.index)) {
            known.answered(sent_at, now, answer);
        }
    }

    /// True if a test on this connection can't delay a stop, because nothing moves.
    fn is_idle(&self) -> bool {
        self.is_ours() && self.cell.lock().boards.get(self.index).is_some_and(|known| !known.motions.is_busy())
    }

    fn watch(&self, ticket: u64, joints: Joints) -> Effect {
        let stop_sent = self.now();
        let speeds = self
            .cell
            .lock()
            .boards
            .get(self.index)
            .map(|known| known.motions.speeds(stop_sent - super::motion::REST_TIME_S));
        let speeds = match speeds {
            Some(MeasuredSpeeds::At(speeds)) => Some(speeds),
            _ => None,
        };
        Effect { ticket, joints, checked: stop_sent, first: speeds.clone(), speeds, sent: stop_sent }
    }

    /// Joints to which the last stop is to be sent again.
    fn shows_none(&self, effect: &mut Option<Effect>) -> Option<Joints> {
        let watched = effect.as_mut()?;
        let now = self.now();
        let inner = self.cell.lock();
        let known = inner.boards.get(self.index)?;
        if known.moved > watched.ticket || self.cell.is_let_go() {
            *effect = None;
            return None;
        }
        if now < watched.checked + self.latency + super::motion::REST_TIME_S {
            return None;
        }
        match watched.seen(now, known.motions.speeds(watched.checked + self.latency)) {
            BrakeObservation::Rest => {
                *effect = None;
                None
            }
            BrakeObservation::Slower => None,
            BrakeObservation::Nothing(joints) => Some(joints),
        }
    }
}

/// Effect of a stop, as far as the readings show it.
#[derive(Debug)]
struct Effect {
    /// Ticket of the halt: orders with a later ticket may move the joints.
    ticket: u64,
    /// Joints that were stopped.
    joints: Joints,
    /// Time of the last check, or of the first command, s.
    checked: f64,
    /// Speeds of the joints at the stop and at the last check, deg/s.
    first: Option<Vec<f64>>,
    speeds: Option<Vec<f64>>,
    /// Time of the last command, s.
    sent: f64,
}

#[derive(Debug, PartialEq)]
enum BrakeObservation {
    Rest,
    Slower,
    /// The motion continues, at least of these joints.
    Nothing(Joints),
}

impl Effect {
    /// Judges the joint speeds measured since the stop should act.
    fn seen(&mut self, now: f64, speeds: MeasuredSpeeds) -> BrakeObservation {
        self.checked = now;
        let speeds = match speeds {
            MeasuredSpeeds::Rest => return BrakeObservation::Rest,
            // without readings nothing shows whether the joints obey
            MeasuredSpeeds::Unknown => return BrakeObservation::Nothing(self.joints.clone()),
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
            let same_way = of(&self.first, j).is_none_or(|first| first.abs() < REST_SPEED_DEG_S || first * speed > 0.0);
            let unchecked = of(&before, j).is_none_or(|before| speed.abs() > MAX_REMAINING_SHARE * before.abs());
            stopped && same_way && unchecked
        };
        let going: Vec<usize> = speeds.iter().enumerate().filter(|(j, v)| goes_on((*j, v))).map(|(j, _)| j).collect();
        if going.is_empty() {
            return BrakeObservation::Slower;
        }
        let fast = going.iter().any(|j| speeds.get(*j).is_some_and(|speed| speed.abs() >= SINKING_SPEED_DEG_S));
        if !fast && now < self.sent + SETTLING_TIME_S {
            return BrakeObservation::Slower;
        }
        self.sent = now;
        BrakeObservation::Nothing(Joints::Group(going))
    }
}

#[cfg(test)]
mod tests;
