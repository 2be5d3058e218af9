//! Client of a real board: its facts, its state, and its commands (spec sections 12, 13, 14 and 19).
//!
//! ```text
//! LOCAL/rpc:o     ──> PREFIX/rpc:i       our own orders and queries, one after the other
//! LOCAL/command:o ──> PREFIX/command:i   streamed setpoints
//! LOCAL/state:i   <── PREFIX/stateExt:o  or state:o where there is none
//! ```

mod facts;
mod session;
mod stream;

pub use facts::AxisFacts;

use super::{Ask, Streamed, reply};
use crate::{Bottle, CallError, Carrier, JointData, Network, PortError, RpcClient, Sender, Stamp, payload::pair};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;
use tokio::sync::{Mutex, Notify, mpsc, watch};
use tokio::task::JoinSet;
use tokio::time::Instant;

/// Number of streamed commands that may wait to be sent; more are refused.
const WAITING: usize = 32;

/// Options of the connections to a board.
#[derive(Clone, Debug, PartialEq)]
pub struct RemoteOptions {
    /// Prefix of our own port names, such as `/MoBeE/icub/driver/torso`.
    pub local: String,
    /// Carrier of states and streamed commands.
    pub carrier: Carrier,
    /// Time limit of an answer.
    pub timeout: Duration,
    /// Age at which a state is stale, and the stream is requested again.
    pub stale: Duration,
}

/// State of the connection.
#[derive(Clone, Debug, PartialEq)]
pub enum LinkState {
    /// No connection, with the reason. It is retried without end, with pauses that grow up to 2 s.
    Down(String),
    /// Connected, for the `n`-th time. Commands sent before this connection are void.
    Up(u64),
    /// Another program holds our port names, so that two would write to one robot. Nothing is written until
    /// it has gone.
    Taken(String),
}

/// A state as received.
#[derive(Clone, Debug)]
pub struct RemoteState {
    /// Number of states that the board published, as far as their stamps show: a gap means lost ones.
    pub seq: u64,
    /// Stamp of the board.
    pub stamp: Option<Stamp>,
    /// Arrival time.
    pub arrived: Instant,
    /// Content; only positions if it was received from `state:o`.
    pub joints: JointData,
}

/// Client of one real board. It connects and reconnects in the background until it is dropped.
pub struct RemoteBoard {
    shared: Arc<SharedRemote>,
    tasks: Mutex<JoinSet<()>>,
    commands: mpsc::Sender<(u64, Streamed)>,
}

/// State shared by the tasks of one board.
struct SharedRemote {
    network: Network,
    port: String,
    options: RemoteOptions,
    control: Mutex<RpcClient>,
    link: watch::Sender<LinkState>,
    facts: watch::Sender<Option<Arc<[AxisFacts]>>>,
    state: watch::Sender<Option<Arc<RemoteState>>>,
    /// Notified after an error that the session has to handle.
    trouble: Notify,
    lost: AtomicU64,
    unsent: AtomicU64,
    /// True if the client has to end in order.
    leave: watch::Sender<bool>,
    /// Age of the stream; commands of an earlier age are discarded.
    age: AtomicU64,
}

impl RemoteBoard {
    /// Creates the client of the board whose ports begin with `port`, such as `/icub/torso`. Must be called
    /// within a tokio runtime; does not block.
    pub fn new(network: &Network, port: &str, options: RemoteOptions) -> RemoteBoard {
        let network = network.clone().with_timeout(options.timeout);
        let own = format!("{}/rpc:o", options.local);
        let to = format!("{port}/rpc:i");
        let control = RpcClient::keep(&network, &own, &to, Carrier::Tcp);
        let sender = Sender::keep(
            &network,
            &format!("{}/command:o", options.local),
            &format!("{port}/command:i"),
            options.carrier,
        );
        let shared = Arc::new(SharedRemote {
            control: Mutex::new(control),
            link: watch::Sender::new(LinkState::Down("not connected yet".into())),
            facts: watch::Sender::new(None),
            state: watch::Sender::new(None),
            trouble: Notify::new(),
            lost: AtomicU64::new(0),
            unsent: AtomicU64::new(0),
            age: AtomicU64::new(0),
            leave: watch::Sender::new(false),
            port: port.to_owned(),
            network,
            options,
        });
        let (commands, queue) = mpsc::channel(WAITING);
        let mut tasks = JoinSet::new();
        tasks.spawn(session::run(shared.clone()));
        tasks.spawn(send_all(shared.clone(), sender, queue));
        RemoteBoard { shared, tasks: Mutex::new(tasks), commands }
    }

    /// Ready when a task of this client has died: it can't be used any more, and has to be replaced.
    pub async fn died(&self) {
        let _ = self.tasks.lock().await.join_next().await;
    }

    /// Ends in order: no more states arrive, and the name of the state port is free again.
    pub async fn close(&self) {
        self.shared.leave.send_replace(true);
        self.died().await;
    }

    /// Prefix of the board's port names.
    pub fn port(&self) -> &str {
        &self.shared.port
    }

    /// State of the connection, as it changes.
    pub fn link(&self) -> watch::Receiver<LinkState> {
        self.shared.link.subscribe()
    }

    /// Facts of the board's axes since it was first reached; constant for the life of this client.
    pub fn facts(&self) -> watch::Receiver<Option<Arc<[AxisFacts]>>> {
        self.shared.facts.subscribe()
    }

    /// The newest state, as it changes.
    pub fn state(&self) -> watch::Receiver<Option<Arc<RemoteState>>> {
        self.shared.state.subscribe()
    }

    /// Number of states lost in transit, as far as their stamps show.
    pub fn lost(&self) -> u64 {
        self.shared.lost.load(Ordering::Relaxed)
    }

    /// Number of streamed commands that could not be sent.
    pub fn unsent(&self) -> u64 {
        self.shared.unsent.load(Ordering::Relaxed)
    }

    /// Sends requests to the board, one after the other.
    ///
    /// # Errors
    /// No connection, or no answer in time; the outcome of an order is unknown then.
    pub async fn ask(&self, request: &Ask) -> Result<Bottle, CallError> {
        self.shared.ask(&request.bottle()).await
    }

    /// Sends an order. Returns true if the board executed it.
    ///
    /// # Errors
    /// As for [`RemoteBoard::ask`].
    pub async fn order(&self, request: &Ask) -> Result<bool, CallError> {
        self.ask(request).await.map(|answer| reply::is_ok(&answer))
    }

    /// Sends setpoints, which have no answer. Never blocks; returns `false` and drops them if too many are
    /// waiting.
    pub fn stream(&self, command: Streamed) -> bool {
        let age = self.shared.age.load(Ordering::SeqCst);
        let sent = self.commands.try_send((age, command)).is_ok();
        if !sent {
            self.shared.unsent.fetch_add(1, Ordering::Relaxed);
        }
        sent
    }

    /// Discards the setpoints that still wait to be sent.
    pub fn hush(&self) {
        self.shared.age.fetch_add(1, Ordering::SeqCst);
    }
}

impl SharedRemote {
    async fn ask(&self, request: &Bottle) -> Result<Bottle, CallError> {
        let answer = self.control.lock().await.call(request).await;
        if let Err(error) = &answer
            && !matches!(error, CallError::Payload(_))
        {
            self.trouble.notify_one();
        }
        answer
    }
}

async fn send_all(shared: Arc<SharedRemote>, mut sender: Sender, mut queue: mpsc::Receiver<(u64, Streamed)>) {
    let dialect = shared.network.dialect();
    while let Some((age, command)) = queue.recv().await {
        if age != shared.age.load(Ordering::SeqCst) {
            continue;
        }
        let (head, body) = command.pair();
        let sent = sender.send(pair::encode(&head, &body, dialect), None).await;
        if let Err(error) = sent {
            shared.unsent.fetch_add(1, Ordering::Relaxed);
            tracing::debug!(board = shared.port, error = error.to_string(), "a set-point was not sent");
        }
    }
}

/// Message about a port that could not be opened or reached, in one line.
fn in_words(error: &PortError) -> String {
    error.to_string()
}
