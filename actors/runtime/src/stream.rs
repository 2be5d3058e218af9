//! A bounded stream into an actor, because ractor's mailboxes are unbounded.
//!
//! ```text
//! producer ──push──> [ bounded queue ] ──pop──> receiver's handler
//!      └──── doorbell: one message, only if none is on its way ────┘
//! ```
//!
//! A full queue drops its oldest item and counts it; a capacity of one is a latest-value cell. The queue
//! belongs to neither end and survives both. A restarted receiver attaches its new doorbell; items that were
//! queued for its predecessor are dropped and counted. Nothing is lost silently: sent = handled + queued +
//! dropped (I6).

use mobee_contract::Event;
use std::collections::VecDeque;
use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Notifies the receiver that an item is queued; `false` if there is no receiver (any more).
pub type Doorbell = Box<dyn Fn() -> bool + Send + Sync>;

/// Counters of a stream: `sent = handled + queued + dropped`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StreamCounters {
    /// Items that were pushed.
    pub sent: u64,
    /// Items that were popped.
    pub handled: u64,
    /// Items that are queued.
    pub queued: u64,
    /// Items that were displaced by newer ones, lost with a receiver, or discarded by it.
    pub dropped: u64,
}

/// A bounded queue with a doorbell. Clones share it.
pub struct Stream<T>(Arc<StreamQueue<T>>);

struct StreamQueue<T> {
    name: String,
    capacity: usize,
    ring: Mutex<Ring<T>>,
}

struct Ring<T> {
    queue: VecDeque<T>,
    doorbell: Option<Doorbell>,
    /// True if a doorbell message is on its way: the credit of one.
    rung: bool,
    /// Number of next items that are lost: a fault of a simulation.
    losing: u64,
    sent: u64,
    handled: u64,
    dropped: u64,
    /// Longest queue so far.
    most: u64,
}

impl<T> Ring<T> {
    fn ring(&mut self) {
        if !self.rung && !self.queue.is_empty() {
            self.rung = self.doorbell.as_ref().is_some_and(|bell| bell());
        }
    }
}

impl<T> Stream<T> {
    /// Creates an empty stream that holds up to `capacity` items (at least one).
    pub fn new(name: impl Into<String>, capacity: usize) -> Stream<T> {
        let capacity = capacity.max(1);
        let ring = Ring {
            queue: VecDeque::with_capacity(capacity.min(64)),
            doorbell: None,
            rung: false,
            losing: 0,
            sent: 0,
            handled: 0,
            dropped: 0,
            most: 0,
        };
        Stream(Arc::new(StreamQueue { name: name.into(), capacity, ring: Mutex::new(ring) }))
    }

    /// Loses the next items, and counts them as dropped: a fault of a simulation.
    pub fn lose(&self, count: u64) {
        self.lock().losing = count;
    }

    fn lock(&self) -> MutexGuard<'_, Ring<T>> {
        self.0.ring.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Connects a receiver when it starts. Items that were queued for an earlier receiver are dropped and
    /// counted.
    ///
    /// The doorbell must only send a message: it is called with the stream locked.
    pub fn attach(&self, doorbell: Doorbell) {
        let mut ring = self.lock();
        if ring.doorbell.is_some() {
            ring.dropped += ring.queue.len() as u64;
            ring.queue.clear();
        }
        ring.doorbell = Some(doorbell);
        ring.rung = false;
        ring.ring();
    }

    /// Adds an item, pushing out the oldest if full, and rings if no doorbell message is on its way.
    pub fn push(&self, item: T) {
        let mut ring = self.lock();
        ring.sent += 1;
        if ring.losing > 0 {
            ring.losing -= 1;
            ring.dropped += 1;
            return;
        }
        if ring.queue.len() >= self.0.capacity {
            ring.queue.pop_front();
            ring.dropped += 1;
        }
        ring.queue.push_back(item);
        ring.most = ring.most.max(ring.queue.len() as u64);
        ring.ring();
    }

    /// Takes the oldest item. `None` returns the credit: the next push rings again. A receiver therefore pops
    /// until `None`.
    pub fn pop(&self) -> Option<T> {
        let mut ring = self.lock();
        let item = ring.queue.pop_front();
        match item {
            Some(_) => ring.handled += 1,
            None => ring.rung = false,
        }
        item
    }

    /// Counts the item that was taken last as dropped instead of handled.
    pub fn discard(&self) {
        let mut ring = self.lock();
        if let Some(handled) = ring.handled.checked_sub(1) {
            (ring.handled, ring.dropped) = (handled, ring.dropped + 1);
        }
    }

    /// Takes all items, oldest first, and returns the credit.
    pub fn drain(&self) -> Vec<T> {
        let mut ring = self.lock();
        ring.rung = false;
        ring.handled += ring.queue.len() as u64;
        ring.queue.drain(..).collect()
    }

    /// Counters so far.
    pub fn counters(&self) -> StreamCounters {
        let ring = self.lock();
        StreamCounters {
            sent: ring.sent,
            handled: ring.handled,
            queued: ring.queue.len() as u64,
            dropped: ring.dropped,
        }
    }

    /// Name of the stream.
    pub fn name(&self) -> String {
        self.0.name.clone()
    }

    /// Returns the counters as the event that a run ends with.
    pub fn link(&self) -> Event {
        let StreamCounters { sent, handled, queued, dropped } = self.counters();
        let most = self.lock().most;
        let capacity = self.0.capacity as u64;
        Event::Link { link: self.0.name.clone(), sent, handled, queued, dropped, most, capacity }
    }
}

impl<T> Clone for Stream<T> {
    fn clone(&self) -> Stream<T> {
        Stream(self.0.clone())
    }
}

impl<T> fmt::Debug for Stream<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Stream({}, {:?})", self.0.name, self.counters())
    }
}
