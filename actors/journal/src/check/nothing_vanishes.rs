//! I6: on every link, sent = handled + queued + dropped. A run that ends in order records the counters.

use super::{FoundViolations, Invariant};
use crate::journal::JournalLine;
use mobee_contract::Event;

#[derive(Default)]
pub(super) struct NothingVanishes;

impl Invariant for NothingVanishes {
    fn on(&mut self, line: &JournalLine, found: &mut FoundViolations<'_>) {
        if let Event::Link { link, sent, handled, queued, dropped, .. } = &line.event {
            let known = [*handled, *queued, *dropped].into_iter().fold(0_u64, u64::saturating_add);
            if *sent != known {
                found.report(format!("{link}: {sent} sent, but {handled} handled, {queued} queued, {dropped} dropped"));
            }
        }
    }
}
