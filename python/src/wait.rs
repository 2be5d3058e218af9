//! Long work: without the interpreter's lock, and ended by Ctrl-C within 0.1 s.

use crate::failure::Failure;
use pyo3::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

/// Period of looking at signals.
pub(crate) const SIGNAL_PERIOD: Duration = Duration::from_millis(30);
/// Desired duration of a chunk of a batch.
const CHUNK: Duration = Duration::from_millis(10);
/// The largest chunk, rows.
const MOST_ROWS: usize = 1 << 16;
/// Reports that wait to be looked at; more are dropped.
const MAX_REPORTS: usize = 64;
/// Stack of a worker: as the main thread has.
const STACK_BYTES: usize = 8 << 20;

/// Set when the caller has gone.
#[derive(Clone, Debug, Default)]
pub(crate) struct Cancelled(Arc<AtomicBool>);

impl Cancelled {
    /// Marks that the caller has gone.
    pub fn set(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Tests that the result is no longer needed.
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Reports of work under way: the step, and the share of it that is done.
pub(crate) type Reports = SyncSender<(&'static str, f64)>;

/// Runs work on a thread of its own and waits for it. After Ctrl-C the call ends at once, and the work when it looks at [`Cancelled`].
///
/// # Arguments
/// * `progress`: called in this thread with what the work reports.
///
/// # Errors
/// The work's own; an exception of a signal or of `progress`; a panic of the work.
pub(crate) fn background<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Cancelled, &Reports) -> Result<T, Failure> + Send + 'static,
) -> PyResult<T> {
    let cancelled = Cancelled::default();
    let (reports, reported) = sync_channel(MAX_REPORTS);
    let (done, result) = sync_channel(1);
    let seen = cancelled.clone();
    let run = move || {
        // fails if the caller has gone
        let _ = done.send(work(&seen, &reports));
    };
    thread::Builder::new().name("mobee".to_owned()).stack_size(STACK_BYTES).spawn(run).map_err(|e| {
        Failure::new("threads", format!("no thread could be started: {e}"), "end other threads, or raise the limit")
    })?;
    let outcome = wait(py, progress, &reported, result);
    cancelled.set();
    Ok(outcome??)
}

fn wait<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    reported: &Receiver<(&'static str, f64)>,
    mut result: Receiver<Result<T, Failure>>,
) -> PyResult<Result<T, Failure>> {
    loop {
        let (back, got) = py.detach(move || {
            let got = result.recv_timeout(SIGNAL_PERIOD);
            (result, got)
        });
        result = back;
        let newest = reported.try_iter().last();
        if let (Some(progress), Some(report)) = (progress, newest) {
            progress.call1(report)?;
        }
        match got {
            Ok(outcome) => return Ok(outcome),
            Err(RecvTimeoutError::Timeout) => py.check_signals()?,
            Err(RecvTimeoutError::Disconnected) => return Err(internal().into()),
        }
    }
}

/// A panic: a bug of ours.
pub(crate) fn internal() -> Failure {
    Failure::new("internal", "the computation failed", "this is a bug of mobee: please report it with these arguments")
}

/// Rows of a batch, chunk by chunk, as long as each takes about 10 ms; looks at signals in between.
///
/// # Arguments
/// * `first`: rows of the first chunk. A batch of no more than that is answered without giving up the interpreter's lock if it is a
///   single row: to get it back may take longer than the answer.
/// * `load`: fills in rows, with the lock: from, and how many.
/// * `work`: answers them, without it.
#[expect(clippy::disallowed_methods, reason = "how long a chunk takes, which no answer depends on")]
pub(crate) fn chunks(
    py: Python<'_>,
    rows: usize,
    first: usize,
    mut load: impl FnMut(usize, usize, &mut Vec<f64>) -> PyResult<()>,
    mut work: impl FnMut(&mut [f64], usize) -> Result<(), Failure> + Send,
) -> PyResult<()> {
    let mut buffer = Vec::new();
    let (mut from, mut size) = (0, first);
    while from < rows {
        let count = size.min(rows - from);
        buffer.clear();
        load(from, count, &mut buffer)?;
        if rows == 1 && first > 1 {
            work(&mut buffer, 0)?;
            return Ok(());
        }
        let began = Instant::now();
        let (buffer, work) = (&mut buffer, &mut work);
        py.detach(move || work(buffer, from))?;
        let took = began.elapsed();
        size = match () {
            () if took < CHUNK / 2 => (2 * size).min(MOST_ROWS),
            () if took > 2 * CHUNK => (size / 2).max(1),
            () => size,
        };
        py.check_signals()?;
        from += count;
    }
    Ok(())
}
