//! The whole system: robots, model, agents and script, composed from a [`Setup`] and run to its end.

mod exchange;
mod inject;
mod overload;
mod past;
mod report;
mod rest;
mod restart;
mod run;
mod running;
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

use crate::clock::ClockKind;
use crate::tap::Taps;
use crate::wiring::SwapRequest;
use mobee_contract::{Agent, Hardware, Service, Snapshot, Time};
use mobee_controller::ControllerSettings;
use mobee_model::{Edit, Scene};
use std::fmt;
use std::sync::Arc;
use std::time::Duration;

/// Creates an agent, at the start and after each of its deaths.
pub type AgentMaker = Arc<dyn Fn() -> Result<Box<dyn Agent>, String> + Send + Sync>;

/// Settings of a run.
pub struct Setup {
    /// The world: its robots, in this order, are those of `robots`.
    pub scene: Scene,
    /// Hardware, controller and agent of each robot.
    pub robots: Vec<RobotSetup>,
    /// Seed of all random numbers, for the journal.
    pub seed: u64,
    /// Kind of the clock.
    pub clock: ClockKind,
    /// Taps of the run. The caller finishes them after the run, with the event `Ended`.
    pub taps: Taps,
    /// The resolved configuration, for the journal.
    pub config: serde_json::Value,
    /// Edits of the world with their triggers.
    pub script: Vec<ScriptStep>,
    /// Services beside the safety chain; in virtual time only those that support it
    /// ([`Service::runs_in_virtual_time`]). While one of them keeps the run alive ([`Service::keeps_run`]), the
    /// run does not end because all agents are done.
    pub services: Vec<Arc<dyn Service>>,
    /// Sensors beside the safety chain.
    pub sensors: Vec<SensorSetup>,
    /// Scene that the simulated cameras see, if there are any.
    pub truth: Option<Arc<TruthCell>>,
    /// State from an earlier process of this run, if it is resumed.
    pub past: Option<Past>,
}

impl Setup {
    /// Settings for these robots in virtual time, without services, sensors or a script.
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
    /// Name of the robot: the key of all its events. Unique in the setup.
    pub name: String,
    /// Hardware of the robot.
    pub hardware: Arc<dyn Hardware>,
    /// Settings of its controller.
    pub controller: ControllerSettings,
    /// Creates its agent, if it has one.
    pub agent: Option<AgentMaker>,
    /// Motion to its rest pose when the run ends in order; `None`: it stops where it is.
    pub rest: Option<RestSetup>,
}

/// The motion to a robot's rest pose.
#[derive(Clone)]
pub struct RestSetup {
    /// Creates the agent that plans the motion. When it is done, the robot is at its rest pose if the summary
    /// has a positive figure [`RestSetup::REACHED`]; otherwise the summary's text gives the reason.
    pub maker: AgentMaker,
    /// Longest duration of the motion, plans and retries included.
    pub within: Duration,
}

impl RestSetup {
    /// Name of the figure that counts the reached goals.
    pub const REACHED: &str = "goals_reached";
}

/// Request to a running system.
#[derive(Debug)]
pub enum Control {
    /// End in order: motions stop, robots come to rest, every commit has its outcome (I17).
    Stop,
    /// End at once: drivers stop the boards, and outcomes are given by the newest readings.
    Abort,
    /// Change the world.
    Edit(Edit),
    /// Kill an actor, as a fault would: `model`, `<robot>/driver`, `<robot>/agent` and so on.
    Kill(String),
    /// Inject a fault, or report that all have healed. Only in runs of [`run_under`] with faults.
    Inject(Injection),
    /// Try a robot's failed retreat again.
    Recover(String),
    /// Stop a robot, which holds until it is released.
    Halt(String),
    /// Let a halted robot act again.
    Release(String),
    /// Exchange a robot's agent. The reply comes once the new one is built and checked, or with the reason for
    /// a refusal; [`Event::Swap`] reports the rest.
    ///
    /// [`Event::Swap`]: mobee_contract::Event::Swap
    SwapAgent {
        /// Name of the robot.
        robot: String,
        /// The new agent.
        offer: SwapRequest,
        /// Port for the verdict.
        reply: tokio::sync::oneshot::Sender<Result<(), String>>,
    },
    /// Exchange a robot's controller or driver. The reply comes at once, when the exchange has begun or is
    /// refused; [`Event::Swap`] reports the rest.
    ///
    /// [`Event::Swap`]: mobee_contract::Event::Swap
    SwapPart {
        /// Name of the robot.
        robot: String,
        /// The new part.
        offer: PartOffer,
        /// Port for the verdict.
        reply: tokio::sync::oneshot::Sender<Result<(), String>>,
    },
    /// Exchange a bridge, by its name in the run, or the detector of a camera, by `<sensor>/<camera>`. The
    /// reply comes at once, when the exchange has begun or is refused; [`Event::SwapBeside`] reports the rest.
    ///
    /// [`Event::SwapBeside`]: mobee_contract::Event::SwapBeside
    SwapBeside {
        /// Name of the part.
        name: String,
        /// The new part.
        offer: BesideOffer,
        /// Port for the verdict.
        reply: tokio::sync::oneshot::Sender<Result<(), String>>,
    },
    /// Restart a sensor or a service by its name, whether it runs or has used up its restarts.
    Restart {
        /// Name of the sensor or service.
        name: String,
        /// Port for the reply: once its parts have started, or with the reason why they have not.
        reply: tokio::sync::oneshot::Sender<Result<(), String>>,
    },
    /// Report the state of the system.
    Status(tokio::sync::oneshot::Sender<SystemReport>),
}

/// Progress of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct RunProgress {
    /// Time of the run.
    pub at: Time,
    /// The counters.
    pub counts: RunCounts,
}

/// Reason for the end of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// All agents are done.
    Done,
    /// The time limit was reached.
    Time,
    /// It was stopped or aborted.
    Interrupted,
    /// A supervisor used up its restarts.
    GaveUp,
    /// The journal can't be maintained.
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

/// Result of a run.
#[derive(Clone, Debug)]
pub struct RunEnd {
    /// Reason for the end.
    pub reason: Reason,
    /// Time of the end on the run's clock.
    pub ended_at: Time,
    /// The counters.
    pub counts: RunCounts,
    /// The agents' last states, by robot.
    pub snapshots: Vec<(String, Snapshot)>,
    /// The world at the end.
    pub scene: Arc<Scene>,
}

/// Error at the start of a run.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The robots of scene and setup differ.
    #[error("the scene has {scene} robots, the setup {setup}; give each robot of the scene one entry")]
    Robots {
        /// Number of robots in the scene.
        scene: usize,
        /// Number of robots in the setup.
        setup: usize,
    },
    /// A board and its robot model differ.
    #[error("robot {robot}: the board has {board} motors, its model {model}; use the model of this robot")]
    Board {
        /// Name of the robot.
        robot: String,
        /// Motors of the board.
        board: usize,
        /// Motors of the model.
        model: usize,
    },
    /// The board can't be reached.
    #[error("robot {robot}: {fault}; see that it is switched on and connected")]
    Connect {
        /// Name of the robot.
        robot: String,
        /// Fault of the connection.
        fault: String,
    },
    /// A service can't run.
    #[error("{name}: {why}")]
    Service {
        /// Name of the service.
        name: String,
        /// Reason, with the remedy.
        why: String,
    },
    /// A service communicates with the outside, which has no virtual time.
    #[error("the service {0} can't run in virtual time; set clock = \"real\", or run without it")]
    VirtualService(String),
    /// A sensor is carried by a robot that does not exist.
    #[error("there is no robot {0} to carry a sensor; name one of the setup")]
    Body(String),
    /// The system provides no thread, timer or poller, or an actor could not be started.
    #[error("the system could not be started: {0}")]
    Start(String),
}
