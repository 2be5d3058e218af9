//! The gate of a robot's filter: a fencing token that only grows, odd while open and even while closed.
//!
//! Every command to a driver carries the token it was written under; the driver throws away what carries another than
//! the present one. So closing takes effect at once and under any interleaving: a command that was sent before and
//! arrives after finds its token outdated (I1).

use std::sync::atomic::{AtomicU64, Ordering};

/// A robot's gate, shared by all who may close it. Only supervise opens it.
#[derive(Debug, Default)]
pub struct Gate(AtomicU64);

impl Gate {
    /// As an earlier process left it.
    pub fn resumed(token: u64) -> Gate {
        Gate(AtomicU64::new(token))
    }

    /// The present token.
    pub fn token(&self) -> u64 {
        self.0.load(Ordering::SeqCst)
    }

    /// Whether commands of agents pass under this token.
    pub fn opens(token: u64) -> bool {
        token % 2 == 1
    }

    /// Whether commands of agents pass now.
    pub fn is_open(&self) -> bool {
        Gate::opens(self.token())
    }

    /// Closes, or closes anew: whatever was written before is void. Returns the new token.
    pub fn close(&self) -> u64 {
        // the next even number, from an odd one as from an even one: closing a closed gate voids what was written under
        // it, too
        let next = |t: u64| t + 2 - t % 2;
        match self.0.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |t| Some(next(t))) {
            Ok(before) | Err(before) => next(before),
        }
    }

    /// Opens, if the gate is still as closed by the token `seen`; `None` if somebody closed it anew since, or it is
    /// open.
    pub fn open(&self, seen: u64) -> Option<u64> {
        // compared and exchanged in one step: between looking and opening the reflex might close
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
