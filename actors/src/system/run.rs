//! A run from its first event to its end.

use super::exchange::{Beside, Exchanges};
use super::inject::inject;
use super::rest::{give_up, move_to_rest};
use super::restart::restart;
use super::{Control, Cues, Reason, RobotSetup, RunEnd, RunError, RunProgress, Setup, SystemReport, Troubles, tree};
use crate::runtime::attempt::{Timed, attempt};
use crate::runtime::clock::{Clock, ClockKind, runtime};
use crate::runtime::load::Loads;
use crate::runtime::stream::Stream;
use crate::runtime::supervision::{Group, GroupMsg};
use crate::shell::{CameraChannel, Sensor, ServiceSlot};
use crate::wiring::{
    ActorLink, AgentMsg, HardwareHandle, LatestCell, Maker, ModelMsg, Parts, PlannerSlot, RobotContext, SharedContext,
    SuperviseMsg, SwapRequest,
};
use mobee_contract::{Board, DriverFault, Event, Latest, Status, SwapPart, SwapStep, Time};
use mobee_controller::gate::Gate;
use mobee_controller::joint_retreat::JointRetreat;
use mobee_model::Contact;
use ractor::ActorRef;
use std::collections::{BTreeSet, VecDeque};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64};
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

/// Runs the system until all agents are done, the limit has passed, a stop is requested, or a supervisor gives
/// up.
///
/// In real time the safety chain has its own thread and runtime; agents share the caller's.
///
/// # Errors
/// If it can't start; nothing has moved then.
pub fn run(
    setup: Setup,
    controls: mpsc::Receiver<Control>,
    limit: Option<Duration>,
    progress: impl FnMut(&RunProgress),
) -> Result<RunEnd, RunError> {
    run_under(setup, Vec::new(), controls, limit, progress)
}

/// [`run`] with controls at given times, in order: the faults of a simulation.
///
/// # Errors
/// As for [`run`].
pub fn run_under(
    setup: Setup,
    faults: Vec<(Time, Control)>,
    controls: mpsc::Receiver<Control>,
    limit: Option<Duration>,
    progress: impl FnMut(&RunProgress),
) -> Result<RunEnd, RunError> {
    let start = |e: std::io::Error| RunError::Start(e.to_string());
    let (boards, looked_at) = look(&setup)?;
    let in_scene = setup.scene.robots().len();
    let in_setup = setup.robots.len();
    if in_scene != in_setup {
        return Err(RunError::Robots { scene: in_scene, setup: in_setup });
    }
    let kind = setup.clock;
    if kind == ClockKind::Virtual
        && let Some(service) = setup.services.iter().find(|s| !s.runs_in_virtual_time())
    {
        return Err(RunError::VirtualService(service.name()));
    }
    let main = runtime(kind).map_err(start)?;
    for service in &setup.services {
        let models = setup.scene.robots().to_vec();
        let failed = |why| RunError::Service { name: service.name(), why };
        main.block_on(service.clone().prepare(models)).map_err(failed)?;
    }
    for robot in setup.robots.iter().zip(looked_at).filter_map(|(robot, looked_at)| looked_at.then_some(robot)) {
        robot.hardware.connect().map_err(|fault| unreached(robot, &fault))?;
    }
    if kind == ClockKind::Virtual {
        return main.block_on(conduct((setup, faults), boards, None, controls, limit, progress));
    }
    let safety = runtime(kind).map_err(start)?;
    let handle = safety.handle().clone();
    let (end, ended) = oneshot::channel::<()>();
    let thread = std::thread::Builder::new().name("safety".into()).spawn(move || {
        let _ = safety.block_on(ended);
    });
    let thread = thread.map_err(start)?;
    let result = main.block_on(conduct((setup, faults), boards, Some(handle), controls, limit, progress));
    drop(end);
    let _ = thread.join();
    result
}

/// Describes the boards of all robots. Returns with each whether it was only read so far: a robot receives no
/// command before everything that its run needs is available, because until then another program may move it.
fn look(setup: &Setup) -> Result<(Vec<Board>, Vec<bool>), RunError> {
    let boards = setup.robots.iter().zip(setup.scene.robots()).map(|(robot, model)| {
        if let Some(past) = &setup.past {
            robot.hardware.was_found(&past.robot(&robot.name).found);
        }
        let looked = robot.hardware.look();
        let looked_at = looked.is_some();
        let driver = looked.unwrap_or_else(|| robot.hardware.connect()).map_err(|fault| unreached(robot, &fault))?;
        let board = driver.board().clone();
        let n = board.axes.len();
        let m = model.motors.len();
        if n == m {
            Ok((board, looked_at))
        } else {
            Err(RunError::Board { robot: robot.name.clone(), board: n, model: m })
        }
    });
    boards.collect::<Result<Vec<_>, _>>().map(|boards| boards.into_iter().unzip())
}

fn unreached(robot: &RobotSetup, fault: &DriverFault) -> RunError {
    RunError::Connect { robot: robot.name.clone(), fault: fault.to_string() }
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

async fn conduct(
    (mut setup, faults): (Setup, Vec<(Time, Control)>),
    boards: Vec<Board>,
    safety: Option<tokio::runtime::Handle>,
    mut controls: mpsc::Receiver<Control>,
    limit: Option<Duration>,
    mut progress: impl FnMut(&RunProgress),
) -> Result<RunEnd, RunError> {
    let clock = Clock::from(setup.clock, setup.past.as_ref().map_or(Time::ZERO, |p| p.at));
    let mut acting = setup.robots.iter().filter(|r| r.agent.is_some()).count();
    let mut faults: VecDeque<(Time, Control)> = faults.into();
    let service_slots = ServiceSlot::all(std::mem::take(&mut setup.services));
    let must_continue = || service_slots.iter().any(|p| p.keeps_run());
    let mut has_work = acting > 0 || must_continue();
    let troubles = faults.iter().any(|(_, c)| matches!(c, Control::Inject(_))).then(Troubles::default);
    let sensors = std::mem::take(&mut setup.sensors);
    let rests: Vec<_> = setup.robots.iter_mut().map(|robot| robot.rest.take()).collect();
    let truth = setup.truth.take();
    let looked_at = sensors.iter().filter(|s| s.is_simulated).flat_map(|s| s.tracked_objects().to_vec()).collect();
    let shared = wire(setup, &boards, clock.clone(), troubles, looked_at);
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
    let mut added = Vec::new();
    let mut groups: Vec<_> = [&controller, &agents].into_iter().chain(&services).chain(&seen).cloned().collect();
    let mut exchanges = Exchanges::new(&shared, &controller);
    let channels: Vec<Arc<CameraChannel>> = sensors.iter().flat_map(|s| s.channels.clone()).collect();
    let locator_slots = sensors.iter().filter_map(|s| s.locator_slot.clone()).collect();
    exchanges.beside = Beside {
        services: services.clone(),
        service_slots: service_slots.clone(),
        channels: channels.clone(),
        locator_slots,
    };
    let limit = limit.map(|l| Time::ZERO + l);
    let mut last_progress = Time::ZERO;
    let mut listening = true;
    let mut is_aborted = false;
    let reason = loop {
        let now = clock.now();
        let planned = faults.front().map(|(at, _)| *at);
        let wakes = [Some(now + TICK), limit, shared.cues.lock().next_time(), planned];
        let wake = wakes.into_iter().flatten().min().unwrap_or(now);
        let mut control = tokio::select! {
            biased;
            control = controls.recv(), if listening => { listening = control.is_some(); control }
            () = clock.sleep_until(wake) => None,
        };
        if control.is_none() && planned.is_some_and(|at| at <= clock.now()) {
            control = faults.pop_front().map(|(_, control)| control);
        }
        match control {
            Some(Control::Stop) => break Reason::Interrupted,
            Some(Control::Abort) => {
                abandon(&shared).await;
                is_aborted = true;
                break Reason::Interrupted;
            }
            Some(Control::SwapAgent { robot, offer, reply }) => match without_agent(&shared, &robot) {
                None => swap_agent(&shared, &robot, offer, reply),
                Some(context) => {
                    let group = add_agent(&shared, &context, offer).await;
                    if let Ok(group) = &group {
                        acting += 1;
                        has_work = true;
                        added.push(group.clone());
                        groups.push(group.clone());
                    }
                    let _ = reply.send(group.map(drop));
                }
            },
            Some(Control::SwapPart { robot, offer, reply }) => exchanges.begin(&robot, offer, reply),
            Some(Control::SwapBeside { name, offer, reply }) => drop(reply.send(exchanges.begin_beside(&name, offer))),
            Some(Control::Restart { name, reply }) => {
                restart(&shared, (&sensors, seen.as_ref()), (&service_slots, services.as_ref()), name, reply);
            }
            Some(other) => obey(other, &shared, &groups, &sensors).await,
            None => {}
        }
        let now = clock.now();
        let due = shared.cues.lock().time(now);
        for edit in due {
            shared.model.send(ModelMsg::Edit(edit, None));
        }
        let counts = shared.counts.lock().clone();
        if now >= last_progress + PROGRESS_INTERVAL {
            last_progress = now;
            progress(&RunProgress { at: now, counts: counts.clone() });
        }
        if shared.taps.failed().is_some() {
            break Reason::NoJournal;
        }
        if counts.is_given_up {
            break Reason::GaveUp;
        }
        if has_work
            && !must_continue()
            && counts.done.len() >= acting
            && shared.robots.iter().all(|w| w.latest.lock().ready)
        {
            break Reason::Done;
        }
        if limit.is_some_and(|l| now >= l) {
            break Reason::Time;
        }
    };
    let in_order = async {
        match reason {
            Reason::Interrupted if is_aborted => give_up(&shared, &rests, ABORTED),
            Reason::GaveUp => give_up(&shared, &rests, "a part used up its restarts"),
            Reason::NoJournal => give_up(&shared, &rests, "the journal can't be written"),
            Reason::Done | Reason::Time | Reason::Interrupted if rests.iter().any(Option::is_some) => {
                // External programs can start no more motions, but an operator can still halt the robots.
                service_slots
                    .iter()
                    .filter(|service_slot| service_slot.keeps_run())
                    .for_each(|service_slot| service_slot.vacate("the run ends"));
                exchanges.end().await;
                move_to_rest(&shared, &rests).await;
            }
            Reason::Done | Reason::Time | Reason::Interrupted => {}
        }
        if let Some(services) = &services {
            let _ = ractor::call!(services, GroupMsg::Stop);
        }
        exchanges.end().await;
        come_to_rest(&shared).await;
    };
    tokio::select! {
        biased;
        () = in_order => {}
        () = abort_requested(&mut controls) => {
            abandon(&shared).await;
            give_up(&shared, &rests, ABORTED);
            // The services through which an operator halts robots were still running.
            if let Some(services) = services.as_ref().filter(|_| rests.iter().any(Option::is_some)) {
                let _ = ractor::call!(services, GroupMsg::Stop);
            }
        }
    }
    if let Some(seen) = &seen {
        let _ = ractor::call!(seen, GroupMsg::Stop);
    }
    let _ = ractor::call!(agents, GroupMsg::Stop);
    for group in &added {
        let _ = ractor::call!(group, GroupMsg::Stop);
    }
    let _ = ractor::call!(controller, GroupMsg::Stop);
    let _ = ractor::call!(taps, GroupMsg::Stop);
    shared.robots.iter().for_each(|w| settle_ledger(&shared, w));
    for context in &shared.robots {
        [&context.to_history, &context.to_reflex, &context.to_supervise]
            .into_iter()
            .for_each(|s| shared.emit(s.link()));
    }
    shared.emit(shared.to_model.link());
    channels.iter().flat_map(|channel| channel.links()).for_each(|link| shared.emit(link));
    let counts = shared.counts.lock().clone();
    progress(&RunProgress { at: clock.now(), counts: counts.clone() });
    let snapshots = shared.robots.iter().filter_map(|w| Some((w.name.clone(), w.snapshot.lock().clone()?)));
    let snapshots = snapshots.collect();
    let scene = shared.scene.lock().clone();
    Ok(RunEnd { reason, ended_at: clock.now(), counts, snapshots, scene })
}

/// Creates the contexts, and reports the description of the run.
fn wire(
    setup: Setup,
    boards: &[Board],
    clock: Clock,
    troubles: Option<Troubles>,
    looked_at: BTreeSet<String>,
) -> Arc<SharedContext> {
    let none: Arc<[Contact]> = Vec::new().into();
    let homes = setup.scene.home();
    let robots = setup.robots.iter().zip(boards).zip(setup.scene.robots()).enumerate();
    let robots = robots.map(|(i, ((robot, board), model))| {
        let plug = HardwareHandle(robot.hardware.clone());
        let parts = Parts::new(&robot.name, model.clone(), robot.controller.clone(), plug, board.clone());
        let stream = |link: &str| Stream::new(format!("{}/{link}", robot.name), 64);
        let q = homes.get(i).cloned().unwrap_or_else(|| Vec::new().into());
        let latest = Latest { at: Time::ZERO, q, contacts: none.clone(), status: Status::Starting, ready: false };
        let past = setup.past.as_ref().map(|p| p.robot(&robot.name)).unwrap_or_default();
        Arc::new(RobotContext {
            robot: i,
            name: robot.name.clone(),
            parts: LatestCell::new(parts),
            trial: LatestCell::default(),
            swaps: LatestCell::default(),
            gate: Arc::new(Gate::resumed(past.token)),
            ledger: past.ledger(robot.controller.history),
            lease: AtomicU64::new(0),
            latest: LatestCell::new(latest),
            answers: LatestCell::default(),
            hold_offsets: LatestCell::default(),
            to_history: stream("driver>history"),
            to_reflex: stream("model>reflex"),
            to_supervise: stream("reflex>supervise"),
            driver: ActorLink::default(),
            reflex: ActorLink::default(),
            supervise: ActorLink::default(),
            agent: ActorLink::default(),
            snapshot: LatestCell::new(None),
            slot: LatestCell::new(PlannerSlot { maker: robot.agent.clone().map(Maker), ..PlannerSlot::default() }),
            agent_name: format!("{}/agent", robot.name).into(),
            agent_acts: AtomicBool::new(true),
            can_recover: AtomicBool::new(false),
            notes: past.notes,
        })
    });
    let mut cues = Cues::new(setup.script);
    if let Some(past) = &setup.past {
        cues.skip(past.at, past.outcomes());
    }
    let robots = robots.collect();
    let scene = Arc::new(setup.scene);
    let shared = Arc::new(SharedContext {
        robots,
        joint_retreat: Arc::new(JointRetreat::new(&scene)),
        truth: LatestCell::new(scene.clone()),
        scene: LatestCell::new(scene),
        looked_at,
        seen: LatestCell::default(),
        to_model: Stream::new("history>model", 256),
        model: ActorLink::default(),
        loads: (clock.kind() == ClockKind::Real).then(Loads::default),
        clock,
        taps: setup.taps,
        counts: LatestCell::new(setup.past.as_ref().map(|p| p.counts.clone()).unwrap_or_default()),
        swaps_beside: LatestCell::default(),
        swapped_at: LatestCell::default(),
        cues: LatestCell::new(cues),
        troubles,
        none,
    });
    match setup.past {
        None => shared.emit(Event::Started { seed: setup.seed, clock: setup.clock.to_string(), config: setup.config }),
        Some(past) => shared.emit(Event::Resumed { events: past.events, config: Some(setup.config) }),
    }
    for context in &shared.robots {
        let parts = context.parts.lock().clone();
        let axes = parts.rules.axes.iter().zip(&parts.model.motors);
        let limits =
            axes.map(|(axis, motor)| (motor.name.as_str(), motor.motion, (motor.min, motor.max), (axis.min, axis.max)));
        if let Some(what) = mobee_contract::narrowed(limits) {
            let text = format!("{}: {what}; what is asked beyond is refused", context.name);
            shared.emit(Event::Warning { text });
        }
        parts.rules.described(&parts.model).into_iter().for_each(|event| shared.emit(event));
    }
    let scene = shared.scene.lock().clone();
    shared.taps.scene(shared.clock.now(), &scene);
    shared
}

async fn obey(control: Control, shared: &SharedContext, groups: &[ActorRef<GroupMsg>], sensors: &[Arc<Sensor>]) {
    match control {
        Control::Edit(edit) => {
            shared.model.send(ModelMsg::Edit(edit, None));
        }
        Control::Kill(name) => {
            shared.emit(Event::Injected { fault: format!("kill {name}") });
            let mut found = false;
            for group in groups {
                found = found || ractor::call!(group, GroupMsg::Kill, name.clone()).unwrap_or(false);
            }
            if !found {
                shared.emit(Event::Warning { text: format!("there is no actor {name} to kill") });
            }
        }
        Control::Inject(injection) => inject(injection, shared).await,
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
            for group in groups {
                all.extend(ractor::call!(group, GroupMsg::Status));
            }
            let _ = reply.send(SystemReport::of(shared, sensors, all));
        }
        Control::Stop
        | Control::Abort
        | Control::SwapAgent { .. }
        | Control::SwapPart { .. }
        | Control::SwapBeside { .. }
        | Control::Restart { .. } => {}
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
fn swap_agent(shared: &SharedContext, robot: &str, offer: SwapRequest, reply: oneshot::Sender<Result<(), String>>) {
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

/// Completes when an abort is requested during the orderly end. Other requests are dropped: the run is ending.
async fn abort_requested(controls: &mut mpsc::Receiver<Control>) {
    loop {
        match controls.recv().await {
            Some(Control::Abort) => return,
            Some(_) => {}
            None => std::future::pending().await,
        }
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
