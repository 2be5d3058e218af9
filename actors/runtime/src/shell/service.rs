//! A service's shell: one life of a [`Service`], from its start to its end, orderly or not.
//!
//! ```text
//! real clock      the life has its own thread and runtime: it delays no pulse
//! virtual clock   the life is a task of the shared runtime, in the run's time
//! ```
//! A life acts through its own [`Access`], which is revoked when it ends: its open motions are rolled back, and
//! code of it that still runs (a blocked thread can't be killed) can start no motion.

use crate::access::Access;
use crate::clock::{Clock, ClockKind};
use crate::wiring::{LatestCell, PartSlot, SharedContext};
use mobee_contract::{Event, Service, SwapPart, SwapStep, Time};
use ractor::{Actor, ActorProcessingErr, ActorRef};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;
use tokio::sync::{oneshot, watch};

/// Time in which a service must leave after a request.
const LEAVE_TIMEOUT: Duration = Duration::from_secs(3);
/// Time for its runtime to shut down after that.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_secs(1);
/// Pause before a service is started again: the cause of its failure (a port in use, a name server that is
/// down) may pass.
const RESTART_PAUSE: Duration = Duration::from_secs(1);
/// Interval of the heartbeats of a life's runtime, by which it shows that it is not blocked.
const BEAT: Duration = Duration::from_secs(1);
/// Number of missed heartbeats after which a life is ended. They are counted rather than timed, so that no
/// service is killed after the machine slept.
const MAX_MISSES: u32 = 10;
/// Number of heartbeats after which a restarted life counts as running: it has had the time to open its
/// resources.
const SERVES: u64 = 4;

/// Time for which its supervisor waits for a service's end: longer than the service may take.
pub const GRACE: Duration = Duration::from_secs(6);

/// Unique names of services in a run: a name that is taken gets a number appended.
pub fn named_apart(own: impl IntoIterator<Item = String>) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for own in own {
        let numbered = (2..).map(|k| format!("{own}-{k}"));
        let free = std::iter::once(own.clone()).chain(numbered).find(|name| !names.contains(name));
        names.extend(free);
    }
    names
}

/// State of a service that survives its lives.
pub struct ServiceSlot {
    name: String,
    slot: PartSlot<Arc<dyn Service>>,
    /// Access of the present life.
    access: LatestCell<Option<Arc<Access>>>,
    /// Reason for which the last life ended.
    why: LatestCell<String>,
    begun: AtomicBool,
    done: AtomicBool,
}

impl ServiceSlot {
    /// Creates the slots of these services.
    pub fn all(services: Vec<Arc<dyn Service>>) -> Vec<Arc<ServiceSlot>> {
        let names = named_apart(services.iter().map(|s| s.name()));
        let service_slot = |(service, name)| {
            let begun = AtomicBool::new(false);
            let done = AtomicBool::new(false);
            let access = LatestCell::default();
            let why = LatestCell::default();
            Arc::new(ServiceSlot { name, slot: PartSlot::new(service), access, why, begun, done })
        };
        services.into_iter().zip(names).map(service_slot).collect()
    }

    /// Name of the service in the run.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The active service, and the state of its exchange.
    pub fn slot(&self) -> &PartSlot<Arc<dyn Service>> {
        &self.slot
    }

    /// Serves the announced service from the next life on, which begins at once. `false` if it was withdrawn.
    pub fn take_over(&self, new: Arc<dyn Service>, now: Time) -> bool {
        self.reset();
        self.slot.take_over(new, now)
    }

    /// Reports a failed life: its open motions are rolled back, and on probation the previous service returns.
    pub fn failed(&self, shared: &SharedContext, why: &str) {
        self.vacate(why);
        if self.slot.broke(shared.clock.now()) {
            // The previous service runs again: the service is not down.
            self.reset();
            shared.report_swap_beside(&self.name, SwapPart::Bridge, SwapStep::Reverted { why: why.into() });
            return;
        }
        let news = shared.counts.lock().down.insert(self.name.clone(), why.to_owned());
        if shared.clock.kind() == ClockKind::Real && news.as_deref() != Some(why) {
            let text = format!("service {} failed: {why}; it is started again", self.name);
            shared.emit(Event::Warning { text });
        }
    }

    fn reset(&self) {
        self.begun.store(false, Ordering::SeqCst);
        self.done.store(false, Ordering::SeqCst);
    }

    /// True if the run must continue for it: until it ends in order.
    pub fn keeps_run(&self) -> bool {
        self.slot.part().keeps_run() && !self.done.load(Ordering::SeqCst)
    }

    /// Ends its life for this reason: its open motions are rolled back.
    pub fn vacate(&self, why: &str) {
        *self.why.lock() = why.to_owned();
        if let Some(access) = self.access.lock().take() {
            access.revoke();
        }
    }

    /// Reports that it is not started again.
    pub fn give_up(&self, shared: &SharedContext) {
        let name = &self.name;
        let why = self.why.lock().clone();
        let text = format!("service {name} has used up its restarts and is down: {why}");
        shared.emit(Event::Warning { text });
        shared.give_up_beside(name, why);
    }
}

/// The service's actor.
pub struct ServiceActor;

/// Message to a service's actor.
#[derive(Debug)]
pub enum ServiceMsg {
    /// The service has ended by itself: in order, or for a reason.
    Ended(Result<(), String>),
    /// A check of its heartbeats is due.
    Look,
}

/// State of a [`ServiceActor`].
pub struct ServiceState {
    shared: Arc<SharedContext>,
    service_slot: Arc<ServiceSlot>,
    /// Sender of the request to leave.
    leave: watch::Sender<bool>,
    /// Ready when it has left. Dropping it ends the life at once.
    left: oneshot::Receiver<()>,
    /// Heartbeats of its runtime.
    beats: Arc<AtomicU64>,
    /// Heartbeats at the last check.
    last_beats: u64,
    misses: u32,
}

impl Actor for ServiceActor {
    type Msg = ServiceMsg;
    type State = ServiceState;
    type Arguments = (Arc<SharedContext>, Arc<ServiceSlot>);

    async fn pre_start(
        &self,
        myself: ActorRef<ServiceMsg>,
        (shared, service_slot): Self::Arguments,
    ) -> Result<ServiceState, ActorProcessingErr> {
        let access = Arc::new(Access::new(&shared));
        *service_slot.access.lock() = Some(access.clone());
        let (leave, until) = watch::channel(false);
        let (gone, left) = oneshot::channel();
        let beats = Arc::new(AtomicU64::new(0));
        let pause = service_slot.begun.swap(true, Ordering::SeqCst).then_some(RESTART_PAUSE);
        let life = Life { service: service_slot.slot.part(), access, until, clock: shared.clock.clone(), pause };
        start(life, beats.clone(), myself.clone(), gone)?;
        myself.send_after(BEAT, || ServiceMsg::Look);
        Ok(ServiceState { shared, service_slot, leave, left, beats, last_beats: 0, misses: 0 })
    }

    async fn handle(
        &self,
        myself: ActorRef<ServiceMsg>,
        message: ServiceMsg,
        state: &mut ServiceState,
    ) -> Result<(), ActorProcessingErr> {
        match message {
            ServiceMsg::Ended(Ok(())) => {
                state.service_slot.slot.answered(state.shared.clock.now());
                state.service_slot.done.store(true, Ordering::SeqCst);
                state.shared.counts.lock().down.remove(state.service_slot.name());
                myself.stop(None);
            }
            ServiceMsg::Ended(Err(why)) => return Err(why.into()),
            ServiceMsg::Look => {
                let beats = state.beats.load(Ordering::SeqCst);
                let moves = beats != state.last_beats;
                state.misses = if moves { 0 } else { state.misses + 1 };
                state.last_beats = beats;
                if moves {
                    state.service_slot.slot.answered(state.shared.clock.now());
                }
                if beats >= SERVES {
                    state.shared.counts.lock().down.remove(state.service_slot.name());
                }
                // One on probation has its budget, plus a heartbeat before and after.
                let beats = |budget: Duration| u32::try_from(budget.as_secs()).unwrap_or(MAX_MISSES).saturating_add(2);
                let most = state.service_slot.slot.budget().map_or(MAX_MISSES, |budget| beats(budget).min(MAX_MISSES));
                if state.misses >= most {
                    return Err(format!("its thread has been blocked for {} s", (BEAT * most).as_secs()).into());
                }
                myself.send_after(BEAT, || ServiceMsg::Look);
            }
        }
        Ok(())
    }

    /// Planned end: the service leaves in order, or is abandoned.
    async fn post_stop(&self, _: ActorRef<ServiceMsg>, state: &mut ServiceState) -> Result<(), ActorProcessingErr> {
        let _ = state.leave.send(true);
        if tokio::time::timeout(LEAVE_TIMEOUT + SHUTDOWN_TIMEOUT, &mut state.left).await.is_err() {
            let text = format!("service {} did not leave in time, and is left behind", state.service_slot.name());
            state.shared.emit(Event::Warning { text });
        }
        state.service_slot.vacate("its end was requested");
        Ok(())
    }
}

/// One life of a service before its start.
struct Life {
    service: Arc<dyn Service>,
    access: Arc<Access>,
    until: watch::Receiver<bool>,
    clock: Clock,
    pause: Option<Duration>,
}

impl Life {
    /// Runs the service to its end.
    async fn live(self) -> Result<(), String> {
        let Life { service, access, mut until, clock, pause } = self;
        if let Some(pause) = pause {
            tokio::select! {
                biased;
                // An error means that the actor is gone, which is an end, too.
                _ = until.wait_for(|leave| *leave) => return Ok(()),
                () = clock.sleep(pause) => {}
            }
        }
        let leave = async move { drop(until.wait_for(|leave| *leave).await) };
        // A separate task, so that its panic is caught and becomes the reason.
        let served = tokio::spawn(async move { service.serve(access, Box::pin(leave)).await });
        let _end = AbortOnDrop(served.abort_handle());
        match served.await {
            Ok(ended) => ended,
            Err(e) if e.is_panic() => Err("it panicked".into()),
            Err(e) => Err(e.to_string()),
        }
    }
}

/// Starts a life: on its own thread with a real clock, as a task with a virtual one.
fn start(
    life: Life,
    beats: Arc<AtomicU64>,
    myself: ActorRef<ServiceMsg>,
    mut gone: oneshot::Sender<()>,
) -> std::io::Result<()> {
    let clock = life.clock.clone();
    let beat = {
        let clock = clock.clone();
        async move {
            loop {
                clock.sleep(BEAT).await;
                beats.fetch_add(1, Ordering::SeqCst);
            }
        }
    };
    let name = life.service.name();
    let whole = async move {
        let ended = tokio::select! {
            biased;
            () = gone.closed() => None,
            ended = life.live() => Some(ended),
            () = beat => None,
        };
        (ended, gone)
    };
    let report = move |(ended, gone): (Option<Result<(), String>>, oneshot::Sender<()>)| {
        // An error means that the actor is gone.
        let _ = gone.send(());
        if let Some(ended) = ended {
            let _ = myself.send_message(ServiceMsg::Ended(ended));
        }
    };
    if clock.kind() == ClockKind::Virtual {
        tokio::spawn(async move { report(whole.await) });
        return Ok(());
    }
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    std::thread::Builder::new().name(name).spawn(move || {
        let ended = runtime.block_on(whole);
        // Tasks that the service left running end before its successor begins.
        runtime.shutdown_timeout(SHUTDOWN_TIMEOUT);
        report(ended);
    })?;
    Ok(())
}

/// Aborts a task when dropped: a spawned task would otherwise survive the one that waits for it.
struct AbortOnDrop(tokio::task::AbortHandle);

impl Drop for AbortOnDrop {
    fn drop(&mut self) {
        self.0.abort();
    }
}
