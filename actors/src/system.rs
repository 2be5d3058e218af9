//! The whole system: robots, model, agents and script, composed from a [`Setup`], run to its end.

mod exchange;
mod inject;
mod overload;
mod past;
mod report;
mod rest;
mod restart;
mod run;
mod tree;

pub use crate::shell::{
    CameraSetup, KeptObject, LocatorSetup, PartMaker, SensorSetup, WorldGate, WorldGateSettings, named_apart,
};
pub use crate::wiring::{Blow, CueTrigger, Cues, Late, RunCounts, ScriptStep, Troubles, TruthCell};
pub use exchange::{BesideOffer, NewBeside, NewPart, PartOffer};
pub use inject::{Injection, Spot};
pub use overload::overload;
pub use past::{Past, PastRobot};
pub use report::{RobotReport, SensorReport, SystemReport};
pub use run::{run, run_under};

use crate::record::tap::Taps;
use crate::runtime::clock::ClockKind;
use crate::wiring::SwapRequest;
use mobee_contract::{Agent, Hardware, Service, Snapshot, Time};
use mobee_controller::ControllerSettings;
use mobee_model::{Edit, Scene};
use std::fmt;
use std::sync::Arc;
use std::time::Duration;

/// Makes an agent, at the start and after each of its deaths.
pub type AgentMaker = Arc<dyn Fn() -> Result<Box<dyn Agent>, String> + Send + Sync>;

/// What to run.
pub struct Setup {
    /// The world: its robots, in this order, are those of `robots`.
    pub scene: Scene,
    /// Hardware, controller and agent of each robot.
    pub robots: Vec<RobotSetup>,
    /// The seed of everything random, for the journal.
    pub seed: u64,
    /// How time passes.
    pub clock: ClockKind,
    /// Who is told. The caller finishes them after the run, with the event `Ended`.
    pub taps: Taps,
    /// The resolved configuration, for the journal.
    pub config: serde_json::Value,
    /// Edits of the world that wait for their moment.
    pub script: Vec<ScriptStep>,
    /// What runs beside the safety chain; in virtual time only those that can ([`Service::runs_in_virtual_time`]). While one of them keeps
    /// the run ([`Service::keeps_run`]), it does not end because all agents are done.
    pub services: Vec<Arc<dyn Service>>,
    /// What looks at the world, beside the safety chain.
    pub sensors: Vec<SensorSetup>,
    /// What its simulated cameras see of this run, if it has any.
    pub truth: Option<Arc<TruthCell>>,
    /// What an earlier process of this run left, if it is resumed.
    pub past: Option<Past>,
}

impl Setup {
    /// Of these robots in virtual time, and of nothing beside them.
    pub fn in_virtual_time(scene: Scene, robots: Vec<RobotSetup>, seed: u64, taps: Taps) -> Setup {
        Setup {
            scene,
            robots,
            seed,
            clock: ClockKind::Virtual,
            taps,
            config: serde_json::Value::Null,
            script: Vec::new(),
            services: Vec::new(),
            sensors: Vec::new(),
            truth: None,
            past: None,
        }
    }
}

/// One robot of a [`Setup`].
pub struct RobotSetup {
    /// Its name: the key of all its events. Unique in the setup.
    pub name: String,
    /// Its board.
    pub hardware: Arc<dyn Hardware>,
    /// Its controller's settings.
    pub controller: ControllerSettings,
    /// Its agent, if it has one.
    pub agent: Option<AgentMaker>,
    /// Where it is moved when the run ends in order; `None`: it stops where it is.
    pub rest: Option<RestSetup>,
}

/// The motion to a robot's rest pose.
#[derive(Clone)]
pub struct RestSetup {
    /// Makes the agent that plans the motion. When it is done, the robot is at its rest pose if the summary has the figure [`RestSetup::REACHED`]
    /// and that is positive; otherwise the summary's text says why not.
    pub maker: AgentMaker,
    /// The longest time that the motion may take, plans and retries included.
    pub within: Duration,
}

impl RestSetup {
    /// The name of the figure that counts the goals that were reached.
    pub const REACHED: &str = "goals_reached";
}

/// What a running system can be told.
#[derive(Debug)]
pub enum Control {
    /// End in order: motions stop, robots rest, every commit has its outcome (I17).
    Stop,
    /// End at once: drivers stop the boards, outcomes by the newest readings.
    Abort,
    /// Change the world.
    Edit(Edit),
    /// Kill an actor, as a fault would: `model`, `<robot>/driver`, `<robot>/agent` and so on.
    Kill(String),
    /// Put a fault into the system, or say that all have healed. In runs of [`run_under`] with faults only.
    Inject(Injection),
    /// Try a robot's failed retreat again.
    Recover(String),
    /// Stop a robot, which holds until it is released.
    Halt(String),
    /// Let a halted robot act again.
    Release(String),
    /// Exchange a robot's agent. Answered once the new one is built and checked, or why not; see [`Event::Swap`] for what
    /// becomes of it.
    ///
    /// [`Event::Swap`]: mobee_contract::Event::Swap
    SwapAgent {
        /// Robot.
        robot: String,
        /// The new agent.
        offer: SwapRequest,
        /// Whether it was taken.
        reply: tokio::sync::oneshot::Sender<Result<(), String>>,
    },
    /// Exchange a robot's controller or driver. Answered at once, whether that is begun; see [`Event::Swap`] for what becomes of it.
    ///
    /// [`Event::Swap`]: mobee_contract::Event::Swap
    SwapPart {
        /// Robot.
        robot: String,
        /// The new part.
        offer: PartOffer,
        /// Whether it was taken.
        reply: tokio::sync::oneshot::Sender<Result<(), String>>,
    },
    /// Exchange a bridge, by its name in the run, or the detector of a camera, by `<sensor>/<camera>`. Answered at once, whether that
    /// is begun; see [`Event::SwapBeside`] for what becomes of it.
    ///
    /// [`Event::SwapBeside`]: mobee_contract::Event::SwapBeside
    SwapBeside {
        /// Its name.
        name: String,
        /// The new part.
        offer: BesideOffer,
        /// Whether it was taken.
        reply: tokio::sync::oneshot::Sender<Result<(), String>>,
    },
    /// Start a sensor or a service again, by its name: whether it runs, or has used up its restarts.
    Restart {
        /// Its name.
        name: String,
        /// Answered once its parts have started, or with the reason why they have not.
        reply: tokio::sync::oneshot::Sender<Result<(), String>>,
    },
    /// How all is.
    Status(tokio::sync::oneshot::Sender<SystemReport>),
}

/// How far a run is.
#[derive(Clone, Debug, PartialEq)]
pub struct RunProgress {
    /// Time of the run.
    pub at: Time,
    /// The counters.
    pub counts: RunCounts,
}

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// All agents are done.
    Done,
    /// The time limit.
    Time,
    /// A stop or an abort.
    Interrupted,
    /// A supervisor used up its restarts.
    GaveUp,
    /// The journal can't be kept up.
    NoJournal,
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Reason::Done => "done",
            Reason::Time => "time",
            Reason::Interrupted => "interrupted",
            Reason::GaveUp => "gave up",
            Reason::NoJournal => "no journal",
        })
    }
}

/// How a run ended.
#[derive(Clone, Debug)]
pub struct RunEnd {
    /// Why.
    pub reason: Reason,
    /// When.
    pub ended_at: Time,
    /// The counters.
    pub counts: RunCounts,
    /// The agents' last states, by robot.
    pub snapshots: Vec<(String, Snapshot)>,
    /// The world at the end.
    pub scene: Arc<Scene>,
}

/// Why a run could not begin.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The robots of scene and setup differ.
    #[error("the scene has {scene} robots, the setup {setup}; give each robot of the scene one entry")]
    Robots {
        /// In the scene.
        scene: usize,
        /// In the setup.
        setup: usize,
    },
    /// A board and its robot model differ.
    #[error("robot {robot}: the board has {board} motors, its model {model}; use the model of this robot")]
    Board {
        /// The robot.
        robot: String,
        /// Motors of the board.
        board: usize,
        /// Motors of the model.
        model: usize,
    },
    /// The board can't be reached.
    #[error("robot {robot}: {fault}; see that it is switched on and connected")]
    Connect {
        /// The robot.
        robot: String,
        /// Why.
        fault: String,
    },
    /// A service can't serve.
    #[error("{name}: {why}")]
    Service {
        /// The service.
        name: String,
        /// Why, with the remedy.
        why: String,
    },
    /// A service talks to the world outside, which has no virtual time.
    #[error("the service {0} can't run in virtual time; set clock = \"real\", or run without it")]
    VirtualService(String),
    /// A sensor is carried by a robot that there is not.
    #[error("there is no robot {0} to carry a sensor; name one of the setup")]
    Body(String),
    /// The system gives no thread, timer or poller, or an actor could not be started.
    #[error("the system could not be started: {0}")]
    Start(String),
}
