//! A robot behind YARP: its control boards as one board, in radians and the model's order of motors.
//!
//! ```text
//! drivers (one per life of a driver actor)          two threads, which outlive them and watch each other
//!   command ──checked──> a bounded queue per board ──> Hand ──> RemoteBoard ──> the robot
//!   stop ──────────────> at once ────────────────────> Brake ──> a line of its own ──> the robot
//!   lease ─────────────> watched beside the brakes: at its end everything stops
//!   sample <───────────── Cell: newest of all boards <── Arrivals <── state streams
//! services: questions ──> Questions, a line per board that is worked by the asker itself ──> the robot
//! ```
//! * Every new connection to a board begins with a stop; nothing that was told before it counts any more (F11).
//! * References and modes of a board are given back as they were found, when its joints rest and at the end (`found.rs`).
//! * A board that falls silent gives no readings; one that is gone is [`mobee_contract::DriverFault::Lost`] until it is back.
//! * While another program holds our port names, nothing is written, and the fault says so (F13).
//! * A stop never waits for the answer to something else, and is said again until the readings show it. If anybody dies who could
//!   stop the robot, whoever is left stops it, and it is not used until all are back.
//! * A board that answers within no more than `latency_ms` is told of by [`mobee_contract::Driver::answer_time`]; the filter opens under no other.
//! * Degrees and joint order of YARP exist here and nowhere else.
//! * All of it also runs in virtual time on one thread, against simulated boards behind simulated wires (`sim.rs`).

mod answers;
mod brake;
mod cell;
mod check;
mod clock;
mod crew;
#[cfg(test)]
mod deaths;
mod driver;
mod encoder;
mod fan;
mod found;
mod gauge;
mod hand;
mod layout;
mod legs;
mod motion;
mod pace;
mod questions;
mod remote;
mod settings;
mod sim;
mod states;
mod thread;

pub use driver::YarpDriver;
pub use encoder::Encoder;
pub use layout::{disagreement, joint_kind};
pub use settings::{Moves, PartSettings, YarpDriverSettings};
pub use sim::{Who, WireFault, YarpSim};

pub(crate) use cell::instant;
use cell::{SharedBoards, Trouble};
use driver::Reach;
use layout::Layout;
use mobee_contract::{
    Answer, AsFound, Context, Driver, DriverFault, Hardware, Kind, KindError, Known, NativeMessage, NativeState, Paces,
    Registered,
};
use mobee_model::Robot;
use mobee_yarp::config::{self, Env};
use mobee_yarp::{Bottle, Dialect, Network, Value, Vocab};
use questions::Questions;
use remote::Wire;
use serde_json::Value as Json;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use thread::Place;

/// The name of this kind in configuration files.
pub const YARP: &str = "yarp";

inventory::submit! {
    Registered(&Kind::<dyn Hardware> {
        name: YARP,
        doc: "A real robot, or a simulator in another process, behind YARP control boards: one board per part, over any YARP network, in real time. \
              Motions are position moves with an individual speed per joint; the retreat streams position-direct set-points. States come from \
              `stateExt:o` or `state:o`. It stops the robot when its lease expires, and before anything else when a board returns.",
        schema: || schemars::schema_for!(YarpDriverSettings),
        example: |_| Err("it needs a robot, or its simulator, behind YARP"),
        build: |settings, context| Ok(Arc::new(YarpHardware::build(settings, context)?)),
    })
}

/// A robot behind YARP. Its threads begin with the first connection and live as long as this does, whatever happens to drivers.
pub struct YarpHardware {
    settings: YarpDriverSettings,
    robot: String,
    layout: Arc<Layout>,
    network: Option<Network>,
    /// What takes the place of a network in a simulation.
    simulated: Option<Arc<dyn Wire>>,
    started: Mutex<Option<Started>>,
    /// How the motors were found by an earlier process, or by threads that died.
    inherited: Mutex<Vec<AsFound>>,
}

/// What there is once the thread runs.
struct Started {
    reach: Reach,
    questions: Vec<Questions>,
    thread: thread::Threads,
}

impl YarpHardware {
    /// From the settings in a config file.
    ///
    /// # Errors
    /// The first setting that can't be used.
    pub fn build(settings: &Json, context: &Context) -> Result<YarpHardware, KindError> {
        let settings: YarpDriverSettings = mobee_contract::settings(settings)?;
        YarpHardware::new(&settings, &context.robot)
    }

    /// The boards of this robot. Nothing is opened or asked before the first connection: a file can be checked while another program
    /// drives its robot.
    ///
    /// # Errors
    /// The first setting that can't be used.
    pub fn new(settings: &YarpDriverSettings, robot: &Robot) -> Result<YarpHardware, KindError> {
        let (network, layout) = (settings.server.as_deref().map(at).transpose(), Layout::new(settings, robot));
        let unusable =
            [network.as_ref().map(drop).map_err(Clone::clone), layout.as_ref().map(drop).map_err(Clone::clone)];
        KindError::gather([settings.validate()].into_iter().chain(unusable))?;
        Ok(YarpHardware {
            network: network?,
            layout: Arc::new(layout?),
            settings: settings.clone(),
            robot: robot.name.clone(),
            simulated: None,
            started: Mutex::new(None),
            inherited: Mutex::default(),
        })
    }

    /// The same on a network that is known already.
    ///
    /// # Errors
    /// The first setting that can't be used.
    pub fn on(network: &Network, settings: &YarpDriverSettings, robot: &Robot) -> Result<YarpHardware, KindError> {
        let mut hardware = YarpHardware::new(settings, robot)?;
        hardware.network = Some(network.clone());
        Ok(hardware)
    }

    /// The same behind a simulated wire, with all tasks on the runtime of whoever connects.
    ///
    /// # Errors
    /// The first setting that can't be used.
    fn behind(wire: Arc<dyn Wire>, settings: &YarpDriverSettings, robot: &Robot) -> Result<YarpHardware, KindError> {
        let mut hardware = YarpHardware::new(settings, robot)?;
        hardware.simulated = Some(wire);
        Ok(hardware)
    }

    fn start(&self) -> Result<Started, DriverFault> {
        let (wire, place) = match &self.simulated {
            Some(wire) => (wire.clone(), Place::Here),
            None => (Arc::new(self.network()?) as Arc<dyn Wire>, Place::Threads),
        };
        let cell = Arc::new(SharedBoards::new(&self.layout));
        cell.lock().inherit(&self.layout, &self.inherited.lock().unwrap_or_else(PoisonError::into_inner));
        thread::start((wire, place), &self.settings, &self.robot, self.layout.clone(), cell)
            .map_err(|e| DriverFault::Hardware(format!("no thread for the robot's network: {e}")))
    }

    fn network(&self) -> Result<Network, DriverFault> {
        let network = match &self.network {
            Some(network) => network.clone(),
            None => config::network_or_default(&Env::real()).map_err(|e| DriverFault::Hardware(e.to_string()))?,
        };
        Ok(match self.settings.listen.as_deref().map(str::parse) {
            Some(Ok(address)) => network.with_bind(address),
            _ => network,
        })
    }

    /// The way to the threads, started if they are not there or one of them has died; whether they are not the first.
    fn reach(&self) -> Result<(Reach, bool), DriverFault> {
        let mut started = self.started();
        let broken = started.as_ref().is_some_and(|running| running.thread.is_broken());
        if let Some(broken) = started.take_if(|_| broken) {
            self.was_found(&broken.reach.found());
            broken.thread.leave();
        }
        match &*started {
            Some(running) => Ok((running.reach.clone(), false)),
            None => Ok((started.insert(self.start()?).reach.clone(), broken)),
        }
    }

    /// A driver of the boards as they are. The first connection waits for them; later ones must not keep a running system
    /// waiting.
    fn driver(&self, reach: &Reach, known_before: bool) -> Result<Box<dyn Driver>, DriverFault> {
        let patience = if known_before { Duration::ZERO } else { self.settings.patience() };
        let inner = reach.cell.wait(patience);
        match (inner.trouble(), &inner.board) {
            (Some(Trouble::Forbidden(why)), _) => Err(DriverFault::Hardware(why)),
            (Some(Trouble::Lost(_)), _) if known_before => Err(DriverFault::Lost),
            (Some(Trouble::Lost(why)), _) => Err(DriverFault::Hardware(format!("it can't be reached: {why}"))),
            (None, Some(board)) if inner.joined.is_some() => {
                Ok(Box::new(YarpDriver::new(reach.clone(), board.clone(), self.settings.moves)))
            }
            (None, _) => Err(DriverFault::Hardware("it sends no states".into())),
        }
    }

    fn started(&self) -> MutexGuard<'_, Option<Started>> {
        self.started.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Hardware for YarpHardware {
    fn connect(&self) -> Result<Box<dyn Driver>, DriverFault> {
        let (reach, again) = self.reach()?;
        let begins = reach.cell.take();
        let known_before = again || (!begins && reach.cell.lock().board.is_some());
        self.driver(&reach, known_before)
    }

    fn look(&self) -> Option<Result<Box<dyn Driver>, DriverFault>> {
        Some(self.reach().and_then(|(reach, _)| self.driver(&reach, false)))
    }

    fn let_go(&self) {
        if let Some(started) = &*self.started() {
            started.reach.cell.let_go();
        }
    }

    fn was_found(&self, found: &[AsFound]) {
        *self.inherited.lock().unwrap_or_else(PoisonError::into_inner) = found.to_vec();
    }

    fn known(&self) -> Known {
        let motors = self.layout.patches.iter().flat_map(|p| p.motors.clone()).collect();
        Known { start: None, period: Some(self.settings.period()), motors: Some(motors) }
    }

    fn paces(&self) -> Vec<Paces> {
        let started = self.started();
        let Some(started) = started.as_ref() else { return Vec::new() };
        let inner = started.reach.cell.lock();
        let of = |(patch, known): (&layout::Patch, &cell::BoardFacts)| Paces {
            board: patch.port.clone(),
            seen: known.gauge.seen().to_vec(),
            fair: !known.gauge.is_unfair(),
            own_acceleration: known.own_acceleration,
        };
        self.layout.patches.iter().zip(&inner.boards).map(of).collect()
    }

    fn native_state(&self, part: &str) -> Option<NativeState> {
        let board = self.layout.patches.iter().position(|p| p.part == part)?;
        let state = self.started().as_ref()?.reach.cell.lock().boards.get(board)?.told.clone()?;
        let stamp = state.stamp.map(|stamp| (stamp.count, stamp.time));
        let message = NativeMessage(state.joints.encode(Dialect::V3));
        Some(NativeState { seq: state.seq, stamp, message })
    }

    fn passthrough(&self, part: &str, request: NativeMessage) -> Option<Answer<Result<NativeMessage, DriverFault>>> {
        let refused = |why: &str| {
            let fault = DriverFault::Refused(why.to_owned());
            Some(Box::pin(std::future::ready(Err(fault))) as Answer<_>)
        };
        let Some(board) = self.layout.patches.iter().position(|p| p.part == part) else {
            return refused("there is no such part");
        };
        if !Bottle::decode(&request.0, Dialect::V3).is_ok_and(|asked| may_pass(&asked)) {
            return refused("only questions are passed on");
        }
        let started = self.started();
        let Some(questions) = started.as_ref().and_then(|s| s.questions.get(board)) else {
            return refused("the boards have not been reached yet");
        };
        questions.pass(request).or_else(|| refused("too many questions wait for the board"))
    }
}

impl Drop for YarpHardware {
    /// Stops the boards, gives them back as they were found, and waits for that.
    fn drop(&mut self) {
        if let Some(started) = self.started().take() {
            started.thread.end();
        }
    }
}

/// Questions: what changes nothing. References of speed and acceleration are none: between our own and the move that is to go by
/// them, another's would make the robot as fast as that one likes.
fn may_pass(asked: &Bottle) -> bool {
    asked.get(0).and_then(Value::as_vocab) == Some(Vocab::new("get"))
}

/// The network of a name server given as `HOST:PORT`, with our ports on an address of this machine; `None`: what YARP's own files say.
///
/// # Errors
/// One that is no address.
pub(crate) fn network_of(server: Option<&str>, listen: Option<&str>) -> Result<Option<Network>, KindError> {
    let network = server.map(at).transpose()?;
    let Some(listen) = listen else { return Ok(network) };
    let help = "give this machine's address in the robot's network, such as 10.0.0.12, or 0.0.0.0 for all";
    let address =
        listen.parse().map_err(|_| KindError::new("listen", format!("`{listen}` is not an address"), help))?;
    let network = match network {
        Some(network) => network,
        None => config::network_or_default(&Env::real())
            .map_err(|e| KindError::new("server", e.to_string(), "give the name server as HOST:PORT"))?,
    };
    Ok(Some(network.with_bind(address)))
}

/// The network of a name server given as `HOST:PORT`.
fn at(server: &str) -> Result<Network, KindError> {
    let help = "give the name server as HOST:PORT, such as 127.0.0.1:10000";
    server.parse().map_err(|_| KindError::new("server", format!("`{server}` is not an address"), help))
}
