//! A real board, seen from afar: its facts, its state, and what it is told (spec sections 12, 13, 14 and 19).
//!
//! ```text
//! LOCAL/rpc:o     ──> PREFIX/rpc:i       orders and readings of our own, one after the other
//! LOCAL/command:o ──> PREFIX/command:i   streamed set-points
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

/// Streamed commands that may wait to be sent; more are refused.
const WAITING: usize = 32;

/// How a board is spoken to.
#[derive(Clone, Debug, PartialEq)]
pub struct RemoteOptions {
    /// First part of our own port names, such as `/MoBeE/icub/driver/torso`.
    pub local: String,
    /// How states and streamed commands travel.
    pub carrier: Carrier,
    /// Time to wait for an answer.
    pub timeout: Duration,
    /// Age at which a state is stale: the stream is then asked for again.
    pub stale: Duration,
}

/// Whether there is a connection.
#[derive(Clone, Debug, PartialEq)]
pub enum LinkState {
    /// None, and why. It is tried again, for ever, with pauses that grow up to 2 s.
    Down(String),
    /// There is one, the `n`-th. Whatever the board was told before this one began counts no more.
    Up(u64),
    /// Another program has our port names: two would be writing to one robot. Nothing is written until it has gone.
    Taken(String),
}

/// A state as it came.
#[derive(Clone, Debug)]
pub struct RemoteState {
    /// Counts the states that the board published, as far as their stamps tell: a gap means lost ones.
    pub seq: u64,
    /// The board's own stamp.
    pub stamp: Option<Stamp>,
    /// When it came.
    pub arrived: Instant,
    /// What it says; only positions if it came by `state:o`.
    pub joints: JointData,
}

/// The client of one real board. It connects in the background and for ever again; dropping it ends that.
pub struct RemoteBoard {
    shared: Arc<Shared>,
    tasks: Mutex<JoinSet<()>>,
    commands: mpsc::Sender<(u64, Streamed)>,
}

/// What the tasks of one board share.
struct Shared {
    network: Network,
    port: String,
    options: RemoteOptions,
    control: Mutex<RpcClient>,
    link: watch::Sender<LinkState>,
    facts: watch::Sender<Option<Arc<[AxisFacts]>>>,
    state: watch::Sender<Option<Arc<RemoteState>>>,
    /// Rung when something went wrong that the session should look at.
    trouble: Notify,
    lost: AtomicU64,
    unsent: AtomicU64,
    /// Whether the client is to end in order.
    leave: watch::Sender<bool>,
    /// Streamed commands of an earlier age are thrown away instead of sent.
    age: AtomicU64,
}

impl RemoteBoard {
    /// The client of the board whose ports begin with `port`, such as `/icub/torso`. Must be called within a tokio runtime; waits for nothing.
    pub fn new(network: &Network, port: &str, options: RemoteOptions) -> RemoteBoard {
        let network = network.clone().with_timeout(options.timeout);
        let (own, to) = (format!("{}/rpc:o", options.local), format!("{port}/rpc:i"));
        let control = RpcClient::keep(&network, &own, &to, Carrier::Tcp);
        let sender = Sender::keep(
            &network,
            &format!("{}/command:o", options.local),
            &format!("{port}/command:i"),
            options.carrier,
        );
        let shared = Arc::new(Shared {
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

    /// Ready when a task of this client has died: it is of no use any more, and another one is to be made.
    pub async fn died(&self) {
        let _ = self.tasks.lock().await.join_next().await;
    }

    /// Ends in order: nothing comes any more, and the name of the port for states is free again.
    pub async fn close(&self) {
        self.shared.leave.send_replace(true);
        self.died().await;
    }

    /// First part of the board's port names.
    pub fn port(&self) -> &str {
        &self.shared.port
    }

    /// Whether there is a connection, as it changes.
    pub fn link(&self) -> watch::Receiver<LinkState> {
        self.shared.link.subscribe()
    }

    /// What is known of the board's axes since it was first reached; they stay the same for the life of this client.
    pub fn facts(&self) -> watch::Receiver<Option<Arc<[AxisFacts]>>> {
        self.shared.facts.subscribe()
    }

    /// The newest state, as it changes.
    pub fn state(&self) -> watch::Receiver<Option<Arc<RemoteState>>> {
        self.shared.state.subscribe()
    }

    /// How many states were lost on the way, as far as their stamps tell.
    pub fn lost(&self) -> u64 {
        self.shared.lost.load(Ordering::Relaxed)
    }

    /// How many streamed commands could not be sent.
    pub fn unsent(&self) -> u64 {
        self.shared.unsent.load(Ordering::Relaxed)
    }

    /// Asks the board, one request after the other.
    ///
    /// # Errors
    /// No connection, or no answer in time; whether an order was done is not known then.
    pub async fn ask(&self, request: &Ask) -> Result<Bottle, CallError> {
        self.shared.ask(&request.bottle()).await
    }

    /// Gives an order; whether the board did it.
    ///
    /// # Errors
    /// As for [`RemoteBoard::ask`].
    pub async fn order(&self, request: &Ask) -> Result<bool, CallError> {
        self.ask(request).await.map(|answer| reply::is_ok(&answer))
    }

    /// Sends set-points that expect no answer. Never waits; `false` if too many wait already, and they are dropped.
    pub fn stream(&self, command: Streamed) -> bool {
        let age = self.shared.age.load(Ordering::SeqCst);
        let sent = self.commands.try_send((age, command)).is_ok();
        if !sent {
            self.shared.unsent.fetch_add(1, Ordering::Relaxed);
        }
        sent
    }

    /// Throws away the set-points that still wait to be sent.
    pub fn hush(&self) {
        self.shared.age.fetch_add(1, Ordering::SeqCst);
    }
}

impl Shared {
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

async fn send_all(shared: Arc<Shared>, mut sender: Sender, mut queue: mpsc::Receiver<(u64, Streamed)>) {
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

/// Why a port could not be opened or reached, in one line.
fn in_words(error: &PortError) -> String {
    error.to_string()
}
