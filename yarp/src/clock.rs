//! Monotonic clock of the machine, used for sockets. Callers of this crate convert it to their time.

use tokio::time::Instant;

/// Now.
#[expect(clippy::disallowed_methods, reason = "peers on sockets live in real time")]
pub(crate) fn now() -> Instant {
    Instant::now()
}
