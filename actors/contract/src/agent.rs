//! The agent contract: how a planner is asked, and what it may answer.

use crate::{Axis, CommitId, MotionEnd, Pose, Refusal, SetPose, Setpoints, Target, Time};
use mobee_model::{Contact, Scene};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Duration;

/// What an agent sees: an immutable snapshot, cheap to clone, kept as long as it likes.
#[derive(Clone, Debug)]
pub struct View {
    /// When the snapshot was taken.
    pub at: Time,
    /// The agent's robot, an index into the scene's robots.
    pub robot: usize,
    /// The robot's board.
    pub axes: Arc<[Axis]>,
    /// The newest poses of all robots, in the scene's order.
    pub poses: Vec<Pose>,
    /// Robots and objects, for collision queries of the agent's own.
    pub scene: Arc<Scene>,
    /// The robot's present or, while it rests after a failure, its last contacts: what an agent may learn a cause from.
    pub contacts: Arc<[Contact]>,
    /// The distance that a plan should keep from everything, meters (the robot's margin and what planning adds to it).
    pub clearance: f64,
    /// The objects that sensors keep where they see them. Of all others the scene is believed.
    pub seen: Arc<[SeenObject]>,
}

/// An object that a sensor keeps in the model, and when it was seen.
#[derive(Clone, Debug, PartialEq)]
pub struct SeenObject {
    /// Its name.
    pub object: String,
    /// When it was last seen, as far as that was believed; `None`: not yet, and where it is was only told.
    pub at: Option<Time>,
    /// Where its middle was then, meters. The scene has it there a moment later, unless that is nearer than the sensor's least move.
    pub place: Option<[f64; 3]>,
    /// Whether that is too long ago.
    pub is_stale: bool,
}

impl View {
    /// The agent's own robot's pose.
    pub fn pose(&self) -> &[f64] {
        self.poses.get(self.robot).map_or(&[], |p| p)
    }

    /// How an object was seen, if a sensor keeps it.
    pub fn seen(&self, object: &str) -> Option<&SeenObject> {
        self.seen.iter().find(|seen| seen.object == object)
    }
}

/// What plans a robot's motions. Pure: no clock, no I/O, no randomness but its seed.
///
/// Its motions may well be infeasible: it commits them, and learns from the end of each.
pub trait Agent: Send {
    /// The robot rests at a known pose; `last` says how the previous motion ended, as WAITFORMOTION does
    /// (Algorithm 3), and is `None` at the start and after a wait or a stop.
    fn next(&mut self, last: Option<MotionEnd>, view: &View) -> Intent;

    /// A new view arrived in mid-motion (an object moved or changed): keep going, or change the plan. While the motion is
    /// a stream it is asked every control period, for the next set-point.
    fn revise(&mut self, _view: &View) -> Option<Intent> {
        None
    }

    /// What happened to the agent's map and mind since the last call, for the journal and the recorder.
    fn notes(&mut self) -> Vec<Note> {
        Vec::new()
    }

    /// The motors it moves, and the poses that its settings name: checked against robot, hardware and world before
    /// anything moves.
    fn requirements(&self) -> Requirements {
        Requirements::default()
    }

    /// How long its last answer took by a virtual clock, on which thinking takes no time by itself: for the simulation of
    /// slow planners. By a real clock the time is measured, and this is not asked for.
    fn simulated_latency(&self) -> Duration {
        Duration::ZERO
    }

    /// What an earlier process of the same run noted: its map is taken up again from there.
    fn recall(&mut self, _past: &[Note]) {}

    /// Its state for a successor, versioned.
    fn export(&self) -> Snapshot;

    /// Takes over a predecessor's state.
    ///
    /// # Errors
    /// [`Refusal::State`] if the state is of another kind or version; the agent is then as before.
    fn import(&mut self, from: Snapshot) -> Result<(), Refusal>;
}

/// What an agent is going to use, as far as its settings tell.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Requirements {
    /// The motors it moves.
    pub motors: Vec<usize>,
    /// Poses it goes to.
    pub poses: Vec<SetPose>,
}

/// What an agent wants.
#[derive(Clone, Debug, PartialEq)]
pub enum Intent {
    /// Move there; in mid-motion: change the open motion's target.
    MoveTo(Target),
    /// The same, each of the target's motors at its own speed, rad/s, as control boards drive them: they arrive one after the other.
    MoveEach(Target, Vec<f64>),
    /// Follow set-points. The first opens a motion, each of the next continues it, and when they go quiet the robot
    /// brakes and the motion ends where it then rests. Refused while the robot holds: escapes are moves.
    Stream(Setpoints),
    /// Brake; the motion then ends as failed.
    Stop,
    /// Ask again after this time.
    Wait(Duration),
    /// Nothing more to do.
    Done(Summary),
}

impl Intent {
    /// What it is, without its values.
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

/// What an agent wants, without its values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum IntentKind {
    /// A motion.
    Move,
    /// Set-points.
    Stream,
    /// To brake.
    Stop,
    /// To be asked later.
    Wait,
    /// Nothing more.
    Done,
}

/// What an agent says at its end: counts and findings by name, shown in the run's summary.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// One sentence.
    pub text: String,
    /// Named figures, in the order to show them.
    pub figures: Vec<(String, f64)>,
}

/// An agent's state for a successor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    /// The kind that wrote it.
    pub kind: String,
    /// The version of its layout.
    pub version: u32,
    /// The state itself.
    pub state: serde_json::Value,
}

/// Something an agent did to its map, or thinks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "note", rename_all = "snake_case")]
pub enum Note {
    /// A vertex was added to the map; or one is at another pose now, and its edges are gone.
    Vertex {
        /// Its number in the map.
        id: u32,
        /// The whole robot's pose there, rad.
        q: Vec<f64>,
        /// Where it is shown in the world (the hand's position there), meters.
        at: [f64; 3],
    },
    /// A directed edge of the map changed.
    Edge {
        /// From vertex.
        from: u32,
        /// To vertex.
        to: u32,
        /// What is now believed of it.
        state: EdgeState,
        /// What stood in the way, in words, if known.
        cause: Option<String>,
    },
    /// A motion along a directed edge ended: what the map's log of tried motions says.
    Tried {
        /// From vertex.
        from: u32,
        /// To vertex.
        to: u32,
        /// Whether it was driven to its end; else it failed.
        reached: bool,
        /// What stood in the way, in words, if known.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        cause: Option<String>,
    },
    /// The vertices of the plan that is now followed, from the robot's side to the goal; empty: no plan.
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

/// What an agent believes of a directed edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EdgeState {
    /// Not tried yet, taken for feasible.
    Optimistic,
    /// Not tried, but the opposite direction failed: tried last.
    Doubtful,
    /// Driven to its end.
    Feasible,
    /// Failed when driven, and no longer planned over.
    Removed,
    /// Not free in the model's present world, as certified: not planned over until the world changes.
    Blocked,
}

/// A commit as an agent gives it to the filtered interface.
#[derive(Clone, Debug, PartialEq)]
pub struct Commit {
    /// Who commits: the name of the agent's actor.
    pub agent: Arc<str>,
    /// Where to.
    pub target: Target,
    /// Speeds of the target's motors, rad/s, each going at its own as a control board's do; `None`: all arrive together.
    pub speeds: Option<Vec<f64>>,
}

/// The answer to a commit.
pub type Verdict = Result<CommitId, Refusal>;
