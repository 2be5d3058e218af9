//! Client of a simulated board, the counterpart of [`mobee_yarp::board::RemoteBoard`].

use super::super::fan::Fan;
use super::super::remote::{Later, Remote, StopLine};
use super::far::{Far, KeptConnection};
use super::faults::Who;
use super::judge::JudgedConnection;
use mobee_yarp::board::{Ask, AxisFacts, Get, LinkState, RemoteState, Streamed};
use mobee_yarp::{Bottle, CallError, JointData, Stamp};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::SeqCst};
use std::time::Duration;
use tokio::sync::{Mutex, Notify, mpsc, watch};
use tokio::task::JoinSet;
use tokio::time::{Instant, interval, sleep, sleep_until};

/// Number of streamed commands that may wait to be sent.
const WAITING: usize = 32;
/// Shortest and longest pause between two attempts to reach a board.
const BACK_OFF: (Duration, Duration) = (Duration::from_millis(50), Duration::from_secs(2));
/// Largest gap between two counts that counts as lost states.
const GREATEST_GAP: u32 = 100_000;

/// Client of one simulated board.
pub(super) struct SimClient {
    shared: Arc<SharedClient>,
    tasks: Mutex<JoinSet<()>>,
    commands: mpsc::Sender<(u64, Streamed)>,
}

struct SharedClient {
    far: Arc<Far>,
    patience: Duration,
    control: Mutex<KeptConnection>,
    link: Fan<LinkState>,
    facts: watch::Sender<Option<Arc<[AxisFacts]>>>,
    state: watch::Sender<Option<Arc<RemoteState>>>,
    trouble: Notify,
    lost: AtomicU64,
    age: AtomicU64,
}

impl SimClient {
    /// Creates a client, which starts to connect.
    pub fn new(far: Arc<Far>, patience: Duration) -> SimClient {
        let shared = Arc::new(SharedClient {
            far,
            patience,
            control: Mutex::new(KeptConnection::new()),
            link: Fan::new(LinkState::Down("not connected yet".into())),
            facts: watch::Sender::new(None),
            state: watch::Sender::new(None),
            trouble: Notify::new(),
            lost: AtomicU64::new(0),
            age: AtomicU64::new(0),
        });
        let (commands, queue) = mpsc::channel(WAITING);
        let mut tasks = JoinSet::new();
        tasks.spawn(session(shared.clone()));
        tasks.spawn(send_all(shared.clone(), queue));
        SimClient { shared, tasks: Mutex::new(tasks), commands }
    }
}

impl Remote for SimClient {
    fn port(&self) -> &str {
        &self.shared.far.port
    }

    fn link(&self) -> watch::Receiver<LinkState> {
        self.shared.link.subscribe()
    }

    fn facts(&self) -> watch::Receiver<Option<Arc<[AxisFacts]>>> {
        self.shared.facts.subscribe()
    }

    fn state(&self) -> watch::Receiver<Option<Arc<RemoteState>>> {
        self.shared.state.subscribe()
    }

    fn lost(&self) -> u64 {
        self.shared.far.may_kill(Who::Reader);
        self.shared.lost.load(SeqCst)
    }

    fn ask<'a>(&'a self, request: &'a Ask) -> Later<'a, Result<Bottle, CallError>> {
        self.shared.far.may_kill(Who::Hand);
        Box::pin(self.shared.ask(request))
    }

    fn stream(&self, command: Streamed) -> bool {
        self.commands.try_send((self.shared.age.load(SeqCst), command)).is_ok()
    }

    fn hush(&self) {
        self.shared.age.fetch_add(1, SeqCst);
    }

    fn died(&self) -> Later<'_, ()> {
        Box::pin(async move {
            let _ = self.tasks.lock().await.join_next().await;
        })
    }

    fn close(&self) -> Later<'_, ()> {
        Box::pin(std::future::ready(()))
    }
}

impl SharedClient {
    async fn ask(&self, request: &Ask) -> Result<Bottle, CallError> {
        let answer = self.control.lock().await.send(&self.far, JudgedConnection::Orders, request, self.patience).await;
        if answer.is_err() {
            self.trouble.notify_one();
        }
        answer
    }

    /// Waits until the connection may be tried, and sends the queries that a new connection starts with.
    async fn reach(&self) -> Result<(), String> {
        let until = self.control.lock().await.until();
        sleep(until.since(self.far.now())).await;
        let probe = Ask::Get(Get::Axes);
        let mut control = self.control.lock().await;
        let answer = control.send(&self.far, JudgedConnection::Orders, &probe, self.patience).await;
        answer.map_err(|e| e.to_string())?;
        self.facts.send_if_modified(|facts| {
            let is_new = facts.is_none();
            facts.get_or_insert_with(|| self.far.facts());
            is_new
        });
        Ok(())
    }

    /// Receives states until the connection is lost, and returns the reason.
    async fn watch(&self) -> String {
        let mut ticks = interval(self.far.board.publishes());
        let mut flying: BTreeMap<(Instant, u64), (Stamp, JointData)> = BTreeMap::new();
        let mut sent = 0;
        let mut count = Counting::default();
        loop {
            let next = flying.keys().next().map(|(at, _)| *at);
            tokio::select! {
                biased;
                () = self.trouble.notified() => return "a request got no answer".into(),
                () = until(next) => {
                    if let Some((_, (stamp, joints))) = flying.pop_first() {
                        self.arrived(&mut count, stamp, joints);
                    }
                }
                now = ticks.tick() => {
                    if self.far.is_cut() {
                        return "the wire was cut".into();
                    }
                    let Some((ways, stamp, joints)) = self.far.state() else { continue };
                    for way in ways {
                        sent += 1;
                        flying.insert((now + way, sent), (stamp, joints.clone()));
                    }
                }
            }
        }
    }

    fn arrived(&self, count: &mut Counting, stamp: Stamp, joints: JointData) {
        let (seq, lost) = count.next(stamp);
        self.lost.fetch_add(lost, SeqCst);
        let arrived = super::super::cell::instant();
        self.state.send_replace(Some(Arc::new(RemoteState { seq, stamp: Some(stamp), arrived, joints })));
    }
}

/// Numbers states by their stamps.
#[derive(Default)]
struct Counting {
    last: Option<Stamp>,
    seq: u64,
}

impl Counting {
    /// Number of a state, and the number of states lost before it.
    fn next(&mut self, stamp: Stamp) -> (u64, u64) {
        let gap = self.last.map_or(0, |before| stamp.count.wrapping_sub(before.count).wrapping_sub(1));
        let lost = if gap < GREATEST_GAP { u64::from(gap) } else { 0 };
        (self.last, self.seq) = (Some(stamp), self.seq + 1 + lost);
        (self.seq, lost)
    }
}

async fn until(at: Option<Instant>) {
    match at {
        Some(at) => sleep_until(at).await,
        None => std::future::pending().await,
    }
}

/// Reaches the board, watches it, and starts again when it is lost. Ends only if this task is to die.
async fn session(shared: Arc<SharedClient>) {
    let mut pause = BACK_OFF.0;
    let mut generation = 0;
    loop {
        let why = match shared.reach().await {
            Ok(()) => {
                (pause, generation) = (BACK_OFF.0, generation + 1);
                super::far::lock(&shared.far.judge).linked(shared.far.index);
                shared.link.update(|_| LinkState::Up(generation));
                let dies = async {
                    while !shared.far.dies(Who::Connection) {
                        sleep(shared.far.board.publishes()).await;
                    }
                };
                tokio::select! {
                    biased;
                    () = dies => return,
                    why = shared.watch() => why,
                }
            }
            Err(why) => why,
        };
        shared.link.update(|_| LinkState::Down(why));
        sleep(pause).await;
        pause = (pause * 2).min(BACK_OFF.1);
        // trouble notified while disconnected does not concern the next connection
        let _ = tokio::time::timeout(Duration::ZERO, shared.trouble.notified()).await;
    }
}

async fn send_all(shared: Arc<SharedClient>, mut queue: mpsc::Receiver<(u64, Streamed)>) {
    while let Some((age, command)) = queue.recv().await {
        if age == shared.age.load(SeqCst) {
            shared.far.stream(&command).await;
        }
    }
}

/// Stop connection of one simulated board.
pub(super) struct Stops {
    pub far: Arc<Far>,
    pub connection: KeptConnection,
    pub patience: Duration,
}

impl StopLine for Stops {
    fn send<'a>(&'a mut self, request: &'a Ask) -> Later<'a, Result<Bottle, CallError>> {
        self.far.may_kill(Who::Brake);
        Box::pin(self.connection.send(&self.far, JudgedConnection::Stops, request, self.patience))
    }
}
