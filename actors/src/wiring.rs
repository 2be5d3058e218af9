//! What connects a robot's actors, and outlives each of them: links, streams, latest values, and the messages that go through
//! them. Shells and system build on it, and it knows neither.

mod counts;
mod cues;
mod messages;
mod seat;
mod slot;
mod trouble;
mod truth;

pub use counts::{Late, RunCounts};
pub use cues::{CueTrigger, Cues, ScriptStep};
pub use messages::{AgentMsg, DriverMsg, ModelMsg, ReflexMsg, SuperviseMsg};
pub use seat::Seat;
pub use slot::{Maker, PlannerSlot, SwapRequest};
pub(crate) use trouble::Troubled;
pub use trouble::{Blow, Troubles};
pub use truth::TruthCell;

use crate::record::tap::Taps;
use crate::runtime::clock::Clock;
use crate::runtime::load::Loads;
use crate::runtime::stream::Stream;
use mobee_contract::{
    AnswerTime, Board, Event, Hardware, Latest, Note, SeenObject, Snapshot, SwapPart, SwapStep, Time, View,
};
use mobee_controller::gate::Gate;
use mobee_controller::joint_retreat::JointRetreat;
use mobee_controller::ledger::Ledger;
use mobee_controller::pulse::Pulse;
use mobee_controller::{ControllerSettings, RELEASE, Rules, Shared};
use mobee_model::{Contact, Pair, Robot, Scene};
use ractor::{ActorRef, Message};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, AtomicU64};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A latest value. A panic of its writer leaves it readable.
#[derive(Debug, Default)]
pub struct LatestCell<T>(Mutex<T>);

impl<T> LatestCell<T> {
    /// With a first value.
    pub fn new(value: T) -> LatestCell<T> {
        LatestCell(Mutex::new(value))
    }
    /// The value, locked for a moment.
    pub fn lock(&self) -> MutexGuard<'_, T> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A line to an actor: stays when the actor dies, and leads to its successor.
#[derive(Debug)]
pub struct ActorLink<M: Message>(LatestCell<Option<ActorRef<M>>>);

impl<M: Message> Default for ActorLink<M> {
    fn default() -> Self {
        ActorLink(LatestCell::new(None))
    }
}

impl<M: Message> ActorLink<M> {
    /// The actor is up.
    pub fn connect(&self, actor: ActorRef<M>) {
        *self.0.lock() = Some(actor);
    }
    /// Sends; `false` if nobody is there now.
    pub fn send(&self, message: M) -> bool {
        let actor = self.0.lock().clone();
        actor.is_some_and(|a| a.send_message(message).is_ok())
    }
}

/// What the actors of one robot share.
#[derive(Debug)]
pub struct RobotContext {
    /// Its index in the scene.
    pub robot: usize,
    /// Its name.
    pub name: String,
    /// What its controller runs with.
    pub parts: LatestCell<Parts>,
    /// A new controller or driver on probation.
    pub trial: LatestCell<Probation>,
    /// The last step of the exchange of each part that was ever exchanged.
    pub swaps: LatestCell<BTreeMap<SwapPart, SwapStep>>,
    /// Its gate.
    pub gate: Arc<Gate>,
    /// Its ledger.
    pub ledger: Ledger,
    /// Until when the driver may let the board move, as a time of the run, ns. Only supervise renews it.
    pub lease: AtomicU64,
    /// What its readers may know.
    pub latest: LatestCell<Latest>,
    /// How long its board took to answer of late.
    pub answers: LatestCell<Option<AnswerTime>>,
    /// The hold offset of each motor that has one, by its index, rad.
    pub hold_offsets: LatestCell<BTreeMap<usize, f64>>,
    /// The first three links of the pulse; the last is [`SharedContext::to_model`].
    pub to_history: Stream<Pulse>,
    /// See above.
    pub to_reflex: Stream<Pulse>,
    /// See above.
    pub to_supervise: Stream<Pulse>,
    /// Lines to its actors.
    pub driver: ActorLink<DriverMsg>,
    /// See above.
    pub reflex: ActorLink<ReflexMsg>,
    /// See above.
    pub supervise: ActorLink<SuperviseMsg>,
    /// See above.
    pub agent: ActorLink<AgentMsg>,
    /// The agent's newest state, for a successor.
    pub snapshot: LatestCell<Option<Snapshot>>,
    /// Who makes the agent, and how far its exchange is.
    pub slot: LatestCell<PlannerSlot>,
    /// The name of the agent's actor.
    pub agent_name: Arc<str>,
    /// Whether the agent may make motions, or makes way for another.
    pub agent_acts: AtomicBool,
    /// Whether there is a failed retreat that can be tried again.
    pub can_recover: AtomicBool,
    /// What an earlier process of this run noted of the agent's map.
    pub notes: Vec<Note>,
}

impl RobotContext {
    /// Hands a step of a core what the robot's actors share. The ledger is locked meanwhile, for no longer than the step takes.
    pub fn share<T>(&self, rules: &Rules, shared: &SharedContext, step: impl FnOnce(&mut Shared) -> T) -> T {
        let book = &mut *self.ledger.book();
        step(&mut Shared { rules, gate: &self.gate, book, joint_retreat: &shared.joint_retreat })
    }

    /// Stops the robot until [`RobotContext::release`]. The ledger has it first: from this moment no commit is accepted,
    /// even if supervise is being restarted.
    pub fn halt(&self) {
        self.ledger.book().halted = true;
        self.supervise.send(SuperviseMsg::Halt);
    }

    /// Lets a halted robot act again; supervise opens its filter by a fresh reading at rest. Whether it was halted.
    pub fn release(&self) -> bool {
        let halted = std::mem::take(&mut self.ledger.book().halted);
        // one that is being restarted begins with what the ledger has
        self.supervise.send(SuperviseMsg::Release);
        halted
    }

    /// Cancels what an agent has under way, since the agent died. The ledger has it first: a request that the agent sent before,
    /// and that waits for supervise, is not carried out (I18).
    pub fn agent_died(&self, agent: Arc<str>) {
        self.ledger.book().note_agent_death(&agent);
        self.supervise.send(SuperviseMsg::AgentDied(agent));
    }

    /// Its rules now: an exchange of controller or driver brings others.
    pub fn rules(&self) -> Arc<Rules> {
        self.parts.lock().rules.clone()
    }
}

/// What a robot's controller runs with. Exchanged as a whole, while none of its actors runs.
#[derive(Clone, Debug)]
pub struct Parts {
    /// Its controller's settings.
    pub controller: ControllerSettings,
    /// Its hardware.
    pub plug: HardwareHandle,
    /// What the board can do.
    pub board: Board,
    /// The robot's model.
    pub model: Arc<Robot>,
    /// What follows from all of these.
    pub rules: Arc<Rules>,
}

impl Parts {
    /// The parts of a robot of this name and model.
    pub fn new(
        robot: &str,
        model: Arc<Robot>,
        controller: ControllerSettings,
        plug: HardwareHandle,
        board: Board,
    ) -> Parts {
        let bodies = model.parts.iter().map(|p| p.name.clone()).collect();
        let rules = Rules::new(robot, bodies, &controller, &board);
        let rules = Arc::new(rules.driving(&controller, &model));
        Parts { controller, plug, board, model, rules }
    }

    /// The same with another controller.
    pub fn with_controller(&self, controller: ControllerSettings) -> Parts {
        Parts::new(&self.rules.robot, self.model.clone(), controller, self.plug.clone(), self.board.clone())
    }

    /// The same with another driver of its board.
    pub fn with_driver(&self, plug: HardwareHandle, board: Board) -> Parts {
        Parts::new(&self.rules.robot, self.model.clone(), self.controller.clone(), plug, board)
    }
}

/// The probation of a new controller or driver.
#[derive(Debug, Default)]
pub struct Probation {
    /// Whether one is being exchanged.
    pub busy: bool,
    /// What to return to, while the new part is on probation.
    pub old: Option<Parts>,
    /// Why the old parts were put back, and those that broke.
    pub broke: Option<(String, Parts)>,
}

/// What all robots share.
#[derive(Debug)]
pub struct SharedContext {
    /// The robots' contexts, in the scene's order.
    pub robots: Vec<Arc<RobotContext>>,
    /// The scene now.
    pub scene: LatestCell<Arc<Scene>>,
    /// What simulated cameras see: the scene as scripts and programs have made it, whatever the sensors believe.
    pub truth: LatestCell<Arc<Scene>>,
    /// The objects that sensors with simulated cameras keep.
    pub looked_at: BTreeSet<String>,
    /// How the objects that sensors keep were seen, sensor by sensor in the order of their names.
    pub seen: LatestCell<BTreeMap<String, Vec<SeenObject>>>,
    /// Robots that go back together.
    pub joint_retreat: Arc<JointRetreat>,
    /// The pulse of all robots into the model.
    pub to_model: Stream<(usize, Pulse)>,
    /// The line to the model.
    pub model: ActorLink<ModelMsg>,
    /// The clock.
    pub clock: Clock,
    /// Who is told.
    pub taps: Taps,
    /// What is counted.
    pub counts: LatestCell<RunCounts>,
    /// The last step of the exchange of each part beside the robots that was ever exchanged, by the name of what it is a part of.
    pub swaps_beside: LatestCell<BTreeMap<(String, SwapPart), SwapStep>>,
    /// When the last step of each exchange was taken, by the name of what the part is a part of.
    pub swapped_at: LatestCell<BTreeMap<(String, SwapPart), Time>>,
    /// Edits that wait for their moment.
    pub cues: LatestCell<Cues>,
    /// What is planned for its actors, in a simulation with faults.
    pub troubles: Option<Troubles>,
    /// How much its actors work; by a real clock.
    pub loads: Option<Loads>,
    /// An empty list of contacts, shared.
    pub none: Arc<[Contact]>,
}

impl SharedContext {
    /// The motors of a robot that brought together what touches.
    pub fn movers(&self, contacts: &[Contact], robot: usize) -> BTreeSet<usize> {
        let scene = self.scene.lock().clone();
        contacts.iter().flat_map(|contact| contact.movers(scene.robots(), robot)).collect()
    }

    /// What a robot's planner may know now.
    pub fn view(&self, context: &RobotContext) -> View {
        let latest = context.latest.lock().clone();
        let rules = context.rules();
        View {
            at: latest.at,
            robot: context.robot,
            axes: rules.axes.clone(),
            poses: self.robots.iter().map(|w| w.latest.lock().q.clone()).collect(),
            scene: self.scene.lock().clone(),
            contacts: latest.contacts,
            clearance: rules.margin + RELEASE,
            seen: self.seen.lock().values().flatten().cloned().collect(),
        }
    }

    /// Tells and counts an event.
    pub fn tell(&self, event: Event) {
        self.counts.lock().note(&event);
        self.taps.event(self.clock.now(), event);
    }

    /// Notes that a sensor or service has used up its restarts: the run goes on without it.
    pub fn give_up_beside(&self, name: &str, why: String) {
        let mut counts = self.counts.lock();
        counts.gave_up += 1;
        counts.down.insert(name.to_owned(), why);
    }

    /// The two shapes of a pair in words.
    pub fn names(&self, pair: Pair) -> (String, String) {
        let scene = self.scene.lock().clone();
        (scene.shape_name(pair.0), scene.shape_name(pair.1))
    }

    /// An actor of a robot's controller died: close the filter, and leave word for supervise.
    pub fn fence(&self, context: &RobotContext, actor: &str) {
        let token = context.gate.close();
        context.ledger.book().died = Some(actor.to_string());
        let (robot, cause) = (context.name.clone(), mobee_contract::Cause::ActorDied(actor.to_string()));
        self.tell(Event::Disabled { robot, token, cause });
    }

    /// Tells a step of an exchange, and keeps it for whoever asks.
    pub fn tell_swap(&self, context: &RobotContext, part: SwapPart, step: SwapStep) {
        let robot = context.name.clone();
        tracing::info!(robot, "swap of the {part}: {step}");
        context.swaps.lock().insert(part, step.clone());
        self.swapped_at.lock().insert((robot.clone(), part), self.clock.now());
        self.tell(Event::Swap { robot, part, step });
    }

    /// The same for a part that runs beside the robots.
    pub fn tell_beside(&self, name: &str, part: SwapPart, step: SwapStep) {
        tracing::info!(name, "swap of the {part}: {step}");
        let name = name.to_owned();
        self.swaps_beside.lock().insert((name.clone(), part), step.clone());
        self.swapped_at.lock().insert((name.clone(), part), self.clock.now());
        self.tell(Event::SwapBeside { name, part, step });
    }

    /// Puts other parts into a robot's controller, for the actors that are started from now on, and returns the ones before.
    pub fn install(&self, context: &RobotContext, parts: Parts) -> Parts {
        context.ledger.book().history.resize(parts.controller.history);
        let before = std::mem::replace(&mut *context.parts.lock(), parts);
        self.describe(context);
        self.model.send(ModelMsg::Margins);
        before
    }

    /// Emits the events that describe the parts which a robot's controller is started with.
    pub fn describe(&self, context: &RobotContext) {
        let parts = context.parts.lock().clone();
        parts.rules.described(&parts.model).into_iter().for_each(|event| self.tell(event));
    }

    /// A part of a robot's controller died: if a new one is on probation, that counts against it, and whoever is started
    /// from now on is started with the old parts. Returns whether they were put back now.
    pub fn count_against(&self, context: &RobotContext, why: &str) -> bool {
        let Some(old) = context.trial.lock().old.take() else { return false };
        let broken = self.install(context, old);
        context.trial.lock().broke = Some((why.to_owned(), broken));
        true
    }
}

/// A robot's hardware, as its driver actor connects to it.
#[derive(Clone)]
pub struct HardwareHandle(pub Arc<dyn Hardware>);

impl std::fmt::Debug for HardwareHandle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("HardwareHandle")
    }
}
