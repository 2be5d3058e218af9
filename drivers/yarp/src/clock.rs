//! The machine's own monotonic clock, by which sockets live: callers of this crate make their time of it.

use tokio::time::Instant;

/// Now.
#[expect(clippy::disallowed_methods, reason = "peers on sockets live in real time")]
pub(crate) fn now() -> Instant {
    Instant::now()
}
