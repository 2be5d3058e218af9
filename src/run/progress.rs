//! The progress bar: live counters while a run goes on. Silent when standard error is no terminal.

use crate::config::Config;
use indicatif::{ProgressBar, ProgressStyle};
use mobee_actors::system::RunProgress;
use std::io::Write;

/// A bar with counters. Clones are the same bar.
#[derive(Clone)]
pub struct Bar(ProgressBar);

impl Bar {
    /// A bar for this run; with a known end it fills, else it spins.
    pub fn new(config: &Config, quiet: bool) -> Bar {
        let bar = match config.for_s {
            _ if quiet => ProgressBar::hidden(),
            Some(secs) => ProgressBar::new(secs.ceil() as u64),
            None => ProgressBar::new_spinner(),
        };
        let style = match config.for_s {
            Some(_) => "{prefix} {bar:30} {pos}/{len} s  {msg}",
            None => "{spinner} {prefix}  {msg}",
        };
        bar.set_style(ProgressStyle::with_template(style).unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar.set_prefix(config.name.clone());
        Bar(bar)
    }

    /// Shows the newest counters.
    pub fn show(&self, p: &RunProgress) {
        let c = &p.counts;
        self.0.set_position(p.at.secs() as u64);
        self.0.set_message(format!(
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

    /// Says a line above the bar, on standard error.
    pub fn say(&self, line: &str) {
        self.0.suspend(|| {
            // with the terminal gone there is nobody to be told
            let _ = writeln!(std::io::stderr(), "{}", mobee_model::printable(line));
        });
    }

    /// Takes the bar away.
    pub fn finish(&self) {
        self.0.finish_and_clear();
    }
}
