//! I7: the queue of a link never exceeds its credit. A run that ends in order records the longest queue of each
//! link.

use super::{FoundViolations, Invariant};
use crate::journal::JournalLine;
use mobee_contract::Event;

#[derive(Default)]
pub(super) struct Bounded;

impl Invariant for Bounded {
    fn on(&mut self, line: &JournalLine, found: &mut FoundViolations<'_>) {
        if let Event::Link { link, most, capacity, .. } = &line.event
            && *capacity > 0
            && most > capacity
        {
            found.report(format!("{link}: {most} waited at once, {capacity} may"));
        }
    }
}
