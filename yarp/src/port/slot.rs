//! Queue of an output's unsent messages.

use super::{Payload, lock};
use crate::Dialect;
use crate::clock;
use bytes::Bytes;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use std::time::Duration;
use tokio::sync::Notify;
use tokio::time::Instant;

/// Time that a message may wait before a newer one replaces it: a process that the machine delays for some
/// milliseconds loses nothing of a stream at 1 kHz, like the real library, which blocks its writer.
const HICCUP: Duration = Duration::from_millis(20);
/// Largest number of messages that wait in this way.
const MAX_WAITING: usize = 32;

/// Policy for connections that are slower than the writer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Delivery {
    /// The newest unsent message replaces those that have waited for more than 20 ms; they are dropped and
    /// counted.
    Newest,
    /// Up to this number (at least 1) wait per connection, in order; further messages are dropped and
    /// counted.
    Strict(usize),
}

/// A message to be sent, encoded at most once in each form for all connections.
pub(crate) struct Packet {
    pub payload: Payload,
    pub envelope: Option<String>,
    binary: OnceLock<Option<Bytes>>,
    text: OnceLock<Option<Vec<u8>>>,
}

impl Packet {
    pub fn new(payload: Payload, envelope: Option<String>) -> Packet {
        Packet { payload, envelope, binary: OnceLock::new(), text: OnceLock::new() }
    }

    /// Payload for binary carriers; `None` if it has no such form.
    pub fn binary(&self, dialect: Dialect) -> Option<&[u8]> {
        self.binary.get_or_init(|| self.payload.binary(dialect).ok()).as_deref()
    }

    /// Payload for text carriers; `None` if it has no such form.
    pub fn text(&self, dialect: Dialect) -> Option<&[u8]> {
        self.text.get_or_init(|| self.payload.text(dialect).ok()).as_deref()
    }
}

/// Queue between a writer and one of its connections.
pub(crate) struct Slot {
    delivery: Delivery,
    state: Mutex<OutputSlotState>,
    bell: Notify,
    idle: Notify,
    dropped: Arc<AtomicU64>,
}

#[derive(Default)]
struct OutputSlotState {
    /// Packets, each with the time at which it was added.
    packets: VecDeque<(Instant, Arc<Packet>)>,
    /// True if a packet was taken that is not sent and acknowledged yet.
    busy: bool,
    quit: bool,
    closed: bool,
}

impl Slot {
    pub fn new(delivery: Delivery, dropped: Arc<AtomicU64>) -> Slot {
        Slot { delivery, state: Mutex::default(), bell: Notify::new(), idle: Notify::new(), dropped }
    }

    /// Adds a packet; never blocks.
    pub fn put(&self, packet: Arc<Packet>) {
        let mut state = lock(&self.state);
        if state.quit || state.closed {
            return;
        }
        let now = clock::now();
        let before = state.packets.len();
        match self.delivery {
            Delivery::Newest => {
                let old = |since: &Instant| now.duration_since(*since) > HICCUP;
                while state.packets.front().is_some_and(|(since, _)| old(since)) || state.packets.len() >= MAX_WAITING {
                    state.packets.pop_front();
                }
                let dropped = before - state.packets.len();
                self.dropped.fetch_add(dropped as u64, Ordering::Relaxed);
            }
            Delivery::Strict(most) if before >= most.max(1) => {
                self.dropped.fetch_add(1, Ordering::Relaxed);
                return;
            }
            Delivery::Strict(_) => {}
        }
        state.packets.push_back((now, packet));
        self.bell.notify_one();
    }

    /// Takes the next packet; `None` when the connection has to quit and all packets are sent. The packet
    /// taken before counts as sent. Cancel safe.
    pub async fn take(&self) -> Option<Arc<Packet>> {
        loop {
            let rings = self.bell.notified();
            {
                let mut state = lock(&self.state);
                let packet = state.packets.pop_front().map(|(_, packet)| packet);
                state.busy = packet.is_some();
                match packet {
                    Some(packet) => return Some(packet),
                    None if state.quit => return None,
                    None => self.idle.notify_waiters(),
                }
            }
            rings.await;
        }
    }

    /// Requests the connection to send its queue and then to quit.
    pub fn quit(&self) {
        lock(&self.state).quit = true;
        self.bell.notify_one();
    }

    /// Discards the queue, because the connection is gone.
    pub fn close(&self) {
        let mut state = lock(&self.state);
        state.closed = true;
        state.busy = false;
        state.packets.clear();
        self.idle.notify_waiters();
    }

    /// Waits until everything is sent and acknowledged, or the connection is gone.
    pub async fn drained(&self) {
        loop {
            let idle = self.idle.notified();
            tokio::pin!(idle);
            idle.as_mut().enable();
            {
                let state = lock(&self.state);
                if state.closed || (state.packets.is_empty() && !state.busy) {
                    return;
                }
            }
            idle.await;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Bottle;

    /// Messages of a stream at 1 kHz that are sent after the connection was blocked for this time, ms, and the
    /// number of dropped ones.
    async fn held_up(ms: i32) -> (Vec<i32>, u64) {
        let dropped = Arc::new(AtomicU64::new(0));
        let slot = Slot::new(Delivery::Newest, dropped.clone());
        for n in 0..ms {
            slot.put(Arc::new(Packet::new(Bottle::of([n]).into(), Some(n.to_string()))));
            tokio::time::advance(Duration::from_millis(1)).await;
        }
        slot.quit();
        let mut sent = Vec::new();
        while let Some(packet) = slot.take().await {
            sent.extend(packet.envelope.as_deref().and_then(|n| n.parse::<i32>().ok()));
        }
        (sent, dropped.load(Ordering::Relaxed))
    }

    #[tokio::test(start_paused = true)]
    async fn a_stream_that_is_held_up_for_a_moment_loses_nothing_and_is_never_old() {
        assert_eq!(held_up(15).await, ((0..15).collect(), 0));
        let (sent, dropped) = held_up(100).await;
        assert_eq!(sent, (79..100).collect::<Vec<_>>(), "those of the last 20 ms");
        assert_eq!(dropped, 79);
    }
}
