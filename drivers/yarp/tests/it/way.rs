//! The way to a simulated board: answers that come late, stops that have no effect, states that are old.

#![allow(clippy::disallowed_methods, reason = "real sockets live in real time")]

use mobee_driver_yarp::SimBoard;
use mobee_yarp::board::{Ask, Device, Reply, Set, reply};
use mobee_yarp::{Bottle, Dialect, JointData, Message, Stamp};
use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering::SeqCst};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::time::Instant;

/// What was told to the board, and when.
pub type Told = (Instant, Set);

/// A board behind a way that can be made worse.
pub struct Way {
    pub board: Arc<SimBoard>,
    /// How long an answer takes, ms.
    pub late: AtomicU64,
    /// So many stops are answered `[ok]` and have no effect.
    pub deaf: AtomicU64,
    /// How old a state is when it is sent, ms.
    pub old: AtomicU64,
    /// The orders as they came.
    pub told: Mutex<Vec<Told>>,
    states: Mutex<VecDeque<(Instant, (Stamp, JointData))>>,
}

impl Way {
    pub fn to(board: Arc<SimBoard>) -> Way {
        let none = || AtomicU64::new(0);
        Way { board, late: none(), deaf: none(), old: none(), told: Mutex::default(), states: Mutex::default() }
    }

    /// The orders since then.
    pub fn since(&self, then: Instant) -> Vec<Told> {
        self.told.lock().unwrap().iter().filter(|(at, _)| *at >= then).cloned().collect()
    }

    /// When the first stop since then came.
    pub fn stopped(&self, then: Instant) -> Option<Instant> {
        self.since(then).iter().find(|(_, set)| matches!(set, Set::Stop(_))).map(|(at, _)| *at)
    }
}

impl Device for Way {
    fn rpc(&self, request: Message) -> Reply {
        let asked = request.payload.bottle(Dialect::V3).unwrap_or_else(|_| Bottle::new());
        let stop = matches!(Ask::parse(&asked), Some(Ask::Set(Set::Stop(_))));
        if let Some(Ask::Set(set)) = Ask::parse(&asked) {
            self.told.lock().unwrap().push((Instant::now(), set));
        }
        let ignored = stop && self.deaf.fetch_update(SeqCst, SeqCst, |n| n.checked_sub(1)).is_ok();
        let answer =
            if ignored { Box::pin(std::future::ready((&reply::ok()).into())) } else { self.board.rpc(request) };
        let late = Duration::from_millis(self.late.load(SeqCst));
        Box::pin(async move {
            tokio::time::sleep(late).await;
            answer.await
        })
    }

    fn command(&self, from: &str, connection: u64, head: Bottle, body: Vec<f64>) {
        self.board.command(from, connection, head, body);
    }

    fn state(&self) -> Option<(Stamp, JointData)> {
        let now = Instant::now();
        let mut states = self.states.lock().unwrap();
        states.extend(self.board.state().map(|state| (now, state)));
        let old = Duration::from_millis(self.old.load(SeqCst));
        let mut newest = None;
        while states.front().is_some_and(|(at, _)| now.duration_since(*at) >= old) {
            newest = states.pop_front();
        }
        newest.map(|(_, state)| state)
    }
}
