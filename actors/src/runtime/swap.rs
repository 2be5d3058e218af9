//! Exchanging a part while the robot runs, as a pure state machine.
//!
//! ```text
//!            Offer          boundary, shadow over          probation over
//!   Settled ------> Shadow -------------------> Probation -------------> Settled
//!      ^              | it breaks or refuses       | it breaks
//!      +--------------+ discarded, nothing was     | the old part returns, loudly
//!      +-------------------------------------------+
//! ```
//!
//! A boundary is a moment with no transaction open: the robot rests, every outcome is given. Only there a part takes over, so
//! that no command is lost (I6) and nothing moves because of it (I10).

use mobee_contract::Time;
use std::time::Duration;

#[cfg(test)]
mod tests;

/// What a new part must go through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SwapPolicy {
    /// For how long it sees all inputs while its intents are recorded, not executed.
    pub shadow: Duration,
    /// For how long after it took over the old part is kept, to return if the new one breaks.
    pub probation: Duration,
    /// The longest time that it may take for an answer until its probation is over.
    pub budget: Duration,
}

impl Default for SwapPolicy {
    fn default() -> SwapPolicy {
        SwapPolicy { shadow: Duration::ZERO, probation: Duration::from_secs(10), budget: Duration::from_secs(1) }
    }
}

/// Where a swap is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Phase {
    /// There is one part, and it is trusted.
    #[default]
    Settled,
    /// A new one looks on until then, and takes over at the first boundary after it.
    Shadow(Time),
    /// The new one has taken over; the old one is kept until then.
    Probation(Time),
}

/// What happens to a swap.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SwapIn {
    /// A new part, built and checked.
    Offer(SwapPolicy),
    /// No transaction is open.
    Boundary,
    /// Time passed.
    Tick,
    /// The part answered as it should.
    Answered,
    /// The new part is in place: answers [`SwapOut::HandOver`].
    TookOver,
    /// The new part panicked, refused the old one's state, or did not answer in time.
    Broke,
}

/// What is to be done about it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SwapOut {
    /// Keep the new part beside the old one.
    Keep,
    /// Turn the offer down: another swap is under way.
    Busy,
    /// Let the new part see what the old one sees.
    Rehearse,
    /// Give the old part's state to the new one, and put it in the old one's place.
    HandOver,
    /// Forget the new part.
    Discard,
    /// Put the old part back.
    Revert,
    /// Forget the old part.
    Settle,
}

/// The state machine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SwapCore {
    phase: Phase,
    terms: SwapPolicy,
    /// Whether the new part has answered since it took over: one that was never asked is never trusted.
    answered: bool,
}

impl SwapCore {
    /// Where it is.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// What the present swap has to go through.
    pub fn terms(&self) -> SwapPolicy {
        self.terms
    }

    /// One step.
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
