//! What an output has yet to send.

use super::{Payload, lock};
use crate::Dialect;
use bytes::Bytes;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use tokio::sync::Notify;

/// What a writer does about connections that are slower than it writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Delivery {
    /// The newest unsent message replaces an older one; the older one is dropped and counted.
    Newest,
    /// Up to so many (at least 1) wait per connection, in order; what comes beyond is dropped and counted.
    Strict(usize),
}

/// A message to be sent, written at most once in each form however many connections there are.
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

    /// The payload for binary carriers; `None` if it has no such form.
    pub fn binary(&self, dialect: Dialect) -> Option<&[u8]> {
        self.binary.get_or_init(|| self.payload.binary(dialect).ok()).as_deref()
    }

    /// The payload for text carriers; `None` if it has no such form.
    pub fn text(&self, dialect: Dialect) -> Option<&[u8]> {
        self.text.get_or_init(|| self.payload.text(dialect).ok()).as_deref()
    }
}

/// The queue between a writer and one of its connections.
pub(crate) struct Slot {
    delivery: Delivery,
    state: Mutex<State>,
    bell: Notify,
    idle: Notify,
    dropped: Arc<AtomicU64>,
}

#[derive(Default)]
struct State {
    packets: VecDeque<Arc<Packet>>,
    /// A packet was taken and is not yet sent and acknowledged.
    busy: bool,
    quit: bool,
    closed: bool,
}

impl Slot {
    pub fn new(delivery: Delivery, dropped: Arc<AtomicU64>) -> Slot {
        Slot { delivery, state: Mutex::default(), bell: Notify::new(), idle: Notify::new(), dropped }
    }

    /// Puts a packet in; never waits.
    pub fn put(&self, packet: Arc<Packet>) {
        let mut state = lock(&self.state);
        if state.quit || state.closed {
            return;
        }
        let full = match self.delivery {
            Delivery::Newest => !state.packets.is_empty(),
            Delivery::Strict(most) => state.packets.len() >= most.max(1),
        };
        if full {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
        match self.delivery {
            Delivery::Newest => state.packets.clear(),
            Delivery::Strict(_) if full => return,
            Delivery::Strict(_) => {}
        }
        state.packets.push_back(packet);
        self.bell.notify_one();
    }

    /// The next packet; `None` when the connection shall quit and all is sent. What was taken before counts as sent.
    /// Cancel safe.
    pub async fn take(&self) -> Option<Arc<Packet>> {
        loop {
            let rings = self.bell.notified();
            {
                let mut state = lock(&self.state);
                let packet = state.packets.pop_front();
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

    /// Asks the connection to send what waits and then to quit.
    pub fn quit(&self) {
        lock(&self.state).quit = true;
        self.bell.notify_one();
    }

    /// The connection is gone: forget what waits.
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
