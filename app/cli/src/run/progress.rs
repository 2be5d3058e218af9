//! The progress bar: live counters during a run. Silent if standard error is not a terminal.

use super::Output;
use indicatif::{ProgressBar, ProgressStyle};
use mobee_compose::config::{ClockMode, Config};
use mobee_runtime::system::RunProgress;
use std::io::{IsTerminal, Write};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Wall-clock time between two progress lines of a run in virtual time without a terminal.
const LINE_INTERVAL: Duration = Duration::from_secs(10);

/// A bar with counters. Clones are the same bar.
#[derive(Clone)]
pub struct Bar {
    bar: ProgressBar,
    /// The time of the last progress line; `None` if no such lines are printed.
    lines: Option<Arc<Mutex<Instant>>>,
}

impl Bar {
    /// A bar for this run; with a known end it fills, otherwise it spins.
    pub fn new(config: &Config, output: Output) -> Bar {
        let bar = match config.for_s {
            _ if output.json || output.quiet => ProgressBar::hidden(),
            Some(secs) => ProgressBar::new(secs.ceil() as u64),
            None => ProgressBar::new_spinner(),
        };
        let style = match config.for_s {
            Some(_) => "{prefix} {bar:30} {pos}/{len} s  {msg}",
            None => "{spinner} {prefix}  {msg}",
        };
        bar.set_style(ProgressStyle::with_template(style).unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar.set_prefix(config.name.clone());
        let lines = config.clock == ClockMode::Virtual && !output.quiet && !std::io::stderr().is_terminal();
        #[expect(clippy::disallowed_methods, reason = "lines are spaced for a person, who lives by the wall's clock")]
        let lines = lines.then(|| Arc::new(Mutex::new(Instant::now())));
        Bar { bar, lines }
    }

    /// Shows the newest counters.
    pub fn show(&self, p: &RunProgress) {
        self.line(p);
        let c = &p.counts;
        self.bar.set_position(p.at.secs() as u64);
        self.bar.set_message(format!(
            "{:02}:{:02}:{:02} simulated   commits {}   rolled back {}   faulted {}   hard contacts {}",
            p.at.0 / 3_600_000_000_000,
            p.at.0 / 60_000_000_000 % 60,
            p.at.0 / 1_000_000_000 % 60,
            c.commits,
            c.rolled_back,
            c.faulted,
            c.hard_contacts
        ));
    }

    /// Prints a line with the newest counters every ten seconds if no bar is visible.
    fn line(&self, p: &RunProgress) {
        let Some(last) = &self.lines else { return };
        #[expect(clippy::disallowed_methods, reason = "lines are spaced for a person, who lives by the wall's clock")]
        let now = Instant::now();
        let mut last = last.lock().unwrap_or_else(PoisonError::into_inner);
        if now.duration_since(*last) < LINE_INTERVAL {
            return;
        }
        *last = now;
        let minutes = p.at.secs() / 60.0;
        let c = &p.counts;
        self.print_line(&format!("{minutes:.1} min simulated: {} motions, {} rolled back", c.commits, c.rolled_back));
    }

    /// Prints a line above the bar, on standard error.
    pub fn print_line(&self, line: &str) {
        self.bar.suspend(|| {
            // the terminal may be gone
            let _ = writeln!(std::io::stderr(), "{}", mobee_model::printable(line));
        });
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}
