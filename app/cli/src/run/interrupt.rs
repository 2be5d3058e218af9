//! Signals that end the run.

use crate::signals::{Interrupt, let_large_writes_fail};
use mobee_compose::config::ConfigError;
use mobee_runtime::system::Control;
use std::io::Write;
use tokio::sync::mpsc;

/// Exit code of a run that is abandoned at the third signal: the shells' code for SIGINT.
const EXIT_ABANDONED: i32 = 130;

/// Listens for Ctrl-C, SIGTERM and hang-up. First: end in order. Second: stop now. Third: exit at once.
///
/// # Errors
/// If no thread or runtime can be created.
pub(super) fn listen(controls: mpsc::Sender<Control>) -> Result<(), ConfigError> {
    let no = |e: std::io::Error| ConfigError::plain(format!("can't listen for signals: {e}"), "free some resources");
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(no)?;
    let mut interrupt = {
        let _within = runtime.enter();
        let_large_writes_fail();
        Interrupt::new()
    };
    let listen = move || {
        runtime.block_on(async {
            interrupt.wait().await;
            request(&controls, Control::Stop, "stopping; again to stop now");
            interrupt.wait().await;
            request(&controls, Control::Abort, "stopping now; again to quit at once");
            interrupt.wait().await;
            std::process::exit(EXIT_ABANDONED);
        });
    };
    std::thread::Builder::new().name("signals".into()).spawn(listen).map(drop).map_err(no)
}

/// Sends in a task of its own: a busy run must not delay the next signal.
fn request(controls: &mpsc::Sender<Control>, control: Control, words: &str) {
    let controls = controls.clone();
    tokio::spawn(async move { controls.send(control).await });
    // the terminal may be gone
    let _ = writeln!(std::io::stderr(), "\n{words}");
}
