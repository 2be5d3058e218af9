//! The control port as a service of a run.

use super::handler::{BesideNames, ENDING, RequestHandler};
use super::listener::{CtlListener, CtlPeer};
use super::wire::{self, CtlStream, Reply, Request};
use crate::run::{Folder, LogBook, Recording};
use mobee_contract::{Answer, Running, Service};
use mobee_runtime::system::Control;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::io::BufReader;
use tokio::sync::{mpsc, watch};
use tokio::task::JoinSet;
use tokio::time::timeout;

/// Maximum number of connections; further ones are closed at once.
const MAX_CONNECTIONS: usize = 16;
/// Time without a request after which a connection is closed.
const IDLE_TIMEOUT: Duration = Duration::from_secs(60);
/// Time limit for sending a reply.
const WRITE_TIMEOUT: Duration = Duration::from_secs(5);
/// Time limit for replies that are under way at the end of the run.
const DRAIN_TIMEOUT: Duration = Duration::from_secs(1);
/// Pause after a failure to accept a connection.
const ACCEPT_RETRY_DELAY: Duration = Duration::from_millis(50);

/// The address of a run's control port, and the state that it shares with the rest of the run.
pub(crate) struct CtlPort {
    /// An address (port 0: any free one); `None`: a socket in the run's folder.
    pub(crate) address: Option<SocketAddr>,
    /// The newest events as sentences.
    pub(crate) log: LogBook,
    /// The connections that stay open until the run is over.
    pub(crate) stop_connections: StopConnections,
}

/// The connections by which the run was stopped. They are closed when the run is over and its folder is written: `mobee
/// ctl stop` waits for that. Clones share them.
#[derive(Clone, Default)]
pub(crate) struct StopConnections(Arc<Mutex<Vec<Box<dyn CtlStream>>>>);

impl StopConnections {
    fn push(&self, line: Box<dyn CtlStream>) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(line);
    }

    /// Closes the connections when the run is over.
    pub(crate) fn close(&self) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }
}

/// Serves the control port of a run.
pub struct CtlService {
    folder: PathBuf,
    port: CtlPort,
    controls: mpsc::Sender<Control>,
    recording: Arc<Recording>,
    beside: BesideNames,
}

impl CtlService {
    /// A control port for the run in this folder; `beside` are the names of the parts that do not belong to its robots.
    pub(crate) fn new(
        folder: &Folder,
        port: CtlPort,
        controls: mpsc::Sender<Control>,
        recording: Arc<Recording>,
        beside: BesideNames,
    ) -> CtlService {
        CtlService { folder: folder.path().to_owned(), port, controls, recording, beside }
    }
}

impl Service for CtlService {
    fn name(&self) -> String {
        "ctl".into()
    }

    fn keeps_run(&self) -> bool {
        false
    }

    fn serve(self: Arc<Self>, running: Arc<dyn Running>, until: Answer<()>) -> Answer<Result<(), String>> {
        Box::pin(async move {
            let door = CtlListener::open(&self.folder, self.port.address).await?;
            let desk = RequestHandler::new(
                running,
                self.controls.clone(),
                self.recording.clone(),
                self.beside.clone(),
                self.port.log.clone(),
            );
            let mut connections = JoinSet::new();
            let ending = watch::Sender::new(false);
            tokio::select! {
                () = until => {}
                () = desk.follow() => {}
                () = accept_connections(&door, &desk, &mut connections, (&ending, &self.port.stop_connections)) => {}
            }
            CtlListener::remove_files(&self.folder);
            ending.send_replace(true);
            let _ = timeout(DRAIN_TIMEOUT, async { while connections.join_next().await.is_some() {} }).await;
            Ok(())
        })
    }
}

/// Accepts connections; never returns.
async fn accept_connections(
    door: &CtlListener,
    desk: &Arc<RequestHandler>,
    connections: &mut JoinSet<()>,
    (ending, stop_connections): (&watch::Sender<bool>, &StopConnections),
) {
    loop {
        tokio::select! {
            Some(_) = connections.join_next() => {}
            accept = door.accept() => match accept {
                Ok(guest) if connections.len() < MAX_CONNECTIONS => {
                    connections.spawn(serve_connection(guest, desk.clone(), ending.subscribe(), stop_connections.clone()));
                }
                Ok(_) => {}
                Err(_) => tokio::time::sleep(ACCEPT_RETRY_DELAY).await,
            }
        }
    }
}

/// Serves one connection until it closes, is idle for too long, or the run ends.
async fn serve_connection(
    guest: CtlPeer,
    desk: Arc<RequestHandler>,
    mut ending: watch::Receiver<bool>,
    stop_connections: StopConnections,
) {
    let Ok(line) = guest.admit().await else { return };
    let mut line = BufReader::new(line);
    loop {
        let request = tokio::select! {
            () = async { drop(ending.wait_for(|ends| *ends).await) } => None,
            request = timeout(IDLE_TIMEOUT, wire::read::<Request>(&mut line)) => Some(request),
        };
        let Some(request) = request else {
            // the client reads this in place of a reply to its next request
            let _ = timeout(WRITE_TIMEOUT, wire::write(line.get_mut(), &desk.farewell())).await;
            return;
        };
        let (mut reply, last) = match request {
            Ok(Ok(Some(request))) => {
                let stops = request.words.first().is_some_and(|word| word == "stop");
                (desk.reply(request).await, stops)
            }
            // after a malformed line the rest of the connection is unusable
            Ok(Err(why)) => (Reply { done: false, lines: vec![why.to_string()], over: false }, true),
            Ok(Ok(None)) | Err(_) => return,
        };
        if !reply.done && reply.lines == [ENDING] {
            let _ = timeout(DRAIN_TIMEOUT / 2, async { drop(ending.wait_for(|ends| *ends).await) }).await;
            reply = desk.farewell();
        }
        if !matches!(timeout(WRITE_TIMEOUT, wire::write(line.get_mut(), &reply)).await, Ok(Ok(()))) {
            return;
        }
        if last {
            if reply.done {
                stop_connections.push(line.into_inner());
            }
            return;
        }
    }
}
