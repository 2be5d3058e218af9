//! What goes wrong while a run goes on, said on the terminal at once.

use super::progress::Bar;
use mobee_contract::{Entry, Event, Sink, SwapStep, Time};

/// After so many warnings the journal alone has them.
const MOST: u32 = 20;

/// Prints warnings.
pub(super) struct Said {
    bar: Bar,
    said: u32,
}

impl Said {
    /// Above this progress bar.
    pub(super) fn new(bar: Bar) -> Said {
        Said { bar, said: 0 }
    }
}

impl Sink for Said {
    fn write(&mut self, at: Time, entry: &Entry) -> Result<(), String> {
        let Entry::Event(event) = entry else { return Ok(()) };
        let text = match &**event {
            Event::Warning { text } => text.clone(),
            Event::Swap { robot: name, part, step } | Event::SwapBeside { name, part, step }
                if matches!(step, SwapStep::Refused { .. } | SwapStep::Reverted { .. }) =>
            {
                format!("{name}: swap of the {part}: {step}")
            }
            Event::GaveUp { group } => format!("{group} used up its restarts"),
            _ => return Ok(()),
        };
        self.said += 1;
        if self.said <= MOST {
            self.bar.say(&format!("warning, {:.1} s: {text}", at.secs()));
        }
        if self.said == MOST {
            self.bar.say("warning: further ones are in the journal");
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), String> {
        Ok(())
    }
}
