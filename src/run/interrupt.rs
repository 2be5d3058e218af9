//! The wish to end, by signals.

use crate::config::ConfigError;
use crate::signals::{Interrupt, let_large_writes_fail};
use mobee_actors::system::Control;
use std::io::Write;
use tokio::sync::mpsc;

/// Exit code of a run that was left at the third signal, as shells give it for a first.
const ABANDONED: i32 = 130;

/// Ctrl-C, SIGTERM or a hang-up once: end in order. Twice: stop now. Three times: leave at once.
///
/// # Errors
/// If the system gives no thread or poller.
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
            wish(&controls, Control::Stop, "stopping; again to stop now");
            interrupt.wait().await;
            wish(&controls, Control::Abort, "stopping now; again to quit at once");
            interrupt.wait().await;
            std::process::exit(ABANDONED);
        });
    };
    std::thread::Builder::new().name("signals".into()).spawn(listen).map(drop).map_err(no)
}

/// Each wish waits by itself: a busy run must not keep the next one from being heard.
fn wish(controls: &mpsc::Sender<Control>, control: Control, words: &str) {
    let controls = controls.clone();
    tokio::spawn(async move { controls.send(control).await });
    // with the terminal gone there is nobody to be told
    let _ = writeln!(std::io::stderr(), "\n{words}");
}
