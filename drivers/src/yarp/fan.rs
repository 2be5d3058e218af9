//! Value broadcast to several receivers, in the order of their subscriptions. The receivers of one
//! `tokio::sync::watch` are woken in arbitrary order, which would make simulations irreproducible.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::watch;

/// Broadcasts the changes of a value. Clones share the value.
#[derive(Clone, Debug)]
pub struct Fan<T>(Arc<Mutex<Told<T>>>);

#[derive(Debug)]
struct Told<T> {
    newest: T,
    all: Vec<watch::Sender<T>>,
}

impl<T: Clone + PartialEq> Fan<T> {
    /// Creates the value, without receivers.
    pub fn new(newest: T) -> Fan<T> {
        Fan(Arc::new(Mutex::new(Told { newest, all: Vec::new() })))
    }

    /// Adds a receiver, which gets all changes until it is dropped.
    pub fn subscribe(&self) -> watch::Receiver<T> {
        let mut told = self.lock();
        told.all.retain(|sender| !sender.is_closed());
        let (sender, receiver) = watch::channel(told.newest.clone());
        told.all.push(sender);
        receiver
    }

    /// Newest value.
    pub fn newest(&self) -> T {
        self.lock().newest.clone()
    }

    /// Changes the value, and notifies all receivers if it differs.
    pub fn tell(&self, change: impl FnOnce(&T) -> T) {
        let mut told = self.lock();
        let newest = change(&told.newest);
        if newest != told.newest {
            told.newest = newest.clone();
            for sender in &told.all {
                sender.send_replace(newest.clone());
            }
        }
    }

    fn lock(&self) -> MutexGuard<'_, Told<T>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
