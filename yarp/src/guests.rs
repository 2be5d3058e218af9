//! Connections of a listening socket: limited in number, and silent ones can't lock out others.

use crate::clock;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::task::{AbortHandle, JoinSet};
use tokio::time::Instant;

/// Time since the last message within which a connection is not replaced.
const KEEP_ALIVE: Duration = Duration::from_secs(1);

/// Time of the last message of a connection, and whether it has sent anything but its name.
#[derive(Debug)]
pub(crate) struct LastMessage(Mutex<(bool, Instant)>);

impl LastMessage {
    fn new() -> LastMessage {
        LastMessage(Mutex::new((false, clock::now())))
    }

    /// Records a message.
    pub fn now(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = (true, clock::now());
    }

    fn last(&self) -> (bool, Instant) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Connections of a socket, each a task.
pub(crate) struct Guests {
    most: usize,
    tasks: JoinSet<()>,
    guests: Vec<(AbortHandle, Arc<LastMessage>)>,
}

impl Guests {
    /// Creates the set with room for `most` connections.
    pub fn new(most: usize) -> Guests {
        Guests { most, tasks: JoinSet::new(), guests: Vec::new() }
    }

    /// Serves a new connection. If there is no room, it replaces the one that has been silent for longest,
    /// preferring those that never sent anything. Returns false, and does not serve it, if all others were
    /// active just now.
    pub fn admit<F>(&mut self, serve: impl FnOnce(Arc<LastMessage>) -> F) -> bool
    where
        F: Future<Output = ()> + Send + 'static,
    {
        self.guests.retain(|(task, _)| !task.is_finished());
        if self.guests.len() >= self.most && !self.make_room() {
            return false;
        }
        let activity = Arc::new(LastMessage::new());
        self.guests.push((self.tasks.spawn(serve(activity.clone())), activity));
        true
    }

    fn make_room(&mut self) -> bool {
        let silent = |(_, activity): &&(AbortHandle, Arc<LastMessage>)| activity.last().1.elapsed() > KEEP_ALIVE;
        let all = self.guests.iter().enumerate().filter(|(_, guest)| silent(guest));
        let Some(at) = all.min_by_key(|(_, (_, activity))| activity.last()).map(|(at, _)| at) else { return false };
        self.guests.swap_remove(at).0.abort();
        true
    }

    /// Waits until a connection has ended; `None` if there is none.
    pub async fn ended(&mut self) -> Option<()> {
        self.tasks.join_next().await.map(drop)
    }

    /// Ends all connections.
    pub async fn shutdown(&mut self) {
        self.tasks.shutdown().await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::future::pending;

    #[tokio::test(start_paused = true)]
    async fn silent_connections_are_replaced_and_active_ones_stay() {
        let mut guests = Guests::new(3);
        let mut activity = Vec::new();
        let admit = |guests: &mut Guests, activity: &mut Vec<Arc<LastMessage>>| {
            guests.admit(|one| {
                activity.push(one);
                pending()
            })
        };
        for _ in 0..3 {
            assert!(admit(&mut guests, &mut activity));
        }
        assert!(!admit(&mut guests, &mut activity), "all have come just now");
        activity.truncate(3);
        // the first sends one message, the second none, the third continues to send
        activity[0].now();
        tokio::time::advance(2 * KEEP_ALIVE).await;
        activity[2].now();
        let alive =
            |guests: &Guests, one: &Arc<LastMessage>| guests.guests.iter().any(|(_, known)| Arc::ptr_eq(known, one));
        assert!(admit(&mut guests, &mut activity));
        assert!(
            [0, 2, 3].iter().all(|i| alive(&guests, &activity[*i])) && !alive(&guests, &activity[1]),
            "never spoke"
        );
        assert!(admit(&mut guests, &mut activity));
        assert!(
            [2, 3, 4].iter().all(|i| alive(&guests, &activity[*i])) && !alive(&guests, &activity[0]),
            "silent for longest"
        );
        assert!(!guests.admit(|_| pending()));
        // a place that is free again requires no replacement
        guests.guests[0].0.abort();
        assert_eq!(guests.ended().await, Some(()));
        assert_eq!(guests.ended().await, Some(()));
        assert_eq!(guests.ended().await, Some(()));
        assert!(admit(&mut guests, &mut activity));
    }
}
