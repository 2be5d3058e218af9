//! The control port as a service of a run.

use super::desk::{BesideNames, Desk};
use super::door::{Door, Guest};
use super::wire::{self, Reply, Request};
use crate::run::{Folder, Recording};
use mobee_actors::system::Control;
use mobee_contract::{Answer, Running, Service};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::BufReader;
use tokio::sync::{mpsc, watch};
use tokio::task::JoinSet;
use tokio::time::timeout;

/// Connections at a time; more are closed at once.
const GUESTS: usize = 16;
/// How long a connection may be silent between two requests.
const IDLE: Duration = Duration::from_secs(60);
/// How long a reply may take to be taken.
const WRITE: Duration = Duration::from_secs(5);
/// How long replies that are under way may take at the end of the run.
const LEAVE: Duration = Duration::from_secs(1);
/// How long to wait if the system gives no connection now.
const PAUSE: Duration = Duration::from_millis(50);

/// Serves the control port of a run.
pub struct CtlService {
    folder: PathBuf,
    address: Option<SocketAddr>,
    controls: mpsc::Sender<Control>,
    recording: Arc<Recording>,
    beside: BesideNames,
}

impl CtlService {
    /// For the run in this folder: at an address (port 0: any that is free), or else a socket in the folder. `recording` is how
    /// it is recorded, `beside` are the names of what runs beside its robots.
    pub(crate) fn new(
        folder: &Folder,
        address: Option<SocketAddr>,
        controls: mpsc::Sender<Control>,
        recording: Arc<Recording>,
        beside: BesideNames,
    ) -> CtlService {
        CtlService { folder: folder.path().to_owned(), address, controls, recording, beside }
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
            let door = Door::open(&self.folder, self.address).await?;
            let desk = Desk::new(running, self.controls.clone(), self.recording.clone(), self.beside.clone());
            let (mut guests, ending) = (JoinSet::new(), watch::Sender::new(false));
            tokio::select! {
                () = until => {}
                () = desk.follow() => {}
                () = receive(&door, &desk, &mut guests, &ending) => {}
            }
            Door::forget(&self.folder);
            ending.send_replace(true);
            let _ = timeout(LEAVE, async { while guests.join_next().await.is_some() {} }).await;
            Ok(())
        })
    }
}

/// Receives guests; for ever.
async fn receive(door: &Door, desk: &Arc<Desk>, guests: &mut JoinSet<()>, ending: &watch::Sender<bool>) {
    loop {
        tokio::select! {
            Some(_) = guests.join_next() => {}
            knock = door.knock() => match knock {
                Ok(guest) if guests.len() < GUESTS => {
                    guests.spawn(attend(guest, desk.clone(), ending.subscribe()));
                }
                Ok(_) => {}
                Err(_) => tokio::time::sleep(PAUSE).await,
            }
        }
    }
}

/// Answers one guest until it goes, falls silent, or the run ends.
async fn attend(guest: Guest, desk: Arc<Desk>, mut ending: watch::Receiver<bool>) {
    let Ok(line) = guest.admit().await else { return };
    let mut line = BufReader::new(line);
    loop {
        let request = tokio::select! {
            _ = ending.wait_for(|ends| *ends) => return,
            request = timeout(IDLE, wire::read::<Request>(&mut line)) => request,
        };
        let (reply, last) = match request {
            Ok(Ok(Some(request))) => (desk.reply(request).await, false),
            // what follows on a line that was not understood would not be either
            Ok(Err(why)) => (Reply { done: false, lines: vec![why.to_string()] }, true),
            Ok(Ok(None)) | Err(_) => return,
        };
        if !matches!(timeout(WRITE, wire::write(line.get_mut(), &reply)).await, Ok(Ok(()))) || last {
            return;
        }
    }
}
