//! The agent contract: requests to a planner, and its possible answers.

use crate::{Axis, CommitId, MotionEnd, Pose, Refusal, SetPose, Setpoints, Target, Time};
use mobee_model::{Contact, Scene};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Duration;

/// Immutable snapshot for an agent: cheap to clone, and valid for as long as the agent stores it.
#[derive(Clone, Debug)]
pub struct View {
    /// Time of the snapshot.
    pub at: Time,
    /// Index of the agent's robot in the scene.
    pub robot: usize,
    /// Axes of the robot's board.
    pub axes: Arc<[Axis]>,
    /// Newest configurations of all robots, rad, in the scene's order.
    pub poses: Vec<Pose>,
    /// Robots and objects, for collision queries of the agent's own.
    pub scene: Arc<Scene>,
    /// Present contacts of the robot or, while it rests after a failure, its last contacts: an agent may learn the
    /// cause from them.
    pub contacts: Arc<[Contact]>,
    /// Distance that a plan should maintain from everything, meters: the robot's margin plus the planning allowance.
    pub clearance: f64,
    /// Objects that sensors track. All other objects are where the scene has them.
    pub seen: Arc<[SeenObject]>,
}

/// Object that a sensor tracks, with its last observation.
#[derive(Clone, Debug, PartialEq)]
pub struct SeenObject {
    /// Name of the object.
    pub object: String,
    /// Time of the last accepted observation; `None`: not observed yet, so its position is only the configured one.
    pub at: Option<Time>,
    /// Position of its center then, meters. The scene adopts it a moment later, unless the change is smaller than the
    /// sensor's least update.
    pub place: Option<[f64; 3]>,
    /// True if the last observation is too old.
    pub is_stale: bool,
}

impl View {
    /// Configuration of the agent's own robot.
    pub fn pose(&self) -> &[f64] {
        self.poses.get(self.robot).map_or(&[], |p| p)
    }

    /// Last observation of an object, if a sensor tracks it.
    pub fn seen(&self, object: &str) -> Option<&SeenObject> {
        self.seen.iter().find(|seen| seen.object == object)
    }
}

/// Planner of a robot's motions. Pure: no clock, no I/O, and no randomness beyond its seed.
///
/// Its motions may be infeasible: the agent commits them, and learns from the end of each.
pub trait Agent: Send {
    /// Returns the next intent of a robot at rest in a known configuration. `last`: end of the previous motion, as
    /// returned by WAITFORMOTION (Algorithm 3); `None` at the start and after a wait or a stop.
    fn next(&mut self, last: Option<MotionEnd>, view: &View) -> Intent;

    /// Handles a new view in mid-motion (an object moved or changed): `None` continues the plan, an intent changes
    /// it. During a stream it is called every control period, for the next set-point.
    fn revise(&mut self, _view: &View) -> Option<Intent> {
        None
    }

    /// Changes of the agent's map and state since the last call, for the journal and the recorder.
    fn notes(&mut self) -> Vec<Note> {
        Vec::new()
    }

    /// Motors that it moves, and configurations named in its settings: checked against robot, hardware and world
    /// before any motion.
    fn requirements(&self) -> Requirements {
        Requirements::default()
    }

    /// Duration of the last call by a virtual clock, on which computing takes no time by itself: for the simulation
    /// of slow planners. With a real clock the duration is measured, and this is not called.
    fn simulated_latency(&self) -> Duration {
        Duration::ZERO
    }

    /// Restores the map from the notes of an earlier process of the same run.
    fn recall(&mut self, _past: &[Note]) {}

    /// Exports its versioned state for a successor.
    fn export(&self) -> Snapshot;

    /// Imports a predecessor's state.
    ///
    /// # Errors
    /// [`Refusal::State`] if the state is of another kind or version; the agent is then as before.
    fn import(&mut self, from: Snapshot) -> Result<(), Refusal>;
}

/// Resources that an agent will use, as far as its settings show.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Requirements {
    /// Motors that it moves.
    pub motors: Vec<usize>,
    /// Configurations that it goes to.
    pub poses: Vec<SetPose>,
}

/// Intent of an agent.
#[derive(Clone, Debug, PartialEq)]
pub enum Intent {
    /// Move to this target; in mid-motion: change the open motion's target.
    MoveTo(Target),
    /// The same, with the target's motors at their own speeds, rad/s, as control boards drive them: they arrive one
    /// after the other.
    MoveEach(Target, Vec<f64>),
    /// Follow set-points. The first opens a motion, and each further one continues it. When there are no more, the
    /// robot brakes and the motion ends where it rests. Refused while the robot holds: escapes are moves.
    Stream(Setpoints),
    /// Brake; the motion then ends as failed.
    Stop,
    /// Call [`Agent::next`] again after this time.
    Wait(Duration),
    /// Nothing more to do.
    Done(Summary),
}

impl Intent {
    /// Kind of the intent, without its values.
    pub fn kind(&self) -> IntentKind {
        match self {
            Intent::MoveTo(_) | Intent::MoveEach(..) => IntentKind::Move,
            Intent::Stream(_) => IntentKind::Stream,
            Intent::Stop => IntentKind::Stop,
            Intent::Wait(_) => IntentKind::Wait,
            Intent::Done(_) => IntentKind::Done,
        }
    }
}

/// Kind of an agent's intent, without its values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum IntentKind {
    /// Move.
    Move,
    /// Stream of set-points.
    Stream,
    /// Braking.
    Stop,
    /// Wait until a later call.
    Wait,
    /// End of the plan.
    Done,
}

/// Report of an agent at its end: counts and findings by name, shown in the run's summary.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// One sentence.
    pub text: String,
    /// Named figures, in the order to show them.
    pub figures: Vec<(String, f64)>,
}

/// State of an agent for a successor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    /// Agent kind that wrote it.
    pub kind: String,
    /// Version of its layout.
    pub version: u32,
    /// State in the layout of that kind and version.
    pub state: serde_json::Value,
}

/// Change of an agent's map, or finding of an agent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "note", rename_all = "snake_case")]
pub enum Note {
    /// A vertex was added to the map, or was moved to another configuration and lost its edges.
    Vertex {
        /// Number in the map.
        id: u32,
        /// Configuration of the whole robot there, rad.
        q: Vec<f64>,
        /// Position at which it is shown in the world (that of the hand), meters.
        at: [f64; 3],
    },
    /// A directed edge of the map changed.
    Edge {
        /// Start vertex.
        from: u32,
        /// End vertex.
        to: u32,
        /// New state of the edge.
        state: EdgeState,
        /// Description of the obstacle, if known.
        cause: Option<String>,
    },
    /// A motion along a directed edge ended: an entry of the map's log of tried motions.
    Tried {
        /// Start vertex.
        from: u32,
        /// End vertex.
        to: u32,
        /// True if the end was reached; else the motion failed.
        reached: bool,
        /// Description of the obstacle, if known.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        cause: Option<String>,
    },
    /// Vertices of the current plan, from the robot to the goal; empty: no plan.
    Plan {
        /// Vertex numbers.
        path: Vec<u32>,
    },
    /// A line for the event log.
    Log {
        /// The text.
        text: String,
    },
}

/// State of a directed edge in an agent's map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EdgeState {
    /// Not tried yet; assumed to be feasible.
    Optimistic,
    /// Not tried, but the opposite direction failed: planned last.
    Doubtful,
    /// Driven to its end.
    Feasible,
    /// Failed when driven, and no longer planned over.
    Removed,
    /// Not free in the model's present world, as certified: not planned over until the world changes.
    Blocked,
}

/// Commit of an agent to the filtered interface.
#[derive(Clone, Debug, PartialEq)]
pub struct Commit {
    /// Name of the committing agent's actor.
    pub agent: Arc<str>,
    /// Target of the motion.
    pub target: Target,
    /// Speeds of the target's motors, rad/s, each moving at its own as those of a control board; `None`: all arrive
    /// together.
    pub speeds: Option<Vec<f64>>,
}

/// Answer to a commit.
pub type Verdict = Result<CommitId, Refusal>;
