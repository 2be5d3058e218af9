//! Switches modes: sends the mode, then reads it back until the board reports it.

use super::super::cell::word;
use super::super::found::Restored;
use super::Hand;
use mobee_contract::ControlMode;
use mobee_yarp::board::{Ask, Get, Joints, Set, mode};
use mobee_yarp::{Bottle, Value, Vocab};
use std::time::Duration;
use tokio::time::sleep;

/// Time limit of a switch, and the period at which it is checked.
const SWITCH_TIMEOUT: Duration = Duration::from_secs(2);
const CHECK_PERIOD: Duration = Duration::from_millis(5);

impl Hand {
    /// True if these joints report this mode.
    pub(super) fn are_in(&self, joints: &[usize], mode: ControlMode) -> bool {
        self.not_in(joints, word(mode)).is_empty()
    }

    fn not_in(&self, joints: &[usize], mode: Vocab) -> Vec<usize> {
        let inner = self.cell.lock();
        let known = inner.boards.get(self.index);
        let other = |j: &usize| known.is_none_or(|k| k.modes.get(*j) != Some(&mode));
        joints.iter().copied().filter(other).collect()
    }

    fn compliant(&self, joints: &[usize]) -> Vec<usize> {
        let inner = self.cell.lock();
        let known = inner.boards.get(self.index);
        let soft = |j: &usize| known.is_some_and(|k| k.interactions.get(*j) == Some(&mode::COMPLIANT));
        joints.iter().copied().filter(soft).collect()
    }

    /// Switches joints to a mode and waits until the board reports it. Joints that are to move to positions
    /// are made stiff first, because a compliant joint does not reach its target. A halt that comes in
    /// between is executed; with an `epoch` it ends the attempt.
    pub(super) async fn bring(&mut self, joints: &[usize], to: ControlMode, epoch: Option<u64>) -> Result<(), String> {
        if matches!(to, ControlMode::Position | ControlMode::PositionDirect) {
            let soft = self.compliant(joints);
            if !soft.is_empty() {
                self.changes(Restored::Interaction, &soft);
                let stiff = vec![mode::STIFF; soft.len()];
                self.set(Set::Interaction(Joints::Group(soft.clone()), stiff)).await?;
                self.until(epoch, "becomes stiff", |hand| hand.compliant(&soft)).await?;
            }
        }
        let word = word(to);
        let others = self.not_in(joints, word);
        if others.is_empty() {
            return Ok(());
        }
        self.changes(Restored::Mode, &others);
        self.set(Set::Mode(Joints::Group(others.clone()), vec![word; others.len()])).await?;
        self.until(epoch, "takes its mode", |hand| hand.not_in(&others, word)).await
    }

    /// Waits until `left` returns no joint.
    pub(super) async fn until(
        &mut self,
        epoch: Option<u64>,
        what: &str,
        left: impl Fn(&Hand) -> Vec<usize>,
    ) -> Result<(), String> {
        let rounds = SWITCH_TIMEOUT.as_millis() / CHECK_PERIOD.as_millis();
        for round in 0..rounds {
            match epoch {
                Some(epoch) => self.interrupted(epoch).await?,
                None => self.handle_halt().await,
            }
            if left(self).is_empty() {
                return Ok(());
            }
            // queries a board whose states don't contain modes
            if round % 4 == 3 {
                self.learn_modes().await;
            }
            sleep(CHECK_PERIOD).await;
        }
        Err(format!("no sign within {SWITCH_TIMEOUT:?} that joint {:?} {what}", left(self)))
    }

    /// Queries all modes.
    pub(super) async fn learn_modes(&self) {
        let vocabs = |answer: &Bottle, nth: usize| -> Option<Vec<Vocab>> {
            answer.get(nth)?.as_list()?.0.iter().map(Value::as_vocab).collect()
        };
        let modes = self.send(&Ask::Get(Get::Modes(Joints::All))).await;
        let interactions = self.send(&Ask::Get(Get::Interactions(Joints::All))).await;
        let mut inner = self.cell.lock();
        let Some(known) = inner.boards.get_mut(self.index) else { return };
        if let Some(modes) = modes.ok().and_then(|a| vocabs(&a, 2)) {
            known.modes.iter_mut().zip(modes).for_each(|(slot, m)| *slot = m);
        }
        if let Some(interactions) = interactions.ok().and_then(|a| vocabs(&a, 0)) {
            known.interactions.iter_mut().zip(interactions).for_each(|(slot, m)| *slot = m);
        }
    }
}
