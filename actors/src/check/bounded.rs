//! I7: no more wait on a link than its credit allows. The most that waited at once is told when a run ends in order.

use super::{Found, Invariant};
use crate::record::journal::JournalLine;
use mobee_contract::Event;

#[derive(Default)]
pub(super) struct Bounded;

impl Invariant for Bounded {
    fn on(&mut self, line: &JournalLine, found: &mut Found<'_>) {
        if let Event::Link { link, most, capacity, .. } = &line.event
            && *capacity > 0
            && most > capacity
        {
            found.say(format!("{link}: {most} waited at once, {capacity} may"));
        }
    }
}
