//! The network thread of one robot: boards, hands, the watch over the lease.

use super::YarpDriverSettings;
use super::cell::{Cell, describe, instant};
use super::clock::Arrivals;
use super::driver::Reach;
use super::hand::{Halt, Hand};
use super::layout::{Layout, Patch};
use super::questions::Questions;
use mobee_yarp::board::{Link, RemoteBoard, RemoteOptions, RemoteState};
use mobee_yarp::{Carrier, Network, Vocab};
use std::io;
use std::sync::Arc;
use tokio::sync::{mpsc, oneshot, watch};
use tokio::task::JoinSet;
use tokio::time::Instant;

/// Orders that may wait for one board.
const WAITING: usize = 64;
/// The thread while it runs.
pub struct Running {
    end: oneshot::Sender<()>,
    thread: std::thread::JoinHandle<()>,
}

impl Running {
    /// Stops the boards and ends the thread.
    pub fn end(self) {
        drop(self.end);
        if self.thread.join().is_err() {
            tracing::error!("the thread of a robot's network had panicked");
        }
    }
}

/// Starts the thread of one robot.
///
/// # Errors
/// If the system gives no thread or no sockets.
pub fn start(
    network: &Network,
    settings: &YarpDriverSettings,
    robot: &str,
    layout: Arc<Layout>,
    cell: Arc<Cell>,
) -> io::Result<super::Started> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let halt = watch::Sender::new(Arc::new(Halt::default()));
    let lease = watch::Sender::new(None);
    let (orders, order_queues): (Vec<_>, Vec<_>) = layout.patches.iter().map(|_| mpsc::channel(WAITING)).unzip();
    let reach = Reach { layout: layout.clone(), cell: cell.clone(), orders, halt: halt.clone(), lease: lease.clone() };
    let (end, ended) = oneshot::channel::<()>();
    let name = settings.name.clone().unwrap_or_else(|| format!("/MoBeE/{robot}/driver"));
    let (network, settings) = (network.clone(), settings.clone());
    let passed = network.clone().with_timeout(settings.timeout());
    let question = |p: &Patch| Questions::new(&passed, &format!("{name}/{}", p.part), &p.port);
    let questions = layout.patches.iter().map(question).collect();
    let watched = reach.clone();
    let work = async move {
        let mut hands = JoinSet::new();
        let mut others = JoinSet::new();
        let (stopping, stopped) = watch::channel(false);
        for (index, queue) in order_queues.into_iter().enumerate() {
            let Some(patch) = layout.patches.get(index) else { continue };
            let options = RemoteOptions {
                local: format!("{name}/{}", patch.part),
                carrier: settings.carrier.parse().unwrap_or(Carrier::FastTcp),
                timeout: settings.timeout(),
                stale: settings.stale(),
            };
            let board = Arc::new(RemoteBoard::new(&network, &patch.port, options));
            others.spawn(states(cell.clone(), layout.clone(), index, board.clone(), settings.clone()));
            let hand = Hand::new(
                (cell.clone(), layout.clone()),
                index,
                board,
                halt.subscribe(),
                queue,
                settings.latency().as_secs_f64(),
            );
            hands.spawn(hand.work(stopped.clone()));
        }
        others.spawn(watch_lease(watched, lease.subscribe()));
        let _ = ended.await;
        let _ = stopping.send(true);
        // a board that does not answer is no reason to wait for ever
        let _ =
            tokio::time::timeout(3 * settings.timeout(), async { while hands.join_next().await.is_some() {} }).await;
    };
    let thread = std::thread::Builder::new().name(format!("yarp {robot}")).spawn(move || runtime.block_on(work))?;
    Ok(super::Started { reach, questions, thread: Running { end, thread } })
}

/// At the end of the lease everything stops.
async fn watch_lease(reach: Reach, mut lease: watch::Receiver<Option<Instant>>) {
    let mut leased = false;
    loop {
        let until = *lease.borrow_and_update();
        match until {
            Some(until) if until > instant() => {
                leased = true;
                tokio::select! {
                    () = tokio::time::sleep_until(until) => {}
                    _ = lease.changed() => continue,
                }
            }
            _ => {}
        }
        if leased {
            leased = false;
            // the time is up only if no newer lease came just now
            if !reach.lease.borrow().is_some_and(|until| until > instant()) {
                reach.stop_all(&mut reach.cell.lock());
            }
            continue;
        }
        if lease.changed().await.is_err() {
            return;
        }
    }
}

/// Takes the states of one board as they come.
async fn states(
    cell: Arc<Cell>,
    layout: Arc<Layout>,
    index: usize,
    board: Arc<RemoteBoard>,
    settings: YarpDriverSettings,
) {
    let (mut state, mut link, mut facts) = (board.state(), board.link(), board.facts());
    let mut arrivals = Arrivals::default();
    loop {
        tokio::select! {
            biased;
            _ = link.changed() => {
                if let Link::Up(_) = *link.borrow_and_update() {
                    arrivals.reset();
                }
            }
            _ = facts.changed() => {
                let facts = facts.borrow_and_update().clone();
                if let Some(known) = cell.lock().boards.get_mut(index) {
                    known.facts = facts;
                }
                cell.describe(&layout, &settings);
            }
            _ = state.changed() => {
                let Some(newest) = state.borrow_and_update().clone() else { continue };
                let at = arrivals.read_at(cell.secs(newest.arrived), newest.stamp.map(|s| s.time));
                take(&cell, &layout, index, &newest, at, board.lost());
            }
        }
    }
}

fn take(cell: &Cell, layout: &Layout, index: usize, state: &RemoteState, at: f64, lost: u64) {
    let mut inner = cell.lock();
    let Some(known) = inner.boards.get_mut(index) else { return };
    known.q.iter_mut().zip(&state.joints.position.values).for_each(|(slot, q)| *slot = *q);
    let words = |slots: &mut Vec<Vocab>, field: &mobee_yarp::Field<i32>| {
        for (slot, word) in slots.iter_mut().zip(field.valid().unwrap_or_default()) {
            *slot = Vocab(u32::from_le_bytes(word.to_le_bytes()));
        }
    };
    words(&mut known.modes, &state.joints.control_modes);
    words(&mut known.interactions, &state.joints.interaction_modes);
    known.lost.0 = lost;
    known.read_at = at;
    known.fresh = true;
    let q = std::mem::take(&mut known.q);
    known.motions.read(at, &q);
    known.q = q;
    let first = inner.joined.is_none();
    inner.join(layout);
    let ready = first && inner.joined.is_some();
    drop(inner);
    if ready {
        cell.ring();
    }
}

impl Cell {
    /// Describes the robot's board, once the facts of all its boards are known.
    fn describe(&self, layout: &Layout, settings: &YarpDriverSettings) {
        use super::cell::Trouble;
        let mut inner = self.lock();
        if inner.board.is_some() {
            return;
        }
        match describe(layout, &inner.boards, settings) {
            Ok(board) => inner.board = board,
            Err(why) => inner.misfit = Some(Trouble::Forbidden(why)),
        }
        drop(inner);
        self.ring();
    }
}
