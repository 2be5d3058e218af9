//! A sink that compares a run with the journal of another one, event by event.

use crate::run::Done;
use mobee_contract::{Entry, Event, Sink, Time};
use mobee_journal::journal::{Fingerprint, JournalError, JournalLine, JournalLines, read};
use mobee_runtime::system::Control;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::mpsc;

/// The result of the comparison, shared with the sink.
#[derive(Clone, Default)]
pub(super) struct Verdict(Arc<Mutex<Found>>);

#[derive(Default)]
struct Found {
    equal: u64,
    difference: Option<String>,
    /// The next recorded event, if the run ended before it.
    missing: Option<JournalLine>,
}

impl Verdict {
    fn lock(&self) -> MutexGuard<'_, Found> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The number of equal events, once the run is over.
    ///
    /// # Errors
    /// The first difference, as text.
    pub(super) fn after(&self, done: &Done) -> Result<u64, String> {
        let found = self.lock();
        if let Some(difference) = &found.difference {
            return Err(difference.clone());
        }
        match &found.missing {
            Some(line) => Err(differ(line.n, Some(line), done.end.ended_at, None)),
            None => Ok(found.equal),
        }
    }
}

/// The sink; clones share its state.
#[derive(Clone)]
pub(super) struct Compare(Arc<Mutex<Core>>);

struct Core {
    lines: JournalLines,
    hash: Fingerprint,
    n: u64,
    until: Option<Time>,
    verdict: Verdict,
    stop: mpsc::Sender<Control>,
}

impl Compare {
    /// Compares with the journal in `dir`, up to the time `until` if it is given.
    ///
    /// # Errors
    /// If the journal can't be opened.
    pub(super) fn new(
        dir: &Path,
        until: Option<Time>,
        verdict: Verdict,
        stop: mpsc::Sender<Control>,
    ) -> Result<Compare, JournalError> {
        let mut core = Core { lines: read(dir)?, hash: Fingerprint::default(), n: 0, until, verdict, stop };
        core.expect();
        Ok(Compare(Arc::new(Mutex::new(core))))
    }
}

impl Core {
    /// Reads the next expected event. A journal that a crash cut off ends there.
    fn expect(&mut self) {
        let next = self.lines.next().and_then(Result::ok);
        self.verdict.lock().missing = next.filter(|line| self.until.is_none_or(|until| line.at < until));
    }

    fn event(&mut self, at: Time, event: &Event) {
        if self.until.is_some_and(|until| at >= until) || self.verdict.lock().difference.is_some() {
            return;
        }
        self.hash.add(at, event);
        let expected = self.verdict.lock().missing.take();
        if expected.as_ref().is_some_and(|line| line.hash == self.hash.hex()) {
            self.verdict.lock().equal += 1;
            self.n += 1;
            return self.expect();
        }
        self.verdict.lock().difference = Some(differ(self.n, expected.as_ref(), at, Some(event)));
        // full or closed: the run is ending already
        let _ = self.stop.try_send(Control::Abort);
    }
}

impl Sink for Compare {
    fn write(&mut self, at: Time, entry: &Entry) -> Result<(), String> {
        if let Entry::Event(event) = entry {
            self.0.lock().unwrap_or_else(PoisonError::into_inner).event(at, event);
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), String> {
        Ok(())
    }
}

fn differ(n: u64, recorded: Option<&JournalLine>, at: Time, now: Option<&Event>) -> String {
    let text = |at: Time, event: &Event| {
        let event = serde_json::to_string(event).unwrap_or_else(|e| e.to_string());
        format!("{:.6} s {event}", at.secs())
    };
    let recorded = recorded.map_or_else(|| "no more events".to_owned(), |line| text(line.at, &line.event));
    let now = now.map_or_else(|| format!("{:.6} s the end", at.secs()), |event| text(at, event));
    format!("the first difference is at event {n}\n  recorded: {recorded}\n  now:      {now}")
}
