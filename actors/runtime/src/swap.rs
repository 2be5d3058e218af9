//! Exchange of a part while the robot runs, as a pure state machine.
//!
//! ```text
//!            Offer          boundary, shadow over          probation over
//!   Settled ------> Shadow -------------------> Probation -------------> Settled
//!      ^              | it fails or refuses       | it fails
//!      +--------------+ discarded without effect  | the old part returns, with a warning
//!      +-------------------------------------------+
//! ```
//!
//! A boundary is a moment with no transaction open: the robot is at rest and every outcome is given. A part
//! takes over only at a boundary, so no command is lost (I6) and the exchange causes no motion (I10).

use mobee_contract::Time;
use std::time::Duration;

#[cfg(test)]
mod tests;

/// Requirements on a new part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SwapPolicy {
    /// Time for which it receives all inputs while its intents are recorded, not executed.
    pub shadow: Duration,
    /// Time for which the old part is retained after the exchange, to return if the new one fails.
    pub probation: Duration,
    /// Longest time for an answer until its probation is over.
    pub budget: Duration,
}

impl Default for SwapPolicy {
    fn default() -> SwapPolicy {
        SwapPolicy { shadow: Duration::ZERO, probation: Duration::from_secs(10), budget: Duration::from_secs(1) }
    }
}

/// Phase of a swap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Phase {
    /// There is one part, and it is trusted.
    #[default]
    Settled,
    /// A new part observes until this time, and takes over at the first boundary after it.
    Shadow(Time),
    /// The new part has taken over; the old one is retained until this time.
    Probation(Time),
}

/// Input of the state machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SwapIn {
    /// A new part was built and checked.
    Offer(SwapPolicy),
    /// No transaction is open.
    Boundary,
    /// Time passed.
    Tick,
    /// The part answered correctly.
    Answered,
    /// The new part is in place, in response to [`SwapOut::HandOver`].
    TookOver,
    /// The new part panicked, refused the old part's state, or exceeded its time.
    Broke,
}

/// Required action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SwapOut {
    /// Store the new part beside the old one.
    Keep,
    /// Refuse the offer: another swap is under way.
    Busy,
    /// Give the new part the old part's inputs.
    Rehearse,
    /// Transfer the old part's state to the new one, and put it in the old one's place.
    HandOver,
    /// Drop the new part.
    Discard,
    /// Put the old part back.
    Revert,
    /// Drop the old part.
    Settle,
}

/// State machine of a swap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SwapCore {
    phase: Phase,
    terms: SwapPolicy,
    /// True if the new part has answered since it took over: one without an answer is never trusted.
    answered: bool,
}

impl SwapCore {
    /// Current phase.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Requirements of the present swap.
    pub fn terms(&self) -> SwapPolicy {
        self.terms
    }

    /// Takes one input.
    pub fn on(&mut self, input: SwapIn, now: Time) -> Option<SwapOut> {
        let (phase, out) = match (self.phase, input) {
            (Phase::Settled, SwapIn::Offer(terms)) => {
                self.terms = terms;
                (Phase::Shadow(now + terms.shadow), SwapOut::Keep)
            }
            (phase, SwapIn::Offer(_)) => (phase, SwapOut::Busy),
            (Phase::Shadow(until), SwapIn::Boundary) if now < until => (self.phase, SwapOut::Rehearse),
            (Phase::Shadow(_), SwapIn::Boundary) => (self.phase, SwapOut::HandOver),
            (Phase::Shadow(_), SwapIn::TookOver) => {
                self.answered = false;
                self.phase = Phase::Probation(now + self.terms.probation);
                return None;
            }
            (Phase::Shadow(_), SwapIn::Broke) => (Phase::Settled, SwapOut::Discard),
            (Phase::Probation(_), SwapIn::Broke) => (Phase::Settled, SwapOut::Revert),
            (Phase::Probation(until), SwapIn::Boundary | SwapIn::Tick) if now >= until && self.answered => {
                (Phase::Settled, SwapOut::Settle)
            }
            (Phase::Probation(_), SwapIn::Answered) => {
                self.answered = true;
                return None;
            }
            _ => return None,
        };
        self.phase = phase;
        Some(out)
    }
}
