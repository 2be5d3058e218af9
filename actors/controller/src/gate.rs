//! The gate of a robot's filter: a fencing token that only grows, odd while open and even while closed.
//!
//! Every command to a driver carries the token it was written under; the driver discards commands whose token is not
//! the current one. Closing therefore takes effect at once under any interleaving: a command sent before the closing
//! and received after it carries an outdated token (I1).

use std::sync::atomic::{AtomicU64, Ordering};

/// A robot's gate. Several components may close it; only Supervise opens it.
#[derive(Debug, Default)]
pub struct Gate(AtomicU64);

impl Gate {
    /// Restores the gate with the token of an earlier process.
    pub fn resumed(token: u64) -> Gate {
        Gate(AtomicU64::new(token))
    }

    /// Current token.
    pub fn token(&self) -> u64 {
        self.0.load(Ordering::SeqCst)
    }

    /// Returns whether commands of agents pass under this token.
    pub fn opens(token: u64) -> bool {
        token % 2 == 1
    }

    /// Returns whether commands of agents pass now.
    pub fn is_open(&self) -> bool {
        Gate::opens(self.token())
    }

    /// Closes the gate, or voids the token of a closed one: all commands written before are void. Returns the new
    /// token.
    pub fn close(&self) -> u64 {
        // The next even number, for an odd and for an even token: closing a closed gate also voids what was written
        // under its token.
        let next = |t: u64| t + 2 - t % 2;
        match self.0.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |t| Some(next(t))) {
            Ok(before) | Err(before) => next(before),
        }
    }

    /// Opens the gate if its token is still the closed one in `seen`. Returns `None` if the gate was closed again
    /// since, or is open.
    pub fn open(&self, seen: u64) -> Option<u64> {
        // Compare and exchange in one operation: the reflex might close the gate between a read and a write.
        let free =
            !Gate::opens(seen) && self.0.compare_exchange(seen, seen + 1, Ordering::SeqCst, Ordering::SeqCst).is_ok();
        free.then_some(seen + 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn tokens_only_grow_and_opening_needs_the_newest(ops in prop::collection::vec((any::<bool>(), 0_u64..4), 0..50)) {
            let gate = Gate::default();
            for (close, back) in ops {
                let before = gate.token();
                prop_assert_eq!(Gate::resumed(before).token(), before);
                if close {
                    let token = gate.close();
                    prop_assert!(token > before && token <= before + 2 && !gate.is_open());
                } else {
                    let opened = gate.open(before.saturating_sub(back));
                    prop_assert_eq!(opened.is_some(), back.min(before) == 0 && !Gate::opens(before));
                    prop_assert_eq!(gate.is_open(), opened.is_some() || Gate::opens(before));
                }
            }
        }
    }
}
