//! Services run beside the safety chain, on a thread and a runtime of their own: none of them can hold it up.

use crate::access::Access;
use crate::wiring::Hub;
use mobee_contract::{Event, Service};
use std::io;
use std::sync::Arc;
use std::time::Duration;
use tokio::runtime::Builder;
use tokio::sync::{oneshot, watch};
use tokio::task::JoinSet;

/// How long a service may take to leave.
const LEAVE: Duration = Duration::from_secs(3);

/// Services that run.
pub struct Services {
    leave: watch::Sender<bool>,
    left: oneshot::Receiver<()>,
}

impl Services {
    /// Starts them, each with its own access. `None` if there are none.
    ///
    /// # Errors
    /// If the operating system gives no thread, timer or poller.
    pub fn start(
        services: Vec<Box<dyn Service>>,
        hub: &Arc<Hub>,
        access: impl Fn() -> Access,
    ) -> io::Result<Option<Services>> {
        if services.is_empty() {
            return Ok(None);
        }
        let services: Vec<_> = services.into_iter().map(|s| (s, Arc::new(access()))).collect();
        let runtime = Builder::new_current_thread().enable_all().build()?;
        let (leave, until) = watch::channel(false);
        let (ended, left) = oneshot::channel();
        let hub = hub.clone();
        std::thread::Builder::new().name("services".into()).spawn(move || {
            runtime.block_on(serve(services, hub, until));
            runtime.shutdown_timeout(LEAVE / 3);
            let _ = ended.send(());
        })?;
        Ok(Some(Services { leave, left }))
    }

    /// Tells them to leave, and waits for it; one that blocks its thread is left behind.
    pub async fn leave(self, hub: &Hub) {
        let _ = self.leave.send(true);
        if tokio::time::timeout(LEAVE * 2, self.left).await.is_err() {
            hub.tell(Event::Warning { text: "the services did not leave in time; the run ends without them".into() });
        }
    }
}

async fn serve(services: Vec<(Box<dyn Service>, Arc<Access>)>, hub: Arc<Hub>, until: watch::Receiver<bool>) {
    let mut serving = JoinSet::new();
    for (service, access) in services {
        let (until, hub) = (until.clone(), hub.clone());
        serving.spawn(attend(service, access, hub, until));
    }
    let all = async { while serving.join_next().await.is_some() {} };
    tokio::select! {
        () = all => {}
        () = async { wait(until).await; tokio::time::sleep(LEAVE).await } => {}
    }
    // whoever is still there is dropped with the set
}

/// Ready when the services are to leave.
async fn wait(mut until: watch::Receiver<bool>) {
    // an error means that the run is gone, which is an end as well
    let _ = until.wait_for(|leave| *leave).await;
}

/// Runs one service to its end, whatever that is; its motions never outlive it.
async fn attend(service: Box<dyn Service>, access: Arc<Access>, hub: Arc<Hub>, until: watch::Receiver<bool>) {
    let name = service.name();
    let (running, leave) = (access.clone(), until.clone());
    let orphans = Orphans(access);
    // a task of its own: its panic ends nobody else
    let served = tokio::spawn(async move { service.serve(running, Box::pin(wait(leave))).await });
    let _abort = AbortOnDrop(served.abort_handle());
    let why = match served.await {
        Ok(Ok(())) if *until.borrow() => None,
        Ok(Ok(())) => Some("it ended before the run did".to_string()),
        Ok(Err(why)) => Some(why),
        Err(e) => Some(if e.is_panic() { "it panicked".into() } else { e.to_string() }),
    };
    drop(orphans);
    if let Some(why) = why {
        hub.tell(Event::Warning { text: format!("service {name} is gone until the next run: {why}") });
    }
}

/// However a service ends, with its thread even: its motions do not outlive it.
struct Orphans(Arc<Access>);

impl Drop for Orphans {
    fn drop(&mut self) {
        self.0.orphan();
    }
}

/// A spawned task would outlive the one that waits for it.
struct AbortOnDrop(tokio::task::AbortHandle);

impl Drop for AbortOnDrop {
    fn drop(&mut self) {
        self.0.abort();
    }
}
