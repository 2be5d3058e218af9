//! Where a part sits that runs beside the robots and can be exchanged: it outlives the part's actor, which asks it what to run.

use super::LatestCell;
use crate::runtime::swap::{Phase, SwapCore, SwapIn, SwapOut, SwapPolicy};
use mobee_contract::Time;
use std::time::Duration;

/// The part in force, and the one before it while the new one is on probation.
#[derive(Debug)]
pub struct Seat<P>(LatestCell<Taken<P>>);

#[derive(Debug)]
struct Taken<P> {
    part: P,
    former: Option<P>,
    core: SwapCore,
}

impl<P: Clone> Seat<P> {
    /// With its first part, which is trusted.
    pub fn new(part: P) -> Seat<P> {
        Seat(LatestCell::new(Taken { part, former: None, core: SwapCore::default() }))
    }

    /// The part in force.
    pub fn part(&self) -> P {
        self.0.lock().part.clone()
    }

    /// Changes the part in force.
    pub fn change(&self, change: impl FnOnce(&mut P)) {
        change(&mut self.0.lock().part);
    }

    /// Announces a new part. `false`: another is being tried.
    pub fn offer(&self, terms: SwapPolicy, now: Time) -> bool {
        self.0.lock().core.on(SwapIn::Offer(terms), now) == Some(SwapOut::Keep)
    }

    /// Whether a new part is announced that has not taken over.
    pub fn is_offered(&self) -> bool {
        matches!(self.0.lock().core.phase(), Phase::Shadow(_))
    }

    /// The announced part is not used after all.
    pub fn withdraw(&self, now: Time) {
        let mut taken = self.0.lock();
        // a part that has taken over is in force
        if taken.former.is_none() {
            taken.core.on(SwapIn::Broke, now);
        }
    }

    /// Puts the announced part in; the one before is kept until the new one is trusted. `false`: it was withdrawn.
    pub fn take_over(&self, new: P, now: Time) -> bool {
        let mut taken = self.0.lock();
        let takes_over = taken.core.on(SwapIn::Boundary, now) == Some(SwapOut::HandOver);
        if takes_over {
            taken.core.on(SwapIn::TookOver, now);
            taken.former = Some(std::mem::replace(&mut taken.part, new));
        }
        takes_over
    }

    /// The part in force did its work.
    pub fn answered(&self, now: Time) {
        self.0.lock().core.on(SwapIn::Answered, now);
    }

    /// The part in force failed: on probation the one before is back, and this says so.
    pub fn broke(&self, now: Time) -> bool {
        let mut taken = self.0.lock();
        let former = taken.former.take();
        let reverts = former.is_some();
        if let Some(former) = former {
            taken.core.on(SwapIn::Broke, now);
            taken.part = former;
        }
        reverts
    }

    /// Whether the probation of the part in force is over with this: the one before is then gone.
    pub fn settles(&self, now: Time) -> bool {
        let mut taken = self.0.lock();
        let settles = taken.core.on(SwapIn::Tick, now) == Some(SwapOut::Settle);
        if settles {
            taken.former = None;
        }
        settles
    }

    /// How long the part in force may take for an answer, if it is on probation.
    pub fn budget(&self) -> Option<Duration> {
        let taken = self.0.lock();
        taken.former.as_ref().map(|_| taken.core.terms().budget)
    }
}
