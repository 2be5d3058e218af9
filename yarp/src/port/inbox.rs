//! Messages that wait for a reader.

use super::{Message, lock};
use std::collections::VecDeque;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use tokio::sync::Notify;

/// Policy for messages that arrive faster than they are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Queue {
    /// The newest message only; older ones are dropped and counted.
    Newest,
    /// Up to this number (at least 1); then senders wait, and their acknowledgments are delayed. Datagrams
    /// can't wait and are dropped and counted.
    Bounded(usize),
}

pub(crate) struct Inbox {
    queue: Queue,
    state: Mutex<InboxState>,
    /// Notifies the reader.
    bell: Notify,
    /// Notifies senders that wait for room.
    room: Notify,
    dropped: AtomicU64,
}

#[derive(Default)]
struct InboxState {
    messages: VecDeque<Message>,
    closed: bool,
}

impl Inbox {
    pub fn new(queue: Queue) -> Inbox {
        Inbox { queue, state: Mutex::default(), bell: Notify::new(), room: Notify::new(), dropped: AtomicU64::new(0) }
    }

    /// Adds a message; returns it if there is no room now.
    fn put(&self, message: Message) -> Option<Message> {
        let mut state = lock(&self.state);
        match self.queue {
            _ if state.closed => return None,
            Queue::Newest => {
                if !state.messages.is_empty() {
                    self.dropped.fetch_add(1, Ordering::Relaxed);
                }
                state.messages.clear();
            }
            Queue::Bounded(most) if state.messages.len() >= most.max(1) => return Some(message),
            Queue::Bounded(_) => {}
        }
        state.messages.push_back(message);
        self.bell.notify_one();
        None
    }

    /// Adds a message, waiting for room.
    pub async fn push(&self, message: Message) {
        let mut back = Some(message);
        while let Some(message) = back {
            // Created before the attempt: `close` wakes only the waiters that exist by then.
            let room = self.room.notified();
            back = self.put(message);
            if back.is_some() {
                room.await;
            }
        }
    }

    /// Adds a message, or drops it.
    pub fn offer(&self, message: Message) {
        if self.put(message).is_some() {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Removes and returns the oldest message; `None` when closed and empty.
    pub async fn take(&self) -> Option<Message> {
        loop {
            let rings = self.bell.notified();
            if let Some(end) = self.try_take() {
                return end;
            }
            rings.await;
        }
    }

    /// Removes and returns the oldest message if there is one (`Some(None)`: closed and empty).
    pub fn try_take(&self) -> Option<Option<Message>> {
        let mut state = lock(&self.state);
        match state.messages.pop_front() {
            Some(message) => {
                self.room.notify_one();
                Some(Some(message))
            }
            None if state.closed => Some(None),
            None => None,
        }
    }

    /// Accepts no more messages; wakes all waiters.
    pub fn close(&self) {
        lock(&self.state).closed = true;
        self.bell.notify_one();
        self.room.notify_waiters();
    }

    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }
}
