//! A value that several are told of, in the order in which they asked for it. Those who wait for one `tokio::sync::watch` are woken in
//! any order, and no two simulations would be alike.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::watch;

/// Tells several of a value as it changes. Clones are the same.
#[derive(Clone, Debug)]
pub struct Fan<T>(Arc<Mutex<Told<T>>>);

#[derive(Debug)]
struct Told<T> {
    newest: T,
    all: Vec<watch::Sender<T>>,
}

impl<T: Clone + PartialEq> Fan<T> {
    /// Nobody is told yet.
    pub fn new(newest: T) -> Fan<T> {
        Fan(Arc::new(Mutex::new(Told { newest, all: Vec::new() })))
    }

    /// One more is told from now on, until it is dropped.
    pub fn subscribe(&self) -> watch::Receiver<T> {
        let mut told = self.lock();
        told.all.retain(|sender| !sender.is_closed());
        let (sender, receiver) = watch::channel(told.newest.clone());
        told.all.push(sender);
        receiver
    }

    /// The newest value.
    pub fn newest(&self) -> T {
        self.lock().newest.clone()
    }

    /// Changes the value, and tells all of it if it is another.
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
