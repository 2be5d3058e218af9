//! Signals: requests to end, and files that reach their size limit.

use std::future::poll_fn;
use std::task::Poll;
use tokio::signal::unix::{Signal, SignalKind, signal};

/// SIGXFSZ: a write beyond the limit of a file's size. Linux, macOS and the BSDs agree on the number.
const FILE_TOO_LARGE: i32 = 25;

/// Ctrl-C, the SIGTERM of `timeout` and service managers, and a hang-up of the terminal.
pub(crate) struct Interrupt(Vec<Signal>);

impl Interrupt {
    /// Listens from now on; must be called within a runtime. A hang-up that is ignored, as under `nohup`, stays
    /// ignored.
    pub(crate) fn new() -> Interrupt {
        let mut kinds = vec![SignalKind::interrupt(), SignalKind::terminate()];
        if !is_ignored(SignalKind::hangup()) {
            kinds.push(SignalKind::hangup());
        }
        Interrupt(kinds.into_iter().filter_map(|kind| signal(kind).ok()).collect())
    }

    /// Waits for the next signal.
    pub(crate) async fn wait(&mut self) {
        poll_fn(|cx| {
            let come = self.0.iter_mut().any(|signal| signal.poll_recv(cx).is_ready());
            if come { Poll::Ready(()) } else { Poll::Pending }
        })
        .await;
    }
}

/// Makes a write beyond the size limit of files fail as on a full disk, instead of ending the process. Must be called
/// within a runtime.
pub(crate) fn let_large_writes_fail() {
    // an empty handler is sufficient, and stays installed
    let _ = signal(SignalKind::from_raw(FILE_TOO_LARGE));
}

/// True if the parent process made this one ignore the signal. False without Linux' `/proc`.
fn is_ignored(kind: SignalKind) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| u64::from_str_radix(line.strip_prefix("SigIgn:")?.trim(), 16).ok());
    mask.is_some_and(|mask| mask & (1 << (kind.as_raw_value() - 1)) != 0)
}
