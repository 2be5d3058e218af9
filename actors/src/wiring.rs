//! What connects a robot's actors, and outlives each of them.

use crate::clock::Clock;
use crate::controller::Rules;
use crate::gate::Gate;
use crate::ledger::Ledger;
use crate::pulse::Pulse;
use crate::shell::{AgentMsg, DriverMsg, ModelMsg, ReflexMsg, Slot, SuperviseMsg};
use crate::stream::Stream;
use crate::system::{Counts, Cues, Troubles};
use crate::tap::Taps;
use mobee_contract::{Event, Hardware, Latest, Note, Snapshot};
use mobee_model::{Contact, Pair, Scene};
use ractor::{ActorRef, Message};
use std::sync::atomic::{AtomicBool, AtomicU64};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A latest value. A panic of its writer leaves it readable.
#[derive(Debug, Default)]
pub struct Cell<T>(Mutex<T>);

impl<T> Cell<T> {
    /// With a first value.
    pub fn new(value: T) -> Cell<T> {
        Cell(Mutex::new(value))
    }
    /// The value, locked for a moment.
    pub fn lock(&self) -> MutexGuard<'_, T> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A line to an actor: stays when the actor dies, and leads to its successor.
#[derive(Debug)]
pub struct Line<M: Message>(Cell<Option<ActorRef<M>>>);

impl<M: Message> Default for Line<M> {
    fn default() -> Self {
        Line(Cell::new(None))
    }
}

impl<M: Message> Line<M> {
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

/// One robot's wires.
#[derive(Debug)]
pub struct Wires {
    /// Its index in the scene.
    pub robot: usize,
    /// Its rules.
    pub rules: Arc<Rules>,
    /// Its gate.
    pub gate: Arc<Gate>,
    /// Its ledger.
    pub ledger: Ledger,
    /// Until when the driver may let the board move, as a time of the run, ns. Only supervise renews it.
    pub lease: AtomicU64,
    /// What its readers may know.
    pub latest: Cell<Latest>,
    /// The first three links of the pulse; the last is [`Hub::to_model`].
    pub to_history: Stream<Pulse>,
    /// See above.
    pub to_reflex: Stream<Pulse>,
    /// See above.
    pub to_supervise: Stream<Pulse>,
    /// Lines to its actors.
    pub driver: Line<DriverMsg>,
    /// See above.
    pub reflex: Line<ReflexMsg>,
    /// See above.
    pub supervise: Line<SuperviseMsg>,
    /// See above.
    pub agent: Line<AgentMsg>,
    /// The agent's newest state, for a successor.
    pub snapshot: Cell<Option<Snapshot>>,
    /// Who makes the agent, and how far its exchange is.
    pub slot: Cell<Slot>,
    /// The name of the agent's actor.
    pub agent_name: Arc<str>,
    /// Whether the agent may make motions, or makes way for another.
    pub agent_acts: AtomicBool,
    /// What an earlier process of this run noted of the agent's map.
    pub notes: Vec<Note>,
}

/// What all robots share.
#[derive(Debug)]
pub struct Hub {
    /// The robots' wires, in the scene's order.
    pub robots: Vec<Arc<Wires>>,
    /// The scene now.
    pub scene: Cell<Arc<Scene>>,
    /// The pulse of all robots into the model.
    pub to_model: Stream<(usize, Pulse)>,
    /// The line to the model.
    pub model: Line<ModelMsg>,
    /// The clock.
    pub clock: Clock,
    /// Who is told.
    pub taps: Taps,
    /// What is counted.
    pub counts: Cell<Counts>,
    /// Edits that wait for their moment.
    pub cues: Cell<Cues>,
    /// What is planned for its actors, in a simulation with faults.
    pub troubles: Option<Troubles>,
    /// An empty list of contacts, shared.
    pub none: Arc<[Contact]>,
}

impl Hub {
    /// Tells and counts an event.
    pub fn tell(&self, event: Event) {
        self.counts.lock().note(&event);
        self.taps.event(self.clock.now(), event);
    }

    /// The two shapes of a pair in words.
    pub fn names(&self, pair: Pair) -> (String, String) {
        let scene = self.scene.lock().clone();
        (scene.shape_name(pair.0), scene.shape_name(pair.1))
    }

    /// An actor of a robot's controller died: close the filter, and leave word for supervise.
    pub fn fence(&self, wires: &Wires, actor: &str) {
        let token = wires.gate.close();
        wires.ledger.book().died = Some(actor.to_string());
        let (robot, cause) = (wires.rules.robot.clone(), mobee_contract::Cause::ActorDied(actor.to_string()));
        self.tell(Event::Disabled { robot, token, cause });
    }
}

/// A robot's hardware, as its driver actor connects to it.
#[derive(Clone)]
pub struct Plug(pub Arc<dyn Hardware>);

impl std::fmt::Debug for Plug {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Plug")
    }
}
