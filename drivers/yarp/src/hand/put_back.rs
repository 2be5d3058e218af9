//! Restores the settings of a board, one request at a time so that no order is delayed.

use super::super::cell::{from_word, holds, instant};
use super::super::found::{Due, Finding, Restored};
use super::super::motion::End;
use super::Hand;
use mobee_contract::ControlMode;
use mobee_yarp::board::{Ask, Get, Joints, Quantity, mode, reply};
use mobee_yarp::{CallError, Value};
use std::time::Duration;
use tokio::time::sleep;

/// Time within which a board has to settle and be restored at the end, in addition to its answer times.
pub const ENDING: Duration = Duration::from_secs(1);
/// Period of that check.
const CHECK_PERIOD: Duration = Duration::from_millis(10);
/// Ticket of modes that are being restored; no order has it.
const BACK: u64 = u64::MAX;

impl Hand {
    /// Reads the settings of the joints before the first change, unless they are known.
    pub(super) async fn learn_findings(&self) -> Result<(), CallError> {
        if self.cell.lock().boards.get(self.index).is_none_or(|known| known.owed.is_known()) {
            return Ok(());
        }
        let speeds = self.references(Quantity::ReferenceSpeed).await?;
        let accelerations = self.references(Quantity::ReferenceAcceleration).await?;
        let mut inner = self.cell.lock();
        let Some(known) = inner.boards.get_mut(self.index) else { return Ok(()) };
        let known_word = |word: Option<&mobee_yarp::Vocab>| word.copied().filter(|word| *word != mode::UNKNOWN);
        let finding = |j: usize| Finding {
            mode: known_word(known.modes.get(j)),
            interaction: known_word(known.interactions.get(j)),
            speed: speeds.get(j).copied(),
            acceleration: accelerations.get(j).copied(),
        };
        let all = (0..known.q.len()).map(finding).collect();
        known.owed.find(all);
        Ok(())
    }

    /// References of all joints; empty if the board does not report them.
    pub(super) async fn references(&self, what: Quantity) -> Result<Vec<f64>, CallError> {
        let answer = self.send(&Ask::Get(Get::Values(what, Joints::All))).await?;
        let read = answer.get(2).and_then(Value::as_list).and_then(mobee_yarp::Bottle::numbers).unwrap_or_default();
        Ok(if read.iter().all(|v| v.is_finite()) { read } else { Vec::new() })
    }

    /// Marks a setting of these joints as about to be changed.
    pub(super) fn changes(&self, kind: Restored, joints: &[usize]) {
        if let Some(known) = self.cell.lock().boards.get_mut(self.index) {
            known.owed.changes(kind, joints);
        }
    }

    /// Sends the next command that restores settings, if one is due.
    pub(super) async fn put_back(&mut self, at_end: bool) {
        if self.link.as_ref() != Some(&*self.board.link().borrow()) {
            return; // it begins with a stop
        }
        let Some(due) = self.due(at_end) else { return };
        let answer = self.send(&Ask::Set(due.set.clone())).await;
        let done = matches!(&answer, Ok(answer) if reply::is_ok(answer));
        if done {
            // the next switch of modes relies on the reported ones
            if let Err(why) = self.until(None, "is as it was found", |hand| hand.not_as_found(&due)).await {
                tracing::warn!(board = self.board.port(), why, "a joint is not as it was found");
            }
        }
        let motors = self.motors(&due.joints);
        let now = self.cell.secs(instant());
        let mut inner = self.cell.lock();
        inner.switched(motors.into_iter(), BACK);
        let Some(known) = inner.boards.get_mut(self.index) else { return };
        if done {
            known.owed.paid(&due);
        } else if answer.is_ok() && known.owed.refused(&due, now) {
            let request = self.units().ask_to_wire(&Ask::Set(due.set.clone())).bottle().to_string();
            tracing::warn!(
                board = self.board.port(),
                asked = request,
                "a joint is not as it was found: the board answers [fail]"
            );
        }
        // without an answer the outcome is unknown, so the command is sent again
    }

    /// Next command to send. Motors whose mode is about to change are marked with the new mode, for the next
    /// command.
    fn due(&self, at_end: bool) -> Option<Due> {
        let is_leased = !at_end && holds(*self.lease.borrow());
        if !self.cell.is_ours(self.index) {
            return None;
        }
        let mut guard = self.cell.lock();
        let inner = &mut *guard;
        let known = inner.boards.get_mut(self.index)?;
        known.owed.offer_again(self.cell.secs(instant()));
        if !known.owed.is_any() {
            return None;
        }
        known.owed.see(&known.modes);
        let first = self.layout.patches.get(self.index)?.motors.start;
        let in_position = |j: usize| inner.expected.get(first + j) == Some(&ControlMode::Position);
        let due = known.owed.due(|j| known.motions.rests(j), |j| !is_leased || in_position(j))?;
        if due.kind == Restored::Mode {
            for j in &due.joints {
                let word = known.owed.word(Restored::Mode, *j);
                if let (Some(expected), Some(switching), Some(word)) =
                    (inner.expected.get_mut(first + j), inner.switching.get_mut(first + j), word)
                {
                    (*expected, *switching) = (from_word(word), Some(BACK));
                }
            }
        }
        Some(due)
    }

    /// Joints whose reported modes differ from those found.
    fn not_as_found(&self, due: &Due) -> Vec<usize> {
        let inner = self.cell.lock();
        let Some(known) = inner.boards.get(self.index) else { return Vec::new() };
        let reported = match due.kind {
            Restored::Mode => &known.modes,
            Restored::Interaction => &known.interactions,
            Restored::Speed | Restored::Acceleration => return Vec::new(),
        };
        due.joints.iter().copied().filter(|j| reported.get(*j).copied() != known.owed.word(due.kind, *j)).collect()
    }

    /// Ends the work: restores all settings as soon as the joints rest, within a time limit.
    pub(super) async fn leave(&mut self) {
        let now = self.cell.secs(instant());
        let until = now + ENDING.as_secs_f64();
        // the preceding stop ends all motions
        if let Some(known) = self.cell.lock().boards.get_mut(self.index) {
            let all: Vec<usize> = (0..known.q.len()).collect();
            let ticket = known.motions.order(&all, End::Seen);
            known.motions.given(ticket, now);
        }
        let owes = |hand: &Hand| {
            hand.cell.lock().boards.get(hand.index).is_some_and(|known| known.owed.is_any() && known.trouble.is_none())
        };
        while owes(self) && self.cell.is_ours(self.index) && self.cell.secs(instant()) < until {
            self.put_back(true).await;
            sleep(CHECK_PERIOD).await;
        }
    }
}
