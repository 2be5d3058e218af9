//! The events of a run on the terminal, while it runs.
//!
//! With a real clock, each rollback, hold, death, swap and warning is a line, at most [`MAX_LINES`] in [`WINDOW`];
//! further ones are summed up. In virtual time, thousands of times faster, only warnings are printed. All lines go to
//! standard error.

use super::progress::Bar;
use crate::narrate::{Line, Narrator, Weight, timed};
use mobee_contract::{Entry, Event, Sink, Time};
use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Lines printed per window; further ones are counted.
const MAX_LINES: usize = 12;
/// Duration of a window.
const WINDOW: Duration = Duration::from_secs(10);
/// Warnings that a run in virtual time prints; the journal has all of them.
const MAX_VIRTUAL_WARNINGS: u32 = 20;
/// Number of failed motions in the summary.
const MAX_RECENT: usize = 5;

/// The last failed motions of a run, as lines for its summary.
#[derive(Clone, Debug, Default)]
pub(crate) struct RecentFailures(Arc<Mutex<VecDeque<String>>>);

impl RecentFailures {
    /// The lines, oldest first.
    pub(crate) fn lines(&self) -> Vec<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).iter().cloned().collect()
    }

    fn push(&self, line: String) {
        let mut lines = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if lines.len() >= MAX_RECENT {
            lines.pop_front();
        }
        lines.push_back(line);
    }
}

/// Settings of the terminal's output.
#[derive(Clone, Debug)]
pub(crate) struct TerminalSettings {
    /// True if all news is printed, not only warnings: with a real clock a person can follow.
    pub(super) live: bool,
    /// True if only warnings are printed.
    pub(super) quiet: bool,
    /// Lines that are printed when the run begins.
    pub(super) ready: Vec<String>,
    /// Receives the failed motions for the summary.
    pub(super) recent: RecentFailures,
}

/// The sink that prints events.
pub(super) struct EventPrinter {
    bar: Bar,
    settings: TerminalSettings,
    narrator: Narrator,
    rate: RateLimit,
    warnings: u32,
}

impl EventPrinter {
    /// Prints above this progress bar.
    pub(super) fn new(bar: Bar, settings: TerminalSettings, narrator: Narrator) -> EventPrinter {
        EventPrinter { bar, settings, narrator, rate: RateLimit::default(), warnings: 0 }
    }

    fn line(&mut self, at: Time, line: &Line) {
        let is_warning = line.weight == Weight::Warning;
        let text = match is_warning {
            true => format!("warning, {}", timed(at, &line.text)),
            false => timed(at, &line.text),
        };
        if self.settings.live {
            if is_warning || (line.weight == Weight::News && !self.settings.quiet) {
                self.rate.line(at, line.kind, text).iter().for_each(|line| self.bar.print_line(line));
            }
            return;
        }
        if is_warning {
            self.warnings += 1;
            if self.warnings <= MAX_VIRTUAL_WARNINGS {
                self.bar.print_line(&text);
            }
            if self.warnings == MAX_VIRTUAL_WARNINGS {
                self.bar.print_line("warning: further ones are in the journal");
            }
        }
    }
}

impl Sink for EventPrinter {
    fn write(&mut self, at: Time, entry: &Entry) -> Result<(), String> {
        let event = match entry {
            Entry::Event(event) => event,
            Entry::Scene(scene) => {
                self.narrator.edited(scene);
                return Ok(());
            }
            _ => return Ok(()),
        };
        if let Event::Started { .. } | Event::Resumed { .. } = &**event {
            self.settings.ready.iter().filter(|_| !self.settings.quiet).for_each(|line| self.bar.print_line(line));
        }
        if let Some(line) = self.narrator.line(event) {
            if ["rolled back", "faulted"].contains(&line.kind) {
                self.settings.recent.push(timed(at, &line.text));
            }
            self.line(at, &line);
        }
        if let Event::Ended { .. } = &**event {
            self.rate.summed_up().iter().for_each(|line| self.bar.print_line(line));
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), String> {
        Ok(())
    }
}

/// Bounds the rate of lines: counts those above the limit, and reports them as one line after the window.
#[derive(Debug, Default)]
struct RateLimit {
    since: Option<Time>,
    printed: usize,
    more: BTreeMap<&'static str, u64>,
}

impl RateLimit {
    /// The lines to print now for a new line: the sum of the last window if that has ended, and the line itself unless
    /// the window is full.
    fn line(&mut self, at: Time, kind: &'static str, text: String) -> Vec<String> {
        let mut lines = Vec::new();
        if self.since.is_none_or(|since| at.since(since) >= WINDOW) {
            lines = self.summed_up();
            (self.since, self.printed) = (Some(at), 0);
        }
        if self.printed < MAX_LINES {
            self.printed += 1;
            lines.push(text);
        } else {
            *self.more.entry(kind).or_default() += 1;
        }
        lines
    }

    /// The sum of the lines above the limit, as one line.
    fn summed_up(&mut self) -> Vec<String> {
        let more = std::mem::take(&mut self.more);
        let total: u64 = more.values().sum();
        if total == 0 {
            return Vec::new();
        }
        let kinds: Vec<String> = more.iter().map(|(kind, n)| format!("{n} {kind}")).collect();
        vec![format!("{total} more lines in these {} s ({}); the journal has them", WINDOW.as_secs(), kinds.join(", "))]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_storm_is_summed_up() {
        let mut rate = RateLimit::default();
        let at = |ms: u64| Time(ms * 1_000_000);
        let storm: Vec<String> =
            (0..100).flat_map(|i| rate.line(at(i * 10), "rolled back", format!("line {i}"))).collect();
        assert_eq!(storm.len(), MAX_LINES, "{storm:?}");
        assert_eq!(rate.line(at(1100), "holds", "hold".into()), Vec::<String>::new());
        let after = rate.line(at(30_000), "holds", "later".into());
        assert_eq!(after, ["89 more lines in these 10 s (1 holds, 88 rolled back); the journal has them", "later"]);
        assert_eq!(rate.summed_up(), Vec::<String>::new(), "once");
    }
}
