//! A run from its first event to its end.

use super::exchange::{Beside, Exchanges};
use super::inject::inject;
use super::rest::{give_up, move_to_rest};
use super::restart::restart;
use super::{Control, Cues, Reason, RobotSetup, RunEnd, RunError, RunProgress, Setup, SystemReport, Troubles, tree};
use crate::runtime::attempt::{Given, attempt};
use crate::runtime::clock::{Clock, ClockKind, runtime};
use crate::runtime::load::Loads;
use crate::runtime::stream::Stream;
use crate::runtime::supervision::{Group, GroupMsg};
use crate::shell::{Eye, Post, Sensor};
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

/// How often the run looks whether it has ended.
const TICK: Duration = Duration::from_millis(100);
/// How often it tells its progress.
const TELL: Duration = Duration::from_secs(1);
/// How long robots may take to come to rest at the end.
const PATIENCE: Duration = Duration::from_secs(30);
/// Why robots are not moved to their rest poses, or not to their end.
const ABORTED: &str = "the run was stopped at once";
/// How long a robot without readings is waited for: nothing would show that it rests.
const BLIND: Duration = Duration::from_secs(2);

/// Runs the system until all agents are done, the limit has passed, it is told to stop, or it gives up.
///
/// In real time the safety chain has a thread and a runtime of its own; agents share the caller's.
///
/// # Errors
/// If it can't begin; nothing has moved then.
pub fn run(
    setup: Setup,
    controls: mpsc::Receiver<Control>,
    limit: Option<Duration>,
    progress: impl FnMut(&RunProgress),
) -> Result<RunEnd, RunError> {
    run_under(setup, Vec::new(), controls, limit, progress)
}

/// [`run`] with controls at set times, in order: the faults of a simulation.
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
    let (in_scene, in_setup) = (setup.scene.robots().len(), setup.robots.len());
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

/// Describes the boards of all robots, and says of which nothing but readings was asked yet: nothing is sent to a robot
/// before all that its run needs is there, since until then another program may move it.
fn look(setup: &Setup) -> Result<(Vec<Board>, Vec<bool>), RunError> {
    let boards = setup.robots.iter().zip(setup.scene.robots()).map(|(robot, model)| {
        if let Some(past) = &setup.past {
            robot.hardware.was_found(&past.robot(&robot.name).found);
        }
        let looked = robot.hardware.look();
        let looked_at = looked.is_some();
        let driver = looked.unwrap_or_else(|| robot.hardware.connect()).map_err(|fault| unreached(robot, &fault))?;
        let board = driver.board().clone();
        let (n, m) = (board.axes.len(), model.motors.len());
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

/// Starts a group, on the safety chain's runtime if it has one.
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
    let posts = Post::all(std::mem::take(&mut setup.services));
    let is_kept = || posts.iter().any(|p| p.keeps_run());
    let mut somebody = acting > 0 || is_kept();
    let troubles = faults.iter().any(|(_, c)| matches!(c, Control::Inject(_))).then(Troubles::default);
    let sensors = std::mem::take(&mut setup.sensors);
    let rests: Vec<_> = setup.robots.iter_mut().map(|robot| robot.rest.take()).collect();
    let truth = setup.truth.take();
    let looked_at = sensors.iter().filter(|s| s.is_simulated).flat_map(|s| s.keeps().to_vec()).collect();
    let shared = wire(setup, &boards, clock.clone(), troubles, looked_at);
    if let Some(truth) = truth {
        truth.begin(&shared);
    }
    let sensors = sensors.into_iter().map(|s| Sensor::new(s, &shared.robots, clock.now()).map(Arc::new));
    let sensors: Vec<Arc<Sensor>> = sensors.collect::<Result<_, _>>().map_err(RunError::Body)?;
    // agents know from the first what is kept by sensors and not seen yet
    sensors.iter().flat_map(|s| &s.placing).for_each(|placing| placing.show_seen(&shared));
    let controller = begin(tree::controller(&shared), safety.as_ref()).await?;
    let agents = begin(tree::agents(&shared), None).await?;
    let taps = begin(tree::taps(&shared), None).await?;
    let services = match posts.is_empty() {
        true => None,
        false => Some(begin(tree::services(&shared, &posts), None).await?),
    };

    let seen = match sensors.is_empty() {
        true => None,
        false => Some(begin(tree::sensors(&shared, &sensors), None).await?),
    };
    let mut added = Vec::new();
    let mut groups: Vec<_> = [&controller, &agents].into_iter().chain(&services).chain(&seen).cloned().collect();
    let mut exchanges = Exchanges::new(&shared, &controller);
    let eyes: Vec<Arc<Eye>> = sensors.iter().flat_map(|s| s.eyes.clone()).collect();
    let placings = sensors.iter().filter_map(|s| s.placing.clone()).collect();
    exchanges.beside = Beside { services: services.clone(), posts: posts.clone(), eyes: eyes.clone(), placings };
    let limit = limit.map(|l| Time::ZERO + l);
    let mut told = Time::ZERO;
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
                        (acting, somebody) = (acting + 1, true);
                        added.push(group.clone());
                        groups.push(group.clone());
                    }
                    let _ = reply.send(group.map(drop));
                }
            },
            Some(Control::SwapPart { robot, offer, reply }) => exchanges.begin(&robot, offer, reply),
            Some(Control::SwapBeside { name, offer, reply }) => drop(reply.send(exchanges.begin_beside(&name, offer))),
            Some(Control::Restart { name, reply }) => {
                restart(&shared, (&sensors, seen.as_ref()), (&posts, services.as_ref()), name, reply);
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
        if now >= told + TELL {
            told = now;
            progress(&RunProgress { at: now, counts: counts.clone() });
        }
        if shared.taps.failed().is_some() {
            break Reason::NoJournal;
        }
        if counts.is_given_up {
            break Reason::GaveUp;
        }
        if somebody && !is_kept() && counts.done.len() >= acting && shared.robots.iter().all(|w| w.latest.lock().ready)
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
                // programs outside begin no more motions, but an operator can still halt the robots
                posts.iter().filter(|post| post.keeps_run()).for_each(|post| post.vacate("the run ends"));
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
        () = told_to_abort(&mut controls) => {
            abandon(&shared).await;
            give_up(&shared, &rests, ABORTED);
            // those that an operator halts robots through had gone on
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
            .for_each(|s| shared.tell(s.link()));
    }
    shared.tell(shared.to_model.link());
    eyes.iter().flat_map(|eye| eye.links()).for_each(|link| shared.tell(link));
    let counts = shared.counts.lock().clone();
    progress(&RunProgress { at: clock.now(), counts: counts.clone() });
    let snapshots = shared.robots.iter().filter_map(|w| Some((w.name.clone(), w.snapshot.lock().clone()?)));
    let snapshots = snapshots.collect();
    let scene = shared.scene.lock().clone();
    Ok(RunEnd { reason, ended_at: clock.now(), counts, snapshots, scene })
}

/// Makes the contexts, and tells what is run.
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
        None => shared.tell(Event::Started { seed: setup.seed, clock: setup.clock.to_string(), config: setup.config }),
        Some(past) => shared.tell(Event::Resumed { events: past.events, config: Some(setup.config) }),
    }
    for context in &shared.robots {
        let parts = context.parts.lock().clone();
        let axes = parts.rules.axes.iter().zip(&parts.model.motors);
        let limits =
            axes.map(|(axis, motor)| (motor.name.as_str(), motor.motion, (motor.min, motor.max), (axis.min, axis.max)));
        if let Some(what) = mobee_contract::narrowed(limits) {
            let text = format!("{}: {what}; what is asked beyond is refused", context.name);
            shared.tell(Event::Warning { text });
        }
        parts.rules.described(&parts.model).into_iter().for_each(|event| shared.tell(event));
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
            shared.tell(Event::Injected { fault: format!("kill {name}") });
            let mut found = false;
            for group in groups {
                found = found || ractor::call!(group, GroupMsg::Kill, name.clone()).unwrap_or(false);
            }
            if !found {
                shared.tell(Event::Warning { text: format!("there is no actor {name} to kill") });
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

/// The robot of this name, if it has no agent.
fn without_agent(shared: &SharedContext, robot: &str) -> Option<Arc<RobotContext>> {
    shared.robots.iter().find(|w| w.name == robot && w.slot.lock().maker.is_none()).cloned()
}

/// Gives an agent to a robot that has none. There is no old one that could return: it is settled as it starts.
///
/// # Errors
/// Why it can't be made or started; the robot has none then, as before.
async fn add_agent(
    shared: &Arc<SharedContext>,
    context: &Arc<RobotContext>,
    offer: SwapRequest,
) -> Result<ActorRef<GroupMsg>, String> {
    let SwapRequest { maker, what, terms, .. } = offer;
    let tell = |step| shared.tell_swap(context, SwapPart::Agent, step);
    let refused = |why: String| {
        context.slot.lock().maker = None;
        tell(SwapStep::Refused { why: why.clone() });
        why
    };
    if !terms.shadow.is_zero() {
        return Err(refused("the robot has no agent beside which a new one could observe; omit --shadow".into()));
    }
    let made = maker.clone();
    let built =
        attempt(&shared.clock, terms.budget, move || Given { value: (made.0)().map(drop), cost: Duration::ZERO });
    built.await.and_then(|built| built).map_err(refused)?;
    tell(SwapStep::Offered { what, shadow: 0.0, probation: 0.0 });
    context.slot.lock().maker = Some(maker);
    let group = begin(tree::agent(shared, context), None).await.map_err(|e| refused(e.to_string()))?;
    tell(SwapStep::TookOver { gap: 0.0, map: None });
    tell(SwapStep::Settled);
    Ok(group)
}

/// Passes an offer on, and its answer back when there is one; the run goes on meanwhile.
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

/// The orderly end: no new motions, all robots at rest, every commit with its outcome (I17).
async fn come_to_rest(shared: &SharedContext) {
    let mut asked = Vec::new();
    for context in &shared.robots {
        context.agent.send(AgentMsg::Rest);
        asked.push(context.supervise.send(SuperviseMsg::Shutdown));
    }
    let clock = &shared.clock;
    let until = clock.now() + PATIENCE;
    let resting = |w: &Arc<RobotContext>| {
        let latest = w.latest.lock();
        latest.ready && matches!(latest.status, Status::Holding(_))
    };
    let begun = clock.now();
    let blind = |w: &Arc<RobotContext>| clock.now() > w.latest.lock().at.max(begun) + BLIND;
    let done = |(w, asked): (&Arc<RobotContext>, &bool)| !asked || resting(w) || blind(w);
    while clock.now() < until && !shared.robots.iter().zip(&asked).all(done) {
        clock.sleep(TICK / 5).await;
    }
    if !shared.robots.iter().all(resting) {
        abandon(shared).await;
    }
}

/// Ready when somebody does not want to wait for the orderly end. Other wishes are too late: who asks finds the run ending.
async fn told_to_abort(controls: &mut mpsc::Receiver<Control>) {
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

/// What a controller that stayed down left open is settled by its newest recorded pose.
fn settle_ledger(shared: &SharedContext, context: &RobotContext) {
    let ended = {
        let mut book = context.ledger.book();
        book.last_known().and_then(|q| book.settle(None, q, context.rules().tolerance))
    };
    if let Some(ended) = ended {
        ended.events(context.name.clone()).into_iter().for_each(|event| shared.tell(event));
    }
}
