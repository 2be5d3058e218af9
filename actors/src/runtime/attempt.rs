//! Calls into a part that is not trusted yet: its panic ends nobody else, and it has only so much time.

use crate::runtime::clock::{Clock, ClockKind};
use crate::runtime::load::Load;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Duration;

/// What a call gave, and what it cost by a virtual clock.
pub(crate) struct Given<T> {
    pub(crate) value: T,
    pub(crate) cost: Duration,
}

/// Runs `call`: by a virtual clock at once, and then its cost passes; by a real clock on a thread of its own, which is left
/// behind if it takes longer than the budget.
///
/// # Errors
/// What went wrong, as a sentence; whatever the closure owned is lost then.
pub(crate) async fn attempt<T: Send + 'static>(
    clock: &Clock,
    budget: Duration,
    call: impl FnOnce() -> Given<T> + Send + 'static,
) -> Result<T, String> {
    let slow = || format!("it did not answer within {} s", budget.as_secs_f64());
    let caught = move || {
        // what it leaves half-done is thrown away with it
        catch_unwind(AssertUnwindSafe(call)).map_err(|panic| {
            let text = panic.downcast_ref::<&str>().map(|s| (*s).to_string());
            let text = text.or_else(|| panic.downcast_ref::<String>().cloned());
            format!("it panicked: {}", text.unwrap_or_else(|| "no words".into()))
        })
    };
    if clock.kind() == ClockKind::Virtual {
        let given = caught()?;
        clock.sleep(given.cost.min(budget)).await;
        return if given.cost > budget { Err(slow()) } else { Ok(given.value) };
    }
    let ((done, answer), load) = (tokio::sync::oneshot::channel(), Load::own());
    let thread = std::thread::Builder::new().name("attempt".into()).spawn(move || {
        // nobody may be waiting any more
        let _ = done.send(match load {
            Some(load) => load.counts(caught),
            None => caught(),
        });
    });
    thread.map_err(|e| format!("there is no thread to try it on: {e}"))?;
    match tokio::time::timeout(budget, answer).await {
        Ok(Ok(given)) => given.map(|g| g.value),
        Ok(Err(_)) => Err("it vanished".into()),
        Err(_) => Err(slow()),
    }
}
