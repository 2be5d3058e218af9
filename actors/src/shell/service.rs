//! A service's shell: one life of a [`Service`], from its start to its end, whatever that is.
//!
//! ```text
//! real clock      the life has a thread and a runtime of its own: whatever it does there, no pulse waits for it
//! virtual clock   the life is a task of the one runtime, and time passes for it as for everybody
//! ```
//! What a life may do goes through its own [`Access`], which is revoked when it ends: the motions that it has under way are taken back, and
//! whatever of it still runs (a thread that blocks can't be killed) can begin none.

use crate::access::Access;
use crate::runtime::clock::{Clock, ClockKind};
use crate::wiring::{LatestCell, Seat, SharedContext};
use mobee_contract::{Event, Service, SwapPart, SwapStep, Time};
use ractor::{Actor, ActorProcessingErr, ActorRef};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;
use tokio::sync::{oneshot, watch};

/// How long a service may take to leave, and what becomes of its runtime after that.
const LEAVE: Duration = Duration::from_secs(3);
const CLEAR: Duration = Duration::from_secs(1);
/// Before a service is served anew: what made it fail (a port that is taken, a name server that is away) may need a moment to pass.
const PAUSE: Duration = Duration::from_secs(1);
/// How often a life's runtime shows that it is not blocked, and how many times it may fail to before the life is given up. Counted, and not
/// measured, so that a machine that slept kills nobody.
const BEAT: Duration = Duration::from_secs(1);
const MISSES: u32 = 10;
/// After so many of them a life that follows a failed one counts as serving: it has had the time to open what it needs.
const SERVES: u64 = 4;

/// How long its supervisor waits for a service's end: longer than the service may take.
pub const GRACE: Duration = Duration::from_secs(6);

/// The names by which services are known in a run: their own, and who has one that is taken gets a number behind it.
pub fn named_apart(own: impl IntoIterator<Item = String>) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for own in own {
        let numbered = (2..).map(|k| format!("{own}-{k}"));
        let free = std::iter::once(own.clone()).chain(numbered).find(|name| !names.contains(name));
        names.extend(free);
    }
    names
}

/// What outlives the lives of a service.
pub struct Post {
    name: String,
    seat: Seat<Arc<dyn Service>>,
    /// What the present life may do.
    access: LatestCell<Option<Arc<Access>>>,
    /// Why the last life ended.
    why: LatestCell<String>,
    begun: AtomicBool,
    done: AtomicBool,
}

impl Post {
    /// For these services.
    pub fn all(services: Vec<Arc<dyn Service>>) -> Vec<Arc<Post>> {
        let names = named_apart(services.iter().map(|s| s.name()));
        let post = |(service, name)| {
            let (access, why, begun, done) =
                (LatestCell::default(), LatestCell::default(), AtomicBool::new(false), AtomicBool::new(false));
            Arc::new(Post { name, seat: Seat::new(service), access, why, begun, done })
        };
        services.into_iter().zip(names).map(post).collect()
    }

    /// The service's name in the run.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Which service is served, and how far its exchange is.
    pub fn seat(&self) -> &Seat<Arc<dyn Service>> {
        &self.seat
    }

    /// The announced service is served from the next life on, which begins at once. `false`: it was withdrawn.
    pub fn take_over(&self, new: Arc<dyn Service>, now: Time) -> bool {
        self.begin_anew();
        self.seat.take_over(new, now)
    }

    /// A life has failed: what it had under way is taken back, and on probation the service before is served again.
    pub fn fell(&self, shared: &SharedContext, why: &str) {
        self.vacate(why);
        if self.seat.broke(shared.clock.now()) {
            // the one before serves again: nothing is down
            self.begin_anew();
            shared.tell_beside(&self.name, SwapPart::Bridge, SwapStep::Reverted { why: why.into() });
            return;
        }
        let news = shared.counts.lock().down.insert(self.name.clone(), why.to_owned());
        if shared.clock.kind() == ClockKind::Real && news.as_deref() != Some(why) {
            let text = format!("service {} failed: {why}; it is started again", self.name);
            shared.tell(Event::Warning { text });
        }
    }

    fn begin_anew(&self) {
        self.begun.store(false, Ordering::SeqCst);
        self.done.store(false, Ordering::SeqCst);
    }

    /// Whether the run goes on for it: until it ends in order.
    pub fn keeps_run(&self) -> bool {
        self.seat.part().keeps_run() && !self.done.load(Ordering::SeqCst)
    }

    /// Its life has ended, for this reason: what it had under way is taken back.
    pub fn vacate(&self, why: &str) {
        *self.why.lock() = why.to_owned();
        if let Some(access) = self.access.lock().take() {
            access.revoke();
        }
    }

    /// It is not served any more.
    pub fn give_up(&self, shared: &SharedContext) {
        let (name, why) = (&self.name, self.why.lock().clone());
        let text = format!("service {name} has used up its restarts and is down: {why}");
        shared.tell(Event::Warning { text });
        shared.give_up_beside(name, why);
    }
}

/// The service's actor.
pub struct ServiceActor;

/// What it hears.
#[derive(Debug)]
pub enum ServiceMsg {
    /// The service has ended by itself: in order, or for a reason.
    Ended(Result<(), String>),
    /// See whether its runtime still moves.
    Look,
}

/// What it keeps.
pub struct Serving {
    shared: Arc<SharedContext>,
    post: Arc<Post>,
    /// Tells it to leave.
    leave: watch::Sender<bool>,
    /// Ready when it has left. Dropped with this, it ends the life at once.
    left: oneshot::Receiver<()>,
    beats: Arc<AtomicU64>,
    seen: u64,
    misses: u32,
}

impl Actor for ServiceActor {
    type Msg = ServiceMsg;
    type State = Serving;
    type Arguments = (Arc<SharedContext>, Arc<Post>);

    async fn pre_start(
        &self,
        myself: ActorRef<ServiceMsg>,
        (shared, post): Self::Arguments,
    ) -> Result<Serving, ActorProcessingErr> {
        let access = Arc::new(Access::new(&shared));
        *post.access.lock() = Some(access.clone());
        let (leave, until) = watch::channel(false);
        let (gone, left) = oneshot::channel();
        let beats = Arc::new(AtomicU64::new(0));
        let pause = post.begun.swap(true, Ordering::SeqCst).then_some(PAUSE);
        let life = Life { service: post.seat.part(), access, until, clock: shared.clock.clone(), pause };
        start(life, beats.clone(), myself.clone(), gone)?;
        myself.send_after(BEAT, || ServiceMsg::Look);
        Ok(Serving { shared, post, leave, left, beats, seen: 0, misses: 0 })
    }

    async fn handle(
        &self,
        myself: ActorRef<ServiceMsg>,
        message: ServiceMsg,
        serving: &mut Serving,
    ) -> Result<(), ActorProcessingErr> {
        match message {
            ServiceMsg::Ended(Ok(())) => {
                serving.post.seat.answered(serving.shared.clock.now());
                serving.post.done.store(true, Ordering::SeqCst);
                serving.shared.counts.lock().down.remove(serving.post.name());
                myself.stop(None);
            }
            ServiceMsg::Ended(Err(why)) => return Err(why.into()),
            ServiceMsg::Look => {
                let beats = serving.beats.load(Ordering::SeqCst);
                let moves = beats != serving.seen;
                serving.misses = if moves { 0 } else { serving.misses + 1 };
                serving.seen = beats;
                if moves {
                    serving.post.seat.answered(serving.shared.clock.now());
                }
                if beats >= SERVES {
                    serving.shared.counts.lock().down.remove(serving.post.name());
                }
                // one on probation has its budget, and a beat before and after
                let beats = |budget: Duration| u32::try_from(budget.as_secs()).unwrap_or(MISSES).saturating_add(2);
                let most = serving.post.seat.budget().map_or(MISSES, |budget| beats(budget).min(MISSES));
                if serving.misses >= most {
                    return Err(format!("its thread has been blocked for {} s", (BEAT * most).as_secs()).into());
                }
                myself.send_after(BEAT, || ServiceMsg::Look);
            }
        }
        Ok(())
    }

    /// A planned end: it leaves in order, or is left behind.
    async fn post_stop(&self, _: ActorRef<ServiceMsg>, serving: &mut Serving) -> Result<(), ActorProcessingErr> {
        let _ = serving.leave.send(true);
        if tokio::time::timeout(LEAVE + CLEAR, &mut serving.left).await.is_err() {
            let text = format!("service {} did not leave in time, and is left behind", serving.post.name());
            serving.shared.tell(Event::Warning { text });
        }
        serving.post.vacate("it was told to leave");
        Ok(())
    }
}

/// One life, about to begin.
struct Life {
    service: Arc<dyn Service>,
    access: Arc<Access>,
    until: watch::Receiver<bool>,
    clock: Clock,
    pause: Option<Duration>,
}

impl Life {
    /// From its start to its end.
    async fn live(self) -> Result<(), String> {
        let Life { service, access, mut until, clock, pause } = self;
        if let Some(pause) = pause {
            tokio::select! {
                biased;
                // an error means that nobody waits for it any more, which is an end as well
                _ = until.wait_for(|leave| *leave) => return Ok(()),
                () = clock.sleep(pause) => {}
            }
        }
        let leave = async move { drop(until.wait_for(|leave| *leave).await) };
        // a task of its own, so that its panic is a reason like others
        let served = tokio::spawn(async move { service.serve(access, Box::pin(leave)).await });
        let _end = AbortOnDrop(served.abort_handle());
        match served.await {
            Ok(ended) => ended,
            Err(e) if e.is_panic() => Err("it panicked".into()),
            Err(e) => Err(e.to_string()),
        }
    }
}

/// Begins a life: a thread of its own by a real clock, a task by a virtual one.
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
    let tell = move |(ended, gone): (Option<Result<(), String>>, oneshot::Sender<()>)| {
        // an error means that nobody waits for it any more
        let _ = gone.send(());
        if let Some(ended) = ended {
            let _ = myself.send_message(ServiceMsg::Ended(ended));
        }
    };
    if clock.kind() == ClockKind::Virtual {
        tokio::spawn(async move { tell(whole.await) });
        return Ok(());
    }
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    std::thread::Builder::new().name(name).spawn(move || {
        let ended = runtime.block_on(whole);
        // what the service left running ends before its successor begins
        runtime.shutdown_timeout(CLEAR);
        tell(ended);
    })?;
    Ok(())
}

/// A spawned task would outlive the one that waits for it.
struct AbortOnDrop(tokio::task::AbortHandle);

impl Drop for AbortOnDrop {
    fn drop(&mut self) {
        self.0.abort();
    }
}
