//! The two threads of one robot: one communicates with its boards, the other can stop them even if the first
//! one fails.
//!
//! ```text
//! yarp ROBOT        per board: its connection, its states, the hand that executes orders
//! yarp stop ROBOT   per board: its brake; the watch over the lease
//! ```
//! In virtual time both are tasks of the run's own thread instead.
//!
//! Every task of both threads is watched. If one ends, the remaining ones stop the boards at once, no driver
//! can use them, and all tasks of its thread start again, with a stop. If a whole thread ends, the other one
//! stops the boards, and the next connection of a driver starts both again.

use super::YarpDriverSettings;
use super::brake::Brake;
use super::cell::{SharedBoards, Trouble, holds};
use super::crew::Crew;
use super::driver::Reach;
use super::fan::Fan;
use super::hand::put_back::ENDING;
use super::hand::{Halt, Hand, Order};
use super::layout::{Layout, Patch};
use super::remote::Wire;
use super::states::states;
use mobee_yarp::Carrier;
use mobee_yarp::board::RemoteOptions;
use std::io;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{Mutex, mpsc, watch};
use tokio::time::Instant;

/// Number of orders that may wait for one board.
const WAITING: usize = 64;
/// Pause before tasks are started again.
const RESTART_PAUSE: Duration = Duration::from_millis(200);

/// Location of the two threads.
#[derive(Clone, Copy, Debug)]
pub enum ThreadPlacement {
    /// On threads of their own.
    Threads,
    /// On the present runtime, whose clock may be virtual.
    Here,
}

/// The threads while they run.
pub struct Threads {
    end: watch::Sender<bool>,
    threads: Vec<Thread>,
}

/// One of the two threads.
enum Thread {
    Own(std::thread::JoinHandle<()>),
    Here(tokio::task::JoinHandle<()>),
}

impl Thread {
    fn begin(
        place: ThreadPlacement,
        name: String,
        work: impl Future<Output = ()> + Send + 'static,
    ) -> io::Result<Thread> {
        let ThreadPlacement::Threads = place else { return Ok(Thread::Here(tokio::spawn(work))) };
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        Ok(Thread::Own(std::thread::Builder::new().name(name).spawn(move || runtime.block_on(work))?))
    }
}

impl Threads {
    /// True if one of the threads has ended without a request.
    pub fn is_broken(&self) -> bool {
        self.threads.iter().any(|thread| match thread {
            Thread::Own(thread) => thread.is_finished(),
            Thread::Here(task) => task.is_finished(),
        })
    }

    /// Lets the remaining thread stop the boards and end, without waiting for it.
    pub fn leave(self) {
        self.end.send_replace(true);
    }

    /// Stops the boards and ends the threads. Tasks on the present runtime are only notified, and end with
    /// it.
    pub fn end(self) {
        self.end.send_replace(true);
        for thread in self.threads {
            if let Thread::Own(thread) = thread
                && thread.join().is_err()
            {
                tracing::error!("a thread of a robot's network had panicked");
            }
        }
    }
}

/// State of both threads.
#[derive(Clone)]
struct SharedThreads {
    wire: Arc<dyn Wire>,
    settings: YarpDriverSettings,
    /// Prefix of our own port names.
    name: String,
    reach: Reach,
    queues: Vec<Arc<Mutex<mpsc::Receiver<Order>>>>,
    end: watch::Receiver<bool>,
}

/// Starts the threads of one robot.
///
/// # Errors
/// The system can't create a thread or its runtime.
pub fn start(
    (wire, place): (Arc<dyn Wire>, ThreadPlacement),
    settings: &YarpDriverSettings,
    robot: &str,
    layout: Arc<Layout>,
    cell: Arc<SharedBoards>,
) -> io::Result<super::Started> {
    let (orders, queues): (Vec<_>, Vec<_>) = layout.patches.iter().map(|_| mpsc::channel(WAITING)).unzip();
    let halt = Fan::new(Arc::new(Halt::default()));
    let lease = watch::Sender::new(None);
    let reach = Reach { layout: layout.clone(), cell, orders, halt, lease };
    let name = settings.name.clone().unwrap_or_else(|| format!("/MoBeE/{robot}/driver"));
    let question = |p: &Patch| wire.questions(p, &format!("{name}/{}", p.part), settings.timeout());
    let questions = layout.patches.iter().filter_map(question).collect();
    let (end, ended) = watch::channel(false);
    let queues = queues.into_iter().map(|q| Arc::new(Mutex::new(q))).collect();
    let shared = SharedThreads { wire, settings: settings.clone(), name, reach: reach.clone(), queues, end: ended };
    let mut running = Threads { end, threads: Vec::new() };
    let brakes: (Side, Muster) = (Side::Brakes, SharedThreads::brakes);
    for (name, crew) in
        [(format!("yarp stop {robot}"), brakes), (format!("yarp {robot}"), (Side::Boards, SharedThreads::boards))]
    {
        let work = shared.clone().watch(name.clone(), crew);
        #[cfg(test)]
        let work = super::crew::poison::may_befall(format!("thread {name}"), work);
        running.threads.push(Thread::begin(place, name, work)?);
    }
    Ok(super::Started { reach, questions, thread: running })
}

/// One of the two paths to the boards.
#[derive(Clone, Copy, PartialEq)]
enum Side {
    Boards,
    Brakes,
}

/// Function that creates the tasks of a thread.
type Muster = fn(&SharedThreads, &watch::Receiver<bool>) -> Crew;

impl SharedThreads {
    /// Keeps the tasks of a thread alive until the end.
    async fn watch(self, thread: String, (side, muster): (Side, Muster)) {
        let _guard = Guard { reach: self.reach.clone(), thread, end: self.end.clone() };
        let mut end = self.end.clone();
        while !*self.end.borrow() {
            let mut crew = muster(&self, &self.end);
            let lost = tokio::select! {
                biased;
                () = at_end(&mut end) => None,
                // a task that sees the end first has not died, and the others are not done yet
                why = crew.lost() => Some(why).filter(|_| !*self.end.borrow()),
            };
            let Some(why) = lost else {
                // does not wait forever for a board that does not answer
                let _ = tokio::time::timeout(ENDING + 3 * self.settings.timeout(), crew.ended()).await;
                return;
            };
            self.reach.died(&why, side);
            drop(crew);
            tokio::time::sleep(RESTART_PAUSE).await;
        }
    }

    fn patches(&self) -> impl Iterator<Item = (usize, &Patch)> {
        self.reach.layout.patches.iter().enumerate()
    }

    /// Creates connections, readers and hands.
    fn boards(&self, end: &watch::Receiver<bool>) -> Crew {
        let mut crew = Crew::default();
        let cell = &self.reach.cell;
        let layout = &self.reach.layout;
        for ((index, patch), queue) in self.patches().zip(&self.queues) {
            let options = RemoteOptions {
                local: format!("{}/{}", self.name, patch.part),
                carrier: self.settings.carrier.parse().unwrap_or(Carrier::FastTcp),
                timeout: self.settings.timeout(),
                stale: self.settings.stale(),
            };
            let Some(board) = self.wire.board(patch, options) else { continue };
            let hand = Hand::new(
                (cell.clone(), layout.clone()),
                index,
                board.clone(),
                (self.reach.halt.subscribe(), self.reach.lease.subscribe()),
                queue.clone(),
                self.settings.latency().as_secs_f64(),
            );
            let states = states(cell.clone(), layout.clone(), index, board.clone(), self.settings.clone());
            // states are read, and the connection lasts, until the hand has restored the board
            let (restored, until_restored) = watch::channel(false);
            let restored = Arc::new(restored);
            let hand_end = end.clone();
            let ending = end.clone();
            let restored_by_hand = restored.clone();
            crew.add(format!("hand at {}", patch.port), async move {
                hand.work(hand_end).await;
                restored_by_hand.send_replace(true);
            });
            crew.add(format!("reader of {}", patch.port), until(until_restored.clone(), states));
            crew.add(format!("connection to {}", patch.port), async move {
                until(until_restored, board.died()).await;
                if *ending.borrow() {
                    board.close().await;
                }
                drop(restored);
            });
        }
        crew
    }

    /// Creates the brakes and the lease watch.
    fn brakes(&self, end: &watch::Receiver<bool>) -> Crew {
        let mut crew = Crew::default();
        for (index, patch) in self.patches() {
            let own = format!("{}/{}/stop:o", self.name, patch.part);
            let Some(line) = self.wire.stop_line(patch, &own, self.settings.timeout()) else { continue };
            let brake = Brake {
                cell: self.reach.cell.clone(),
                index,
                port: patch.port.clone(),
                line,
                halt: self.reach.halt.subscribe(),
                latency: self.settings.latency().as_secs_f64(),
            };
            crew.add(format!("brake of {}", patch.port), brake.work(end.clone()));
        }
        let lease = watch_lease(self.reach.clone(), self.reach.lease.subscribe());
        crew.add(format!("watch over the lease of {}", self.name), until(end.clone(), lease));
        crew
    }
}

/// Ready at the end.
async fn at_end(end: &mut watch::Receiver<bool>) {
    // an error means that the sender is gone
    let _ = end.wait_for(|end| *end).await;
}

/// Runs `work` until the end.
async fn until(mut end: watch::Receiver<bool>, work: impl Future<Output = ()>) {
    tokio::select! {
        biased;
        () = at_end(&mut end) => {}
        () = work => {}
    }
}

/// Reports a thread that ends without a request.
struct Guard {
    reach: Reach,
    thread: String,
    end: watch::Receiver<bool>,
}

impl Drop for Guard {
    fn drop(&mut self) {
        if !*self.end.borrow() {
            let who = format!("thread `{}` ended", self.thread);
            self.reach.died(&who, Side::Boards);
            self.reach.died(&who, Side::Brakes);
        }
    }
}

impl Reach {
    /// Handles the death of a task that can stop the robot. The remaining ones stop the robot, and no driver
    /// uses it until all tasks run again, which start with a stop.
    fn died(&self, who: &str, side: Side) {
        tracing::error!("{who}: the robot is stopped, and its boards are connected to anew");
        let mut inner = self.cell.lock();
        for (known, patch) in inner.boards.iter_mut().zip(&self.layout.patches) {
            let why = format!("{}: {who}", patch.port);
            match side {
                Side::Brakes => known.brake = Some(why),
                Side::Boards if matches!(known.trouble, Some(Trouble::Forbidden(_))) => {}
                Side::Boards => known.trouble = Some(Trouble::Lost(why)),
            }
        }
        self.stop_all(&mut inner);
        drop(inner);
        self.cell.ring();
    }
}

/// Stops everything when the lease expires.
async fn watch_lease(reach: Reach, mut lease: watch::Receiver<Option<Instant>>) {
    // a watch that replaces a dead one can't rely on the state of its predecessor
    let mut leased = lease.borrow().is_some();
    loop {
        let newest = *lease.borrow_and_update();
        if let Some(until) = newest.filter(|_| holds(newest)) {
            leased = true;
            tokio::select! {
                biased;
                _ = lease.changed() => continue,
                () = tokio::time::sleep_until(until) => {}
            }
        }
        if std::mem::take(&mut leased) {
            // the lease has expired only if no newer one came just now
            if !holds(*reach.lease.borrow()) {
                reach.stop_all(&mut reach.cell.lock());
            }
            continue;
        }
        if lease.changed().await.is_err() {
            return;
        }
    }
}

#[cfg(test)]
mod tests;
