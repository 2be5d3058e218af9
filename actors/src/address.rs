//! Where to reach an actor that may be restarted: a shared, exchangeable reference.

use ractor::{ActorRef, Message};
use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

/// The present reference to an actor; all clones are one. The actor sets it when it starts.
pub struct Address<M: Message>(Arc<Mutex<Option<ActorRef<M>>>>);

impl<M: Message> Address<M> {
    /// Nobody lives there yet.
    pub fn new() -> Address<M> {
        Address(Arc::new(Mutex::new(None)))
    }

    /// Somebody moves in, after a start or a restart.
    pub fn set(&self, actor: ActorRef<M>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(actor);
    }

    /// Whoever lives there now.
    pub fn get(&self) -> Option<ActorRef<M>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Sends a message; `false` if nobody is there to take it.
    pub fn send(&self, message: M) -> bool {
        let guard = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        guard.as_ref().is_some_and(|actor| actor.cast(message).is_ok())
    }
}

impl<M: Message> Default for Address<M> {
    fn default() -> Address<M> {
        Address::new()
    }
}

impl<M: Message> Clone for Address<M> {
    fn clone(&self) -> Address<M> {
        Address(self.0.clone())
    }
}

impl<M: Message> fmt::Debug for Address<M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.get().is_some() { "Address(taken)" } else { "Address(empty)" })
    }
}
