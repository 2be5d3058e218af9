//! Processor time of each actor, including computations for it on other threads. Measured with a real clock
//! only: with a virtual one a run is the same on every machine.

use crate::clock::processor_time;
use ractor::{Actor, ActorProcessingErr, ActorRef, SupervisionEvent};
use std::collections::BTreeMap;
use std::future::poll_fn;
use std::pin::pin;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

tokio::task_local! {
    /// Load of the actor whose message is being handled.
    static OWN: Arc<Load>;
}

/// Total processor time.
#[derive(Debug, Default)]
pub struct Load(AtomicU64);

impl Load {
    /// Load of the calling actor; `None` outside of an actor, or with a virtual clock.
    pub(crate) fn own() -> Option<Arc<Load>> {
        OWN.try_with(Arc::clone).ok()
    }

    /// Runs `work` and adds the processor time that it takes on this thread.
    pub(crate) fn counts<T>(&self, work: impl FnOnce() -> T) -> T {
        let before = processor_time();
        let done = work();
        let cost = processor_time().saturating_sub(before);
        self.0.fetch_add(u64::try_from(cost.as_nanos()).unwrap_or(u64::MAX), Ordering::Relaxed);
        done
    }

    /// Processor time so far.
    pub fn busy(&self) -> Duration {
        Duration::from_nanos(self.0.load(Ordering::Relaxed))
    }
}

/// Loads of all actors, by name; a restarted actor continues with its own. Cheap to clone.
#[derive(Clone, Debug, Default)]
pub struct Loads(Arc<Mutex<BTreeMap<String, Arc<Load>>>>);

impl Loads {
    fn lock(&self) -> MutexGuard<'_, BTreeMap<String, Arc<Load>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Load of this actor.
    pub(crate) fn of(&self, actor: &str) -> Arc<Load> {
        self.lock().entry(actor.to_owned()).or_default().clone()
    }

    /// Processor time of each actor so far.
    pub fn busy(&self) -> BTreeMap<String, Duration> {
        self.lock().iter().map(|(name, load)| (name.clone(), load.busy())).collect()
    }
}

/// An actor whose processor time is measured: a wrapper that behaves like the inner actor.
pub struct Measured<A> {
    actor: A,
    load: Arc<Load>,
}

impl<A> Measured<A> {
    /// Wraps `actor`.
    pub fn new(actor: A, load: Arc<Load>) -> Measured<A> {
        Measured { actor, load }
    }
}

impl<A: Actor> Actor for Measured<A> {
    type Msg = A::Msg;
    type State = A::State;
    type Arguments = A::Arguments;

    async fn pre_start(
        &self,
        myself: ActorRef<A::Msg>,
        arguments: A::Arguments,
    ) -> Result<A::State, ActorProcessingErr> {
        self.actor.pre_start(myself, arguments).await
    }

    async fn handle(
        &self,
        myself: ActorRef<A::Msg>,
        message: A::Msg,
        state: &mut A::State,
    ) -> Result<(), ActorProcessingErr> {
        let mut work = pin!(OWN.scope(self.load.clone(), self.actor.handle(myself, message, state)));
        poll_fn(|cx| self.load.counts(|| work.as_mut().poll(cx))).await
    }

    async fn post_start(&self, myself: ActorRef<A::Msg>, state: &mut A::State) -> Result<(), ActorProcessingErr> {
        self.actor.post_start(myself, state).await
    }

    async fn post_stop(&self, myself: ActorRef<A::Msg>, state: &mut A::State) -> Result<(), ActorProcessingErr> {
        self.actor.post_stop(myself, state).await
    }

    async fn handle_supervisor_evt(
        &self,
        myself: ActorRef<A::Msg>,
        message: SupervisionEvent,
        state: &mut A::State,
    ) -> Result<(), ActorProcessingErr> {
        self.actor.handle_supervisor_evt(myself, message, state).await
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attempt::{Timed, attempt};
    use crate::clock::{Clock, ClockKind, runtime};

    const WORK: Duration = Duration::from_millis(5);

    fn works() {
        let begun = processor_time();
        while processor_time() < begun + WORK {}
    }

    /// An actor that works in place, waits, and lets another thread work.
    struct Worker;

    impl Actor for Worker {
        type Msg = bool;
        type State = Clock;
        type Arguments = Clock;

        async fn pre_start(&self, _: ActorRef<bool>, clock: Clock) -> Result<Clock, ActorProcessingErr> {
            Ok(clock)
        }

        async fn handle(
            &self,
            _: ActorRef<bool>,
            works_itself: bool,
            clock: &mut Clock,
        ) -> Result<(), ActorProcessingErr> {
            if works_itself {
                works();
                return Ok(());
            }
            let call = || Timed { value: works(), cost: Duration::ZERO };
            Ok(attempt(clock, Duration::from_secs(60), call).await?)
        }
    }

    #[test]
    fn what_an_actor_does_and_has_done_is_counted_and_what_it_waits_for_is_not() {
        let busy = |messages: &[bool]| {
            runtime(ClockKind::Real).unwrap().block_on(async {
                let (loads, clock) = (Loads::default(), Clock::new(ClockKind::Real));
                let worker = Measured::new(Worker, loads.of("worker"));
                let (actor, ended) = Actor::spawn(None, worker, clock).await.unwrap();
                messages.iter().for_each(|m| actor.cast(*m).unwrap());
                actor.drain().unwrap();
                ended.await.unwrap();
                loads.busy()["worker"]
            })
        };
        assert_eq!(busy(&[]), Duration::ZERO);
        let [itself, others, all] = [vec![true], vec![false], vec![true, false, true]].map(|messages| busy(&messages));
        assert!(itself >= WORK && others >= WORK && all >= WORK * 3, "{itself:?} {others:?} {all:?}");
        assert!(others < WORK * 2, "not counted twice: {others:?}");
    }
}
