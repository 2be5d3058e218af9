//! Slot of an exchangeable part beside the robots. It survives the part's actor, which takes the part to run
//! from it.

use super::LatestCell;
use crate::swap::{Phase, SwapCore, SwapIn, SwapOut, SwapPolicy};
use mobee_contract::Time;
use std::time::Duration;

/// The active part, and the previous one while the new one is on probation.
#[derive(Debug)]
pub struct PartSlot<P>(LatestCell<SlotState<P>>);

#[derive(Debug)]
struct SlotState<P> {
    part: P,
    former: Option<P>,
    core: SwapCore,
}

impl<P: Clone> PartSlot<P> {
    /// Creates the slot with its first part, which is trusted.
    pub fn new(part: P) -> PartSlot<P> {
        PartSlot(LatestCell::new(SlotState { part, former: None, core: SwapCore::default() }))
    }

    /// Returns the active part.
    pub fn part(&self) -> P {
        self.0.lock().part.clone()
    }

    /// Changes the active part.
    pub fn change(&self, change: impl FnOnce(&mut P)) {
        change(&mut self.0.lock().part);
    }

    /// Announces a new part. `false` if another exchange is under way.
    pub fn offer(&self, terms: SwapPolicy, now: Time) -> bool {
        self.0.lock().core.on(SwapIn::Offer(terms), now) == Some(SwapOut::Keep)
    }

    /// True if a new part is announced that has not taken over.
    pub fn is_offered(&self) -> bool {
        matches!(self.0.lock().core.phase(), Phase::Shadow(_))
    }

    /// Withdraws the announced part.
    pub fn withdraw(&self, now: Time) {
        let mut state = self.0.lock();
        // A part that has taken over is active.
        if state.former.is_none() {
            state.core.on(SwapIn::Broke, now);
        }
    }

    /// Activates the announced part; the previous one is retained until the new one is trusted. `false` if it
    /// was withdrawn.
    pub fn take_over(&self, new: P, now: Time) -> bool {
        let mut state = self.0.lock();
        let takes_over = state.core.on(SwapIn::Boundary, now) == Some(SwapOut::HandOver);
        if takes_over {
            state.core.on(SwapIn::TookOver, now);
            state.former = Some(std::mem::replace(&mut state.part, new));
        }
        takes_over
    }

    /// Records that the active part worked.
    pub fn answered(&self, now: Time) {
        self.0.lock().core.on(SwapIn::Answered, now);
    }

    /// Records a failure of the active part. Returns true if it was on probation and the previous one has
    /// returned.
    pub fn broke(&self, now: Time) -> bool {
        let mut state = self.0.lock();
        let former = state.former.take();
        let reverts = former.is_some();
        if let Some(former) = former {
            state.core.on(SwapIn::Broke, now);
            state.part = former;
        }
        reverts
    }

    /// Returns true if the probation of the active part ends with this call: the previous one is then dropped.
    pub fn settles(&self, now: Time) -> bool {
        let mut state = self.0.lock();
        let settles = state.core.on(SwapIn::Tick, now) == Some(SwapOut::Settle);
        if settles {
            state.former = None;
        }
        settles
    }

    /// Time limit for an answer of the active part, if it is on probation.
    pub fn budget(&self) -> Option<Duration> {
        let state = self.0.lock();
        state.former.as_ref().map(|_| state.core.terms().budget)
    }
}
