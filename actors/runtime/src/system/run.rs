//! The start of a run: its boards, its runtimes and its contexts.

use super::running::{RunControls, RunningSystem};
use super::{Control, Cues, RobotSetup, RunEnd, RunError, RunProgress, Setup, Troubles};
use crate::clock::{Clock, ClockKind, runtime};
use crate::load::Loads;
use crate::stream::Stream;
use crate::wiring::{ActorLink, HardwareHandle, LatestCell, Maker, Parts, PlannerSlot, RobotContext, SharedContext};
use mobee_contract::{Board, DriverFault, Event, Latest, Status, Time};
use mobee_controller::gate::Gate;
use mobee_controller::joint_retreat::JointRetreat;
use mobee_model::Contact;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64};
use std::time::Duration;
use tokio::sync::{mpsc, oneshot};

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
    let controls = RunControls { planned: faults.into(), arriving: controls, listening: true };
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
        return main.block_on(conduct(setup, boards, None, controls, limit, progress));
    }
    let safety = runtime(kind).map_err(start)?;
    let handle = safety.handle().clone();
    let (end, ended) = oneshot::channel::<()>();
    let thread = std::thread::Builder::new().name("safety".into()).spawn(move || {
        let _ = safety.block_on(ended);
    });
    let thread = thread.map_err(start)?;
    let result = main.block_on(conduct(setup, boards, Some(handle), controls, limit, progress));
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

/// Starts the system and runs it to its end.
async fn conduct(
    setup: Setup,
    boards: Vec<Board>,
    safety: Option<tokio::runtime::Handle>,
    controls: RunControls,
    limit: Option<Duration>,
    progress: impl FnMut(&RunProgress),
) -> Result<RunEnd, RunError> {
    let injects = controls.planned.iter().any(|(_, control)| matches!(control, Control::Inject(_)));
    let system = RunningSystem::start(setup, &boards, safety, injects.then(Troubles::default)).await?;
    Ok(system.conduct(controls, limit, progress).await)
}

/// Creates the contexts, and reports the description of the run.
pub(super) fn wire(
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
