//! A running system: the start of its actors, the controls that it performs, and its end.

use super::exchange::{Beside, Exchanges};
use super::inject::inject;
use super::rest::{give_up, move_to_rest};
use super::restart::restart;
use super::run::wire;
use super::{Control, Reason, RestSetup, RunEnd, RunError, RunProgress, Setup, SystemReport, Troubles, tree};
use crate::attempt::{Timed, attempt};
use crate::clock::Clock;
use crate::shell::{CameraChannel, Sensor, ServiceSlot};
use crate::supervision::{Group, GroupMsg};
use crate::wiring::{AgentMsg, ModelMsg, RobotContext, SharedContext, SuperviseMsg, SwapRequest};
use mobee_contract::{Board, Event, Status, SwapPart, SwapStep, Time};
use ractor::ActorRef;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{mpsc, oneshot};

/// Interval of the checks whether the run has ended.
const TICK: Duration = Duration::from_millis(100);
/// Interval of the progress reports.
const PROGRESS_INTERVAL: Duration = Duration::from_secs(1);
/// Longest time for the robots to come to rest at the end.
const REST_TIMEOUT: Duration = Duration::from_secs(30);
/// Reason for which robots did not reach their rest poses after an abort.
const ABORTED: &str = "the run was stopped at once";
/// Time for which a robot without readings is waited for: no reading would show that it is at rest.
const BLIND_TIMEOUT: Duration = Duration::from_secs(2);

/// Controls of a run: those at given times, and those that arrive.
pub(super) struct RunControls {
    /// Controls at given times, in order: the faults of a simulation.
    pub planned: VecDeque<(Time, Control)>,
    /// Controls of operators and programs.
    pub arriving: mpsc::Receiver<Control>,
    /// Until the last sender is gone.
    pub listening: bool,
}

impl RunControls {
    /// Waits for the next control, until the time `wake` at the latest. One that arrives comes first.
    async fn next(&mut self, wake: Time, clock: &Clock) -> Option<Control> {
        let arrived = tokio::select! {
            biased;
            control = self.arriving.recv(), if self.listening => { self.listening = control.is_some(); control }
            () = clock.sleep_until(wake) => None,
        };
        let is_due = self.planned.front().is_some_and(|(at, _)| *at <= clock.now());
        if arrived.is_none() && is_due { self.planned.pop_front().map(|(_, control)| control) } else { arrived }
    }

    /// Completes when an abort is requested during the orderly end. Other requests are dropped: the run is ending.
    async fn abort_requested(&mut self) {
        loop {
            match self.arriving.recv().await {
                Some(Control::Abort) => return,
                Some(_) => {}
                None => std::future::pending().await,
            }
        }
    }
}

/// Groups of actors of a running system.
struct RunGroups {
    controller: ActorRef<GroupMsg>,
    agents: ActorRef<GroupMsg>,
    taps: ActorRef<GroupMsg>,
    services: Option<ActorRef<GroupMsg>>,
    sensors: Option<ActorRef<GroupMsg>>,
    /// Agents of robots that had none as the run began.
    added: Vec<ActorRef<GroupMsg>>,
}

impl RunGroups {
    /// Groups whose actors are listed, and can be killed.
    fn listed(&self) -> impl Iterator<Item = &ActorRef<GroupMsg>> {
        [&self.controller, &self.agents].into_iter().chain(&self.services).chain(&self.sensors).chain(&self.added)
    }

    /// Stops the groups, the journal last.
    async fn stop(&self) {
        let agents = self.sensors.iter().chain([&self.agents]).chain(&self.added);
        for group in agents.chain([&self.controller, &self.taps]) {
            let _ = ractor::call!(group, GroupMsg::Stop);
        }
    }
}

/// A running system.
pub(super) struct RunningSystem {
    shared: Arc<SharedContext>,
    groups: RunGroups,
    exchanges: Exchanges,
    sensors: Vec<Arc<Sensor>>,
    channels: Vec<Arc<CameraChannel>>,
    service_slots: Vec<Arc<ServiceSlot>>,
    /// Motions to the rest poses, in the order of the robots.
    rests: Vec<Option<RestSetup>>,
    /// Number of robots with an agent.
    acting: usize,
    /// True if the run ends once its agents are done.
    has_work: bool,
}

impl RunningSystem {
    /// Starts the actors. `safety`: runtime of the safety chain, if it has its own.
    ///
    /// # Errors
    /// If an actor or a sensor can't be started.
    pub async fn start(
        mut setup: Setup,
        boards: &[Board],
        safety: Option<tokio::runtime::Handle>,
        troubles: Option<Troubles>,
    ) -> Result<RunningSystem, RunError> {
        let clock = Clock::from(setup.clock, setup.past.as_ref().map_or(Time::ZERO, |p| p.at));
        let acting = setup.robots.iter().filter(|r| r.agent.is_some()).count();
        let service_slots = ServiceSlot::all(std::mem::take(&mut setup.services));
        let has_work = acting > 0 || service_slots.iter().any(|slot| slot.keeps_run());
        let sensors = std::mem::take(&mut setup.sensors);
        let rests = setup.robots.iter_mut().map(|robot| robot.rest.take()).collect();
        let truth = setup.truth.take();
        let looked_at = sensors.iter().filter(|s| s.is_simulated).flat_map(|s| s.tracked_objects().to_vec()).collect();
        let shared = wire(setup, boards, clock.clone(), troubles, looked_at);
        if let Some(truth) = truth {
            truth.begin(&shared);
        }
        let sensors = sensors.into_iter().map(|s| Sensor::new(s, &shared.robots, clock.now()).map(Arc::new));
        let sensors: Vec<Arc<Sensor>> = sensors.collect::<Result<_, _>>().map_err(RunError::Body)?;
        // From the start, agents have the objects that sensors track and have not seen yet.
        sensors.iter().flat_map(|s| &s.locator_slot).for_each(|locator_slot| locator_slot.publish_seen(&shared));
        let controller = begin(tree::controller(&shared), safety.as_ref()).await?;
        let agents = begin(tree::agents(&shared), None).await?;
        let taps = begin(tree::taps(&shared), None).await?;
        let services = match service_slots.is_empty() {
            true => None,
            false => Some(begin(tree::services(&shared, &service_slots), None).await?),
        };
        let seen = match sensors.is_empty() {
            true => None,
            false => Some(begin(tree::sensors(&shared, &sensors), None).await?),
        };
        let channels: Vec<Arc<CameraChannel>> = sensors.iter().flat_map(|s| s.channels.clone()).collect();
        let mut exchanges = Exchanges::new(&shared, &controller);
        exchanges.beside = Beside {
            services: services.clone(),
            service_slots: service_slots.clone(),
            channels: channels.clone(),
            locator_slots: sensors.iter().filter_map(|s| s.locator_slot.clone()).collect(),
        };
        let groups = RunGroups { controller, agents, taps, services, sensors: seen, added: Vec::new() };
        Ok(RunningSystem { shared, groups, exchanges, sensors, channels, service_slots, rests, acting, has_work })
    }

    /// Performs controls until the run ends, then ends it in order.
    pub async fn conduct(
        mut self,
        mut controls: RunControls,
        limit: Option<Duration>,
        mut progress: impl FnMut(&RunProgress),
    ) -> RunEnd {
        let limit = limit.map(|l| Time::ZERO + l);
        let (reason, is_aborted) = self.run(&mut controls, limit, &mut progress).await;
        tokio::select! {
            biased;
            () = self.end(reason, is_aborted) => {}
            () = controls.abort_requested() => {
                abandon(&self.shared).await;
                give_up(&self.shared, &self.rests, ABORTED);
                // The services through which an operator halts robots were still running.
                if self.rests.iter().any(Option::is_some) {
                    self.stop_services().await;
                }
            }
        }
        self.groups.stop().await;
        let shared = &self.shared;
        shared.robots.iter().for_each(|context| settle_ledger(shared, context));
        self.report_links();
        let counts = shared.counts.lock().clone();
        let ended_at = shared.clock.now();
        progress(&RunProgress { at: ended_at, counts: counts.clone() });
        let snapshots = shared.robots.iter().filter_map(|w| Some((w.name.clone(), w.snapshot.lock().clone()?)));
        let snapshots = snapshots.collect();
        let scene = shared.scene.lock().clone();
        RunEnd { reason, ended_at, counts, snapshots, scene }
    }

    /// Performs controls and scripted edits until there is a reason to end. Returns with it whether the run was
    /// aborted.
    async fn run(
        &mut self,
        controls: &mut RunControls,
        limit: Option<Time>,
        progress: &mut impl FnMut(&RunProgress),
    ) -> (Reason, bool) {
        let clock = self.shared.clock.clone();
        let mut last_progress = Time::ZERO;
        loop {
            let now = clock.now();
            let planned = controls.planned.front().map(|(at, _)| *at);
            let wakes = [Some(now + TICK), limit, self.shared.cues.lock().next_time(), planned];
            let wake = wakes.into_iter().flatten().min().unwrap_or(now);
            match controls.next(wake, &clock).await {
                Some(Control::Stop) => return (Reason::Interrupted, false),
                Some(Control::Abort) => {
                    abandon(&self.shared).await;
                    return (Reason::Interrupted, true);
                }
                Some(control) => self.perform(control).await,
                None => {}
            }
            let now = clock.now();
            let due = self.shared.cues.lock().time(now);
            for edit in due {
                self.shared.model.send(ModelMsg::Edit(edit, None));
            }
            if now >= last_progress + PROGRESS_INTERVAL {
                last_progress = now;
                let counts = self.shared.counts.lock().clone();
                progress(&RunProgress { at: now, counts });
            }
            if let Some(reason) = self.reason_to_end(now, limit) {
                return (reason, false);
            }
        }
    }

    /// Returns the reason to end, if there is one.
    fn reason_to_end(&self, now: Time, limit: Option<Time>) -> Option<Reason> {
        let shared = &self.shared;
        if shared.taps.failed().is_some() {
            return Some(Reason::NoJournal);
        }
        let (gave_up, done) = {
            let counts = shared.counts.lock();
            (counts.is_given_up, counts.done.len() >= self.acting)
        };
        if gave_up {
            return Some(Reason::GaveUp);
        }
        let must_continue = self.service_slots.iter().any(|slot| slot.keeps_run());
        if self.has_work && !must_continue && done && shared.robots.iter().all(|w| w.latest.lock().ready) {
            return Some(Reason::Done);
        }
        limit.is_some_and(|l| now >= l).then_some(Reason::Time)
    }

    /// Performs one control.
    async fn perform(&mut self, control: Control) {
        let shared = self.shared.clone();
        match control {
            // These end the run, which its loop does.
            Control::Stop | Control::Abort => {}
            Control::SwapAgent { robot, offer, reply } => self.swap_agent(&robot, offer, reply).await,
            Control::SwapPart { robot, offer, reply } => self.exchanges.begin(&robot, offer, reply),
            Control::SwapBeside { name, offer, reply } => {
                drop(reply.send(self.exchanges.begin_beside(&name, offer)));
            }
            Control::Restart { name, reply } => {
                let sensors = (&self.sensors[..], self.groups.sensors.as_ref());
                let services = (&self.service_slots[..], self.groups.services.as_ref());
                restart(&shared, sensors, services, name, reply);
            }
            Control::Edit(edit) => {
                shared.model.send(ModelMsg::Edit(edit, None));
            }
            Control::Kill(name) => self.kill(name).await,
            Control::Inject(injection) => inject(injection, &shared).await,
            Control::Recover(robot) => {
                for context in shared.robots.iter().filter(|w| w.name == robot) {
                    context.supervise.send(SuperviseMsg::Recover);
                }
            }
            Control::Halt(robot) => shared.robots.iter().filter(|w| w.name == robot).for_each(|w| w.halt()),
            Control::Release(robot) => {
                for context in shared.robots.iter().filter(|w| w.name == robot) {
                    context.release();
                }
            }
            Control::Status(reply) => {
                let mut all = Vec::new();
                for group in self.groups.listed() {
                    all.extend(ractor::call!(group, GroupMsg::Status));
                }
                let _ = reply.send(SystemReport::of(&shared, &self.sensors, all));
            }
        }
    }

    /// Kills an actor, as a fault would.
    async fn kill(&self, name: String) {
        self.shared.emit(Event::Injected { fault: format!("kill {name}") });
        let mut found = false;
        for group in self.groups.listed() {
            found = found || ractor::call!(group, GroupMsg::Kill, name.clone()).unwrap_or(false);
        }
        if !found {
            self.shared.emit(Event::Warning { text: format!("there is no actor {name} to kill") });
        }
    }

    /// Forwards an offer to the robot's agent; to a robot without one it adds the agent.
    async fn swap_agent(&mut self, robot: &str, offer: SwapRequest, reply: oneshot::Sender<Result<(), String>>) {
        let shared = self.shared.clone();
        match without_agent(&shared, robot) {
            None => forward_offer(&shared, robot, offer, reply),
            Some(context) => {
                let group = add_agent(&shared, &context, offer).await;
                if let Ok(group) = &group {
                    self.acting += 1;
                    self.has_work = true;
                    self.groups.added.push(group.clone());
                }
                let _ = reply.send(group.map(drop));
            }
        }
    }

    /// Ends the run in order: motions to the rest poses, no new motions, all robots at rest.
    async fn end(&mut self, reason: Reason, is_aborted: bool) {
        match reason {
            Reason::Interrupted if is_aborted => give_up(&self.shared, &self.rests, ABORTED),
            Reason::GaveUp => give_up(&self.shared, &self.rests, "a part used up its restarts"),
            Reason::NoJournal => give_up(&self.shared, &self.rests, "the journal can't be written"),
            Reason::Done | Reason::Time | Reason::Interrupted if self.rests.iter().any(Option::is_some) => {
                // External programs can start no more motions, but an operator can still halt the robots.
                let external = self.service_slots.iter().filter(|slot| slot.keeps_run());
                external.for_each(|slot| slot.vacate("the run ends"));
                self.exchanges.end().await;
                move_to_rest(&self.shared, &self.rests).await;
            }
            Reason::Done | Reason::Time | Reason::Interrupted => {}
        }
        self.stop_services().await;
        self.exchanges.end().await;
        come_to_rest(&self.shared).await;
    }

    async fn stop_services(&self) {
        if let Some(services) = &self.groups.services {
            let _ = ractor::call!(services, GroupMsg::Stop);
        }
    }

    /// Reports the load of the streams between the actors.
    fn report_links(&self) {
        let shared = &self.shared;
        for context in &shared.robots {
            let streams = [&context.to_history, &context.to_reflex, &context.to_supervise];
            streams.into_iter().for_each(|s| shared.emit(s.link()));
        }
        shared.emit(shared.to_model.link());
        self.channels.iter().flat_map(|channel| channel.links()).for_each(|link| shared.emit(link));
    }
}

/// Starts a group, on the safety chain's runtime if it is given.
async fn begin(group: Group, on: Option<&tokio::runtime::Handle>) -> Result<ActorRef<GroupMsg>, RunError> {
    let failed = |e: String| RunError::Start(e);
    match on {
        None => group.start(None).await.map_err(|e| failed(e.to_string())),
        Some(handle) => {
            let started = handle.spawn(async move { group.start(None).await.map_err(|e| e.to_string()) });
            started.await.map_err(|e| failed(e.to_string()))?.map_err(failed)
        }
    }
}

/// Returns the robot of this name, if it has no agent.
fn without_agent(shared: &SharedContext, robot: &str) -> Option<Arc<RobotContext>> {
    shared.robots.iter().find(|w| w.name == robot && w.slot.lock().maker.is_none()).cloned()
}

/// Adds an agent to a robot that has none. There is no old one to return to: the exchange is settled when it
/// starts.
///
/// # Errors
/// The reason why it can't be created or started; the robot then has no agent, as before.
async fn add_agent(
    shared: &Arc<SharedContext>,
    context: &Arc<RobotContext>,
    offer: SwapRequest,
) -> Result<ActorRef<GroupMsg>, String> {
    let SwapRequest { maker, what, terms, .. } = offer;
    let report = |step| shared.report_swap(context, SwapPart::Agent, step);
    let refused = |why: String| {
        context.slot.lock().maker = None;
        report(SwapStep::Refused { why: why.clone() });
        why
    };
    if !terms.shadow.is_zero() {
        return Err(refused("the robot has no agent beside which a new one could observe; omit --shadow".into()));
    }
    let made = maker.clone();
    let built =
        attempt(&shared.clock, terms.budget, move || Timed { value: (made.0)().map(drop), cost: Duration::ZERO });
    built.await.and_then(|built| built).map_err(refused)?;
    report(SwapStep::Offered { what, shadow: 0.0, probation: 0.0 });
    context.slot.lock().maker = Some(maker);
    let group = begin(tree::agent(shared, context), None).await.map_err(|e| refused(e.to_string()))?;
    report(SwapStep::TookOver { gap: 0.0, map: None });
    report(SwapStep::Settled);
    Ok(group)
}

/// Forwards an offer to the agent, and its answer back to the caller; the run continues in between.
fn forward_offer(shared: &SharedContext, robot: &str, offer: SwapRequest, reply: oneshot::Sender<Result<(), String>>) {
    let context = shared.robots.iter().find(|w| w.name == robot);
    let Some(context) = context.filter(|w| w.slot.lock().maker.is_some()) else {
        let _ = reply.send(Err(format!("there is no agent of a robot {robot} here")));
        return;
    };
    let (answer, answered) = ractor::concurrency::oneshot();
    context.agent.send(AgentMsg::Swap(offer, answer.into()));
    tokio::spawn(async move {
        let gone = || Err("the agent is being restarted; try again".into());
        let _ = reply.send(answered.await.unwrap_or_else(|_| gone()));
    });
}

/// Ends the run in order: no new motions, all robots at rest, every commit with its outcome (I17).
async fn come_to_rest(shared: &SharedContext) {
    let mut requested = Vec::new();
    for context in &shared.robots {
        context.agent.send(AgentMsg::Rest);
        requested.push(context.supervise.send(SuperviseMsg::Shutdown));
    }
    let clock = &shared.clock;
    let until = clock.now() + REST_TIMEOUT;
    let resting = |w: &Arc<RobotContext>| {
        let latest = w.latest.lock();
        latest.ready && matches!(latest.status, Status::Holding(_))
    };
    let begun = clock.now();
    let blind = |w: &Arc<RobotContext>| clock.now() > w.latest.lock().at.max(begun) + BLIND_TIMEOUT;
    let done = |(w, requested): (&Arc<RobotContext>, &bool)| !requested || resting(w) || blind(w);
    while clock.now() < until && !shared.robots.iter().zip(&requested).all(done) {
        clock.sleep(TICK / 5).await;
    }
    if !shared.robots.iter().all(resting) {
        abandon(shared).await;
    }
}

/// Ends without waiting: the boards are stopped, and open commits get their outcomes by the newest readings.
async fn abandon(shared: &SharedContext) {
    for context in &shared.robots {
        context.agent.send(AgentMsg::Rest);
        let (reply, done) = ractor::concurrency::oneshot();
        if context.supervise.send(SuperviseMsg::Abandon(reply.into())) {
            let _ = done.await;
        }
    }
}

/// Settles the commit that a failed controller left open, by its newest recorded configuration.
fn settle_ledger(shared: &SharedContext, context: &RobotContext) {
    let ended = {
        let mut book = context.ledger.book();
        book.last_known().and_then(|q| book.settle(None, q, context.rules().tolerance))
    };
    if let Some(ended) = ended {
        ended.events(context.name.clone()).into_iter().for_each(|event| shared.emit(event));
    }
}
