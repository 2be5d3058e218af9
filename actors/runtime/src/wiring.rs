//! Connections between a robot's actors, which survive each of them: links, streams, latest values, and the
//! messages that pass through them. Shells and system build on this module; it depends on neither.

mod counts;
mod cues;
mod messages;
mod part_slot;
mod planner_slot;
mod trouble;
mod truth;

pub use counts::{Late, RunCounts};
pub use cues::{CueTrigger, Cues, ScriptStep};
pub use messages::{AgentMsg, DriverMsg, ModelMsg, ReflexMsg, SuperviseMsg};
pub use part_slot::PartSlot;
pub use planner_slot::{Maker, PlannerSlot, SwapRequest};
pub(crate) use trouble::Troubled;
pub use trouble::{Blow, Troubles};
pub use truth::TruthCell;

use crate::clock::Clock;
use crate::load::Loads;
use crate::stream::Stream;
use crate::tap::Taps;
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

/// A cell for a latest value. It stays readable after a panic of its writer.
#[derive(Debug, Default)]
pub struct LatestCell<T>(Mutex<T>);

impl<T> LatestCell<T> {
    /// Creates the cell with a first value.
    pub fn new(value: T) -> LatestCell<T> {
        LatestCell(Mutex::new(value))
    }
    /// Locks the value; hold the lock only briefly.
    pub fn lock(&self) -> MutexGuard<'_, T> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A link to an actor. It survives the actor's death and then leads to its successor.
#[derive(Debug)]
pub struct ActorLink<M: Message>(LatestCell<Option<ActorRef<M>>>);

impl<M: Message> Default for ActorLink<M> {
    fn default() -> Self {
        ActorLink(LatestCell::new(None))
    }
}

impl<M: Message> ActorLink<M> {
    /// Connects an actor that has started.
    pub fn connect(&self, actor: ActorRef<M>) {
        *self.0.lock() = Some(actor);
    }
    /// Sends a message; `false` if there is no actor now.
    pub fn send(&self, message: M) -> bool {
        let actor = self.0.lock().clone();
        actor.is_some_and(|a| a.send_message(message).is_ok())
    }
}

/// Shared state of one robot's actors.
#[derive(Debug)]
pub struct RobotContext {
    /// Index of the robot in the scene.
    pub robot: usize,
    /// Name of the robot.
    pub name: String,
    /// Settings and parts of its controller.
    pub parts: LatestCell<Parts>,
    /// A new controller or driver on probation.
    pub trial: LatestCell<Probation>,
    /// Last step of each part's exchange.
    pub swaps: LatestCell<BTreeMap<SwapPart, SwapStep>>,
    /// Gate of its filter.
    pub gate: Arc<Gate>,
    /// Ledger of its transactions.
    pub ledger: Ledger,
    /// Time of the run until which the driver may let the board move, ns. Only supervise renews it.
    pub lease: AtomicU64,
    /// Newest state of the robot, for all readers.
    pub latest: LatestCell<Latest>,
    /// Recent response times of its board.
    pub answers: LatestCell<Option<AnswerTime>>,
    /// Hold offset of each motor that has one, by its index, rad.
    pub hold_offsets: LatestCell<BTreeMap<usize, f64>>,
    /// The pulse from the driver to history. The link from history to the model is [`SharedContext::to_model`].
    pub to_history: Stream<Pulse>,
    /// The pulse from the model to the reflex.
    pub to_reflex: Stream<Pulse>,
    /// The pulse from the reflex to supervise.
    pub to_supervise: Stream<Pulse>,
    /// Link to the driver.
    pub driver: ActorLink<DriverMsg>,
    /// Link to the reflex.
    pub reflex: ActorLink<ReflexMsg>,
    /// Link to supervise.
    pub supervise: ActorLink<SuperviseMsg>,
    /// Link to the agent.
    pub agent: ActorLink<AgentMsg>,
    /// Newest state of the agent, for a successor.
    pub snapshot: LatestCell<Option<Snapshot>>,
    /// Maker of the agent, and the state of its exchange.
    pub slot: LatestCell<PlannerSlot>,
    /// Name of the agent's actor.
    pub agent_name: Arc<str>,
    /// True if the agent may make motions; if not, it yields to another client.
    pub agent_acts: AtomicBool,
    /// True if a failed retreat can be tried again.
    pub can_recover: AtomicBool,
    /// Notes on the agent's map from an earlier process of this run.
    pub notes: Vec<Note>,
}

impl RobotContext {
    /// Runs a step of a core with the shared state of the robot. The ledger is locked during the step.
    pub fn share<T>(&self, rules: &Rules, shared: &SharedContext, step: impl FnOnce(&mut Shared) -> T) -> T {
        let book = &mut *self.ledger.book();
        step(&mut Shared { rules, gate: &self.gate, book, joint_retreat: &shared.joint_retreat })
    }

    /// Stops the robot until [`RobotContext::release`]. The ledger is set first: from this moment no commit is
    /// accepted, even if supervise is being restarted.
    pub fn halt(&self) {
        self.ledger.book().halted = true;
        self.supervise.send(SuperviseMsg::Halt);
    }

    /// Lets a halted robot act again; supervise opens its filter after a fresh reading at rest. Returns true if
    /// it was halted.
    pub fn release(&self) -> bool {
        let halted = std::mem::take(&mut self.ledger.book().halted);
        // A supervise that is being restarted starts from the ledger.
        self.supervise.send(SuperviseMsg::Release);
        halted
    }

    /// Cancels the open motion of an agent that died. The ledger is set first: an earlier request of the agent
    /// that is still queued at supervise is not executed (I18).
    pub fn agent_died(&self, agent: Arc<str>) {
        self.ledger.book().note_agent_death(&agent);
        self.supervise.send(SuperviseMsg::AgentDied(agent));
    }

    /// Present parameters of its controller; an exchange of controller or driver replaces them.
    pub fn rules(&self) -> Arc<Rules> {
        self.parts.lock().rules.clone()
    }
}

/// Settings and parts of a robot's controller. They are exchanged together, while none of its actors runs.
#[derive(Clone, Debug)]
pub struct Parts {
    /// Settings of the controller.
    pub controller: ControllerSettings,
    /// The robot's hardware.
    pub plug: HardwareHandle,
    /// Description of the board.
    pub board: Board,
    /// Model of the robot.
    pub model: Arc<Robot>,
    /// Parameters derived from all of these.
    pub rules: Arc<Rules>,
}

impl Parts {
    /// Combines the parts of a robot with this name and model.
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

    /// Returns the same parts with another controller.
    pub fn with_controller(&self, controller: ControllerSettings) -> Parts {
        Parts::new(&self.rules.robot, self.model.clone(), controller, self.plug.clone(), self.board.clone())
    }

    /// Returns the same parts with another driver of the board.
    pub fn with_driver(&self, plug: HardwareHandle, board: Board) -> Parts {
        Parts::new(&self.rules.robot, self.model.clone(), self.controller.clone(), plug, board)
    }
}

/// Probation of a new controller or driver.
#[derive(Debug, Default)]
pub struct Probation {
    /// True if an exchange is under way.
    pub busy: bool,
    /// Previous parts, while the new part is on probation.
    pub old: Option<Parts>,
    /// Reason for which the old parts were put back, and the parts that failed.
    pub broke: Option<(String, Parts)>,
}

/// Shared state of all robots.
#[derive(Debug)]
pub struct SharedContext {
    /// Contexts of the robots, in the scene's order.
    pub robots: Vec<Arc<RobotContext>>,
    /// The present scene of the model.
    pub scene: LatestCell<Arc<Scene>>,
    /// Scene that simulated cameras see: it includes all edits of scripts and programs, whether or not a sensor
    /// has seen them.
    pub truth: LatestCell<Arc<Scene>>,
    /// Objects that sensors with simulated cameras track.
    pub looked_at: BTreeSet<String>,
    /// State of the objects that sensors track, by the sensors' names.
    pub seen: LatestCell<BTreeMap<String, Vec<SeenObject>>>,
    /// Joint retreats of several robots.
    pub joint_retreat: Arc<JointRetreat>,
    /// The pulse of all robots from history to the model.
    pub to_model: Stream<(usize, Pulse)>,
    /// Link to the model.
    pub model: ActorLink<ModelMsg>,
    /// Clock of the run.
    pub clock: Clock,
    /// Taps of the run.
    pub taps: Taps,
    /// Counters of the run.
    pub counts: LatestCell<RunCounts>,
    /// Last step of each exchange beside the robots, by the name of the owner and the part.
    pub swaps_beside: LatestCell<BTreeMap<(String, SwapPart), SwapStep>>,
    /// Time of the last step of each exchange, by the name of the owner and the part.
    pub swapped_at: LatestCell<BTreeMap<(String, SwapPart), Time>>,
    /// Edits that wait for their trigger.
    pub cues: LatestCell<Cues>,
    /// Faults that are planned for its actors, in a simulation with faults.
    pub troubles: Option<Troubles>,
    /// Processor time of its actors; with a real clock only.
    pub loads: Option<Loads>,
    /// An empty list of contacts, shared.
    pub none: Arc<[Contact]>,
}

impl SharedContext {
    /// Motors of a robot whose motion can have caused these contacts.
    pub fn movers(&self, contacts: &[Contact], robot: usize) -> BTreeSet<usize> {
        let scene = self.scene.lock().clone();
        contacts.iter().flat_map(|contact| contact.movers(scene.robots(), robot)).collect()
    }

    /// Present view for a robot's planner.
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

    /// Emits and counts an event.
    pub fn emit(&self, event: Event) {
        self.counts.lock().note(&event);
        self.taps.event(self.clock.now(), event);
    }

    /// Records that a sensor or service has used up its restarts: the run continues without it.
    pub fn give_up_beside(&self, name: &str, why: String) {
        let mut counts = self.counts.lock();
        counts.gave_up += 1;
        counts.down.insert(name.to_owned(), why);
    }

    /// Names of the two shapes of a pair.
    pub fn names(&self, pair: Pair) -> (String, String) {
        let scene = self.scene.lock().clone();
        (scene.shape_name(pair.0), scene.shape_name(pair.1))
    }

    /// Closes the filter after the death of an actor of a robot's controller, and leaves the cause in the
    /// ledger for supervise.
    pub fn fence(&self, context: &RobotContext, actor: &str) {
        let token = context.gate.close();
        context.ledger.book().died = Some(actor.to_string());
        let robot = context.name.clone();
        let cause = mobee_contract::Cause::ActorDied(actor.to_string());
        self.emit(Event::Disabled { robot, token, cause });
    }

    /// Emits a step of an exchange, and stores it for status reports.
    pub fn report_swap(&self, context: &RobotContext, part: SwapPart, step: SwapStep) {
        let robot = context.name.clone();
        tracing::info!(robot, "swap of the {part}: {step}");
        context.swaps.lock().insert(part, step.clone());
        self.swapped_at.lock().insert((robot.clone(), part), self.clock.now());
        self.emit(Event::Swap { robot, part, step });
    }

    /// The same for a part beside the robots.
    pub fn report_swap_beside(&self, name: &str, part: SwapPart, step: SwapStep) {
        tracing::info!(name, "swap of the {part}: {step}");
        let name = name.to_owned();
        self.swaps_beside.lock().insert((name.clone(), part), step.clone());
        self.swapped_at.lock().insert((name.clone(), part), self.clock.now());
        self.emit(Event::SwapBeside { name, part, step });
    }

    /// Replaces the parts of a robot's controller, for the actors that are started from now on, and returns the
    /// previous ones.
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
        parts.rules.described(&parts.model).into_iter().for_each(|event| self.emit(event));
    }

    /// Counts a death in a robot's controller against a new part on probation: actors that are started from now
    /// on use the old parts. Returns true if the old parts were put back now.
    pub fn count_against(&self, context: &RobotContext, why: &str) -> bool {
        let Some(old) = context.trial.lock().old.take() else { return false };
        let broken = self.install(context, old);
        context.trial.lock().broke = Some((why.to_owned(), broken));
        true
    }
}

/// Hardware of a robot, for its driver actor.
#[derive(Clone)]
pub struct HardwareHandle(pub Arc<dyn Hardware>);

impl std::fmt::Debug for HardwareHandle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("HardwareHandle")
    }
}
