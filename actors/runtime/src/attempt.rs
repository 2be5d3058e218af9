//! Calls into a part that is not trusted yet: its panic is caught, and its time is limited.

use crate::clock::{Clock, ClockKind};
use crate::load::Load;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Duration;

/// Result of a call, and its cost in virtual time.
pub(crate) struct Timed<T> {
    pub(crate) value: T,
    pub(crate) cost: Duration,
}

/// Runs `call` with a time budget. With a virtual clock it runs in place, and then its cost passes. With a real
/// clock it runs on its own thread, which is abandoned if it exceeds the budget.
///
/// # Errors
/// The failure, as a sentence; everything that the closure owned is lost then.
pub(crate) async fn attempt<T: Send + 'static>(
    clock: &Clock,
    budget: Duration,
    call: impl FnOnce() -> Timed<T> + Send + 'static,
) -> Result<T, String> {
    let slow = || format!("it did not answer within {} s", budget.as_secs_f64());
    let caught = move || {
        // State that a panic leaves unfinished is dropped with the closure.
        catch_unwind(AssertUnwindSafe(call)).map_err(|panic| {
            let text = panic.downcast_ref::<&str>().map(|s| (*s).to_string());
            let text = text.or_else(|| panic.downcast_ref::<String>().cloned());
            format!("it panicked: {}", text.unwrap_or_else(|| "no message".into()))
        })
    };
    if clock.kind() == ClockKind::Virtual {
        let timed = caught()?;
        clock.sleep(timed.cost.min(budget)).await;
        return if timed.cost > budget { Err(slow()) } else { Ok(timed.value) };
    }
    let (done, answer) = tokio::sync::oneshot::channel();
    let load = Load::own();
    let thread = std::thread::Builder::new().name("attempt".into()).spawn(move || {
        // The caller may have timed out.
        let _ = done.send(match load {
            Some(load) => load.counts(caught),
            None => caught(),
        });
    });
    thread.map_err(|e| format!("no thread can be started for it: {e}"))?;
    match tokio::time::timeout(budget, answer).await {
        Ok(Ok(timed)) => timed.map(|t| t.value),
        Ok(Err(_)) => Err("it vanished".into()),
        Err(_) => Err(slow()),
    }
}
