//! Driver of a robot behind YARP (kind `yarp`), and of a camera behind a YARP image port. Combines its control boards into one board, in radians and in the model's
//! order of motors.
//!
//! ```text
//! drivers (one per life of a driver actor)          two threads, which outlive the drivers and watch each other
//!   command ──checked──> a bounded queue per board ──> Hand ──> RemoteBoard ──> the robot
//!   stop ──────────────> at once ────────────────────> Brake ──> its own connection ──> the robot
//!   lease ─────────────> watched beside the brakes: when it expires, everything stops
//!   sample <───────────── Cell: newest of all boards <── Arrivals <── state streams
//! services: queries ──> Questions, a connection per board that the caller itself drives ──> the robot
//! ```
//! * Every new connection to a board begins with a stop. Commands issued before it are void (F11).
//! * References and modes of a board are restored to the values found, once its joints rest and at the end
//!   (`found.rs`).
//! * A silent board gives no readings. A lost one is [`mobee_contract::DriverFault::Lost`] until it is back.
//! * While another program holds our port names, nothing is written, and the fault reports it (F13).
//! * A stop never waits for the answer to another request, and is repeated until the readings show its
//!   effect. If a task that can stop the robot dies, the remaining ones stop it, and the robot is not used
//!   until all tasks run again.
//! * A board that takes longer than `latency_ms` to answer is reported through
//!   [`mobee_contract::Driver::answer_time`]; the filter does not open until it answers in time.
//! * YARP's degrees and joint order are confined to this module.
//! * Everything also runs in virtual time on one thread, against simulated boards behind simulated wires
//!   (`sim.rs`).

#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::unreachable, clippy::indexing_slicing)
)]

// the robot and its network of the integration tests, for unit tests that use them too
#[cfg(test)]
extern crate self as mobee_driver_yarp;
#[cfg(test)]
#[path = "../tests/it/net.rs"]
#[allow(dead_code, reason = "the tests from outside use all of it")]
mod net;
#[cfg(test)]
#[path = "../tests/it/way.rs"]
#[allow(dead_code, reason = "the tests from outside use all of it")]
mod way;

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
mod image_port;
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
pub use image_port::{YarpCamera, YarpCameraSettings};
pub use layout::{disagreement, joint_kind};
pub use settings::{Moves, PartSettings, YarpDriverSettings};
pub use sim::board::{SimBoard, SimClock};
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
use thread::ThreadPlacement;

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

/// A robot behind YARP. Its threads start with the first connection and live as long as this object,
/// independently of drivers.
pub struct YarpHardware {
    settings: YarpDriverSettings,
    robot: String,
    layout: Arc<Layout>,
    network: Option<Network>,
    /// Replaces the network in a simulation.
    simulated: Option<Arc<dyn Wire>>,
    started: Mutex<Option<Started>>,
    /// Settings of the motors as found by an earlier process, or by threads that died.
    inherited: Mutex<Vec<AsFound>>,
}

/// State that exists while the threads run.
struct Started {
    reach: Reach,
    questions: Vec<Questions>,
    thread: thread::Threads,
}

impl YarpHardware {
    /// Builds the hardware from the settings in a config file.
    ///
    /// # Errors
    /// The first setting that can't be used.
    pub fn build(settings: &Json, context: &Context) -> Result<YarpHardware, KindError> {
        let settings: YarpDriverSettings = mobee_contract::settings(settings)?;
        YarpHardware::new(&settings, &context.robot)
    }

    /// Builds the hardware for the boards of this robot. Opens and queries nothing before the first
    /// connection, so that a file can be checked while another program drives its robot.
    ///
    /// # Errors
    /// The first setting that can't be used.
    pub fn new(settings: &YarpDriverSettings, robot: &Robot) -> Result<YarpHardware, KindError> {
        let network = settings.server.as_deref().map(at).transpose();
        let layout = Layout::new(settings, robot);
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

    /// Same as [`YarpHardware::new`], on an existing network.
    ///
    /// # Errors
    /// The first setting that can't be used.
    pub fn on(network: &Network, settings: &YarpDriverSettings, robot: &Robot) -> Result<YarpHardware, KindError> {
        let mut hardware = YarpHardware::new(settings, robot)?;
        hardware.network = Some(network.clone());
        Ok(hardware)
    }

    /// Same as [`YarpHardware::new`], behind a simulated wire, with all tasks on the runtime of the caller
    /// that connects.
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
            Some(wire) => (wire.clone(), ThreadPlacement::Here),
            None => (Arc::new(self.network()?) as Arc<dyn Wire>, ThreadPlacement::Threads),
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

    /// Handle to the threads, which are started if they don't run or one of them has died. The flag is true
    /// if they replace threads that died.
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

    /// Creates a driver of the boards in their present state. The first connection waits for the boards;
    /// later ones return at once, so that a running system is not delayed.
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
        let state = self.started().as_ref()?.reach.cell.lock().boards.get(board)?.received.clone()?;
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
    /// Stops the boards, restores the settings found, and waits until that is done.
    fn drop(&mut self) {
        if let Some(started) = self.started().take() {
            started.thread.end();
        }
    }
}

/// True for queries, which change nothing. Writing a reference speed or acceleration is not a query: between
/// our own reference and the move that depends on it, another program's value would set the speed of the
/// robot.
fn may_pass(asked: &Bottle) -> bool {
    asked.get(0).and_then(Value::as_vocab) == Some(Vocab::new("get"))
}

/// Network of a name server given as `HOST:PORT`, with our ports on an address of this machine; `None`
/// selects the network of YARP's own files.
///
/// # Errors
/// An address that can't be parsed.
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
