//! Value broadcast to several receivers, in the order of their subscriptions. The receivers of one
//! `tokio::sync::watch` are woken in arbitrary order, which would make simulations irreproducible.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::watch;

/// Broadcasts the changes of a value. Clones share the value.
#[derive(Clone, Debug)]
pub struct Fan<T>(Arc<Mutex<Broadcast<T>>>);

#[derive(Debug)]
struct Broadcast<T> {
    newest: T,
    all: Vec<watch::Sender<T>>,
}

impl<T: Clone + PartialEq> Fan<T> {
    /// Creates the value, without receivers.
    pub fn new(newest: T) -> Fan<T> {
        Fan(Arc::new(Mutex::new(Broadcast { newest, all: Vec::new() })))
    }

    /// Adds a receiver, which gets all changes until it is dropped.
    pub fn subscribe(&self) -> watch::Receiver<T> {
        let mut state = self.lock();
        state.all.retain(|sender| !sender.is_closed());
        let (sender, receiver) = watch::channel(state.newest.clone());
        state.all.push(sender);
        receiver
    }

    /// Newest value.
    pub fn newest(&self) -> T {
        self.lock().newest.clone()
    }

    /// Changes the value, and notifies all receivers if it differs.
    pub fn update(&self, change: impl FnOnce(&T) -> T) {
        let mut state = self.lock();
        let newest = change(&state.newest);
        if newest != state.newest {
            state.newest = newest.clone();
            for sender in &state.all {
                sender.send_replace(newest.clone());
            }
        }
    }

    fn lock(&self) -> MutexGuard<'_, Broadcast<T>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
