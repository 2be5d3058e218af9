//! I6 and I7: on every link, sent = handled + queued + dropped, and no more wait than its credit allows. The counters are told
//! when a run ends in order.
//!
//! I7 is named in its sentence: both are read off one event.

use super::{Found, Invariant};
use crate::journal::Line;
use mobee_contract::Event;

pub(super) struct NothingVanishes;

impl Invariant for NothingVanishes {
    fn on(&mut self, line: &Line, found: &mut Found<'_>) {
        if let Event::Link { link, sent, handled, queued, dropped, most, capacity } = &line.event {
            let known = [*handled, *queued, *dropped].into_iter().fold(0_u64, u64::saturating_add);
            if *sent != known {
                found.say(format!("{link}: {sent} sent, but {handled} handled, {queued} queued, {dropped} dropped"));
            }
            if *capacity > 0 && most > capacity {
                found.say_of("I7", format!("{link}: {most} waited at once, {capacity} may"));
            }
        }
    }
}
