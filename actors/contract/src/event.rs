//! The events that a run records.

use crate::{
    Admission, Cause, CommandKind, CommitId, Hold, IntentKind, Located, MotionEnd, Note, Outcome, Pose, Refusal,
    Region, RestStep, Status, Summary, SwapPart, SwapStep, Time,
};
use mobee_model::{Contact, JointMotion};
use serde::{Deserialize, Serialize};

/// Who gave a command to a driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Writer {
    /// An agent, through the filtered interface.
    Agent,
    /// The reflex.
    Reflex,
    /// Supervise on its own behalf: the stop when it closes the filter, and the control modes before it reopens it. Older
    /// journals attribute these to the reflex.
    Supervise,
    /// The driver itself: the stop that follows every start.
    Driver,
}

/// How an object of the world changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WorldChange {
    /// It is new.
    Added,
    /// It has another position.
    Moved,
    /// It has another class, shape or holder.
    Changed,
    /// It no longer exists.
    Removed,
}

impl WorldChange {
    /// The word shown to users.
    pub fn word(self) -> &'static str {
        match self {
            WorldChange::Added => "added",
            WorldChange::Moved => "moved",
            WorldChange::Changed => "changed",
            WorldChange::Removed => "removed",
        }
    }
}

/// Whether a measure need not be written.
fn is_nothing(x: &f64) -> bool {
    *x == 0.0
}

/// A robot's constraints: every clause must hold. A clause holds if one of its members has a positive value. This is the sum of the member's
/// coefficients, each times the position of the motor with the given index (degrees), plus its constant.
pub type Clauses = Vec<Vec<(Vec<(usize, f64)>, f64)>>;

/// An event of a run. `robot` is the robot's name; tokens are the fencing tokens of its filter, which only grow.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Event {
    /// First event: what runs.
    Started {
        /// The seed of all randomness.
        seed: u64,
        /// `virtual` or `real`.
        clock: String,
        /// The resolved configuration.
        config: serde_json::Value,
    },
    /// A run that ended, or whose process died, continues in another process: all filters are closed.
    Resumed {
        /// How many events were recorded before.
        events: u64,
        /// The resolved configuration of the resumed run; absent in older journals.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        config: Option<serde_json::Value>,
    },
    /// A motor has left its place of rest by more than half the tolerance without a command of the filter. Beyond the
    /// tolerance the filter closes, and `disabled` is recorded instead.
    Displaced {
        /// Robot.
        robot: String,
        /// The motor's name.
        motor: String,
        /// How far it has moved, rad of encoder.
        by: f64,
        /// What it counts.
        #[serde(default, skip_serializing_if = "JointMotion::is_turn")]
        motion: JointMotion,
    },
    /// How a robot's driver found its motors, recorded before any of them is commanded.
    Found {
        /// Robot.
        robot: String,
        /// Its motors, as far as their boards report this.
        motors: Vec<crate::AsFound>,
    },
    /// A robot as its controller knows it, for the checker.
    Robot {
        /// Its name.
        robot: String,
        /// Motor names, in pose order.
        motors: Vec<String>,
        /// Those that slide, by their number: their encoders count millimeters.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        sliding: Vec<usize>,
        /// Lower limits, rad of encoder.
        min: Vec<f64>,
        /// Upper limits, rad.
        max: Vec<f64>,
        /// Maximum speeds, rad/s.
        max_speed: Vec<f64>,
        /// Control period, s.
        period: f64,
        /// Maximum age of a fresh reading, s.
        fresh: f64,
        /// Margin of the reflex, m.
        margin: f64,
        /// Maximum distance per motor at which a pose counts as reached, rad.
        tolerance: f64,
        /// Speed below which a motor counts as at rest, rad/s.
        rest_speed: f64,
        /// The smallest difference that its coarsest encoder shows, rad; absent where all are fine.
        #[serde(default, skip_serializing_if = "is_nothing")]
        resolution: f64,
        /// How far beside its commanded position a motor may rest at most, rad; absent where boards hold exactly.
        #[serde(default, skip_serializing_if = "is_nothing")]
        hold_error: f64,
        /// The greatest distance by which a push moves a motor from its commanded position, rad; absent where nothing is known of it.
        #[serde(default, skip_serializing_if = "is_nothing")]
        deflection: f64,
        /// Its constraints; absent in older journals.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        constraints: Clauses,
    },
    /// The kind of a robot's controller, at the start.
    Controller {
        /// Robot.
        robot: String,
        /// The kind's name, as shown by `mobee kinds`.
        kind: String,
        /// Whether the reflex stops and rolls back motions that come too near. If not, contacts are recorded but stop nothing.
        reflex: bool,
        /// By how much it undoes streams, s; half a second if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        undo: Option<f64>,
        /// Braking clearance with which it looks ahead, m; zero if it does not (Algorithm 6). Absent in older journals.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        clearance: Option<f64>,
        /// Longest time from a reading until the robot has stopped for it, at full speed, s. Absent in older journals.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        stops: Option<f64>,
    },
    /// The filter opened: commands of agents pass from now on, under this token.
    Enabled {
        /// Robot.
        robot: String,
        /// The new token.
        token: u64,
    },
    /// The filter closed: no command of an agent passes, and the reflex writes under this token.
    Disabled {
        /// Robot.
        robot: String,
        /// The new token.
        token: u64,
        /// Why.
        cause: Cause,
    },
    /// The filter's state changed.
    State {
        /// Robot.
        robot: String,
        /// The new state.
        status: Status,
    },
    /// A safe pose was taken (I4).
    SafePose {
        /// Robot.
        robot: String,
        /// The pose, rad.
        q: Pose,
        /// Age of the reading, s.
        age: f64,
        /// Greatest motor speed of the reading, rad/s.
        speed: f64,
        /// Whether it is known to be free of contact; always false under a controller without a reflex.
        free: bool,
    },
    /// The safe pose of a motion moved: to the oldest recorded free pose, if the motion outlasted the history; to an earlier
    /// rest, if during the retreat another robot has to pass where it would stand; or, before the retreat of a stream, to where
    /// the robot was as long before it was stopped as the controller's `undo_s` says.
    SafePoseMoved {
        /// Robot.
        robot: String,
        /// The open commit.
        id: CommitId,
        /// The pose, rad.
        q: Pose,
        /// When that pose of a stream was recorded; only a stream's tells.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        recorded: Option<Time>,
    },
    /// A commit was accepted.
    Commit {
        /// Robot.
        robot: String,
        /// Its number.
        id: CommitId,
        /// The agent.
        agent: String,
        /// The whole target pose, rad.
        target: Pose,
        /// Whether it is an escape from a hold.
        escape: bool,
        /// The motors that it names, by index, each with its maximum permitted speed, rad/s. Every commit names some;
        /// empty in journals older than version 2.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        motors: Vec<(usize, f64)>,
        /// Whether it is a stream of set-points and not a move to the target.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        stream: bool,
    },
    /// A command in mid-motion changed the open commit's target, or more motors joined its stream.
    Amended {
        /// Robot.
        robot: String,
        /// The commit.
        id: CommitId,
        /// The new whole target pose, rad.
        target: Pose,
        /// The motors that it names, by index, each with its maximum permitted speed from now on, rad/s; the others keep
        /// theirs.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        motors: Vec<(usize, f64)>,
        /// Whether set-points did that, and not a move.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        stream: bool,
    },
    /// A commit was refused and changed nothing.
    Refused {
        /// Robot.
        robot: String,
        /// The agent.
        agent: String,
        /// Why.
        refusal: Refusal,
    },
    /// The one outcome of a commit.
    Outcome {
        /// Robot.
        robot: String,
        /// The commit.
        id: CommitId,
        /// How it ended.
        outcome: Outcome,
        /// Where the robot rests, rad.
        q: Pose,
        /// The safe pose it started from, if it had one (escapes have none).
        safe: Option<Pose>,
        /// Why it did not reach its target.
        cause: Option<Cause>,
    },
    /// A command reached the driver (set-points of a stream are summarized in [`Event::Streamed`]).
    Command {
        /// Robot.
        robot: String,
        /// The token it was written under.
        token: u64,
        /// Who wrote it.
        writer: Writer,
        /// What it is.
        kind: CommandKind,
        /// The motors that it names, by index; a stop that names none stops all. Absent in older journals.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        motors: Vec<usize>,
        /// Targets per motor index, rad, if any.
        q: Vec<(usize, f64)>,
        /// Reference speeds per motor index, rad/s, if any.
        speed: Vec<(usize, f64)>,
        /// Whether it is a move that the driver makes of set-points.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        led: bool,
    },
    /// A command arrived under an old token, or did not fit the board, and was discarded.
    CommandDropped {
        /// Robot.
        robot: String,
        /// Its token.
        token: u64,
        /// Who wrote it.
        writer: Writer,
        /// Why.
        reason: String,
    },
    /// A stream of set-points, of positions or of velocities, ended.
    Streamed {
        /// Robot.
        robot: String,
        /// The token it was written under.
        token: u64,
        /// Who wrote it.
        writer: Writer,
        /// The motors that they named, by index. Absent in older journals.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        motors: Vec<usize>,
        /// How many set-points.
        count: u64,
        /// When the first and the last were written.
        span: (Time, Time),
        /// Greatest step of a motor between two set-points, as a share of what its maximum speed allows in that time;
        /// for velocities the greatest share of a motor's maximum speed.
        greatest_step: f64,
        /// Whether every value was finite and within limits.
        within_limits: bool,
        /// The last position written to each motor, by index, rad; none for velocities. Absent in older journals.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        last: Vec<(usize, f64)>,
    },
    /// A contact of a reflex pair began.
    ContactBegan {
        /// Robot.
        robot: String,
        /// The contact.
        contact: Contact,
        /// The names of the two shapes.
        names: (String, String),
        /// The state of the filter at that moment.
        during: Status,
    },
    /// A contact ended.
    ContactEnded {
        /// Robot.
        robot: String,
        /// The names of the two shapes.
        names: (String, String),
        /// Greatest depth of a hard contact, m. Absent if it was not one, and in older journals.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        depth: Option<f64>,
    },
    /// A reflex pair reached distance zero by a motion of the robot; once per contact of the pair.
    HardContact {
        /// Robot.
        robot: String,
        /// The contact.
        contact: Contact,
        /// The names of the two shapes.
        names: (String, String),
    },
    /// A robot has pushed something, as a simulation with forces computes it: reported when it lets go, and in between when it has pushed for a
    /// second.
    Pushed {
        /// Robot.
        robot: String,
        /// The greatest force so far, N.
        newtons: f64,
        /// For how long so far, s.
        secs: f64,
        /// Whether it still pushes.
        lasting: bool,
    },
    /// The retreat begins.
    RetreatBegan {
        /// Robot.
        robot: String,
        /// The commit that is being rolled back.
        id: CommitId,
        /// Number of recorded poses to retrace.
        poses: usize,
        /// Recorded time to retrace, s.
        secs: f64,
        /// Pairs that came below the margin since the filter closed, each at its nearest: during the retreat none of them may
        /// come more than 1 mm nearer than that.
        #[serde(default)]
        near: Vec<Contact>,
    },
    /// The retreat stays where it is, until another robot that is in its way has been taken back.
    RetreatWaits {
        /// Robot.
        robot: String,
        /// What was observed, in words.
        what: String,
        /// The sample that showed it.
        seen: Time,
    },
    /// A retreat that waited goes on.
    RetreatGoesOn {
        /// Robot.
        robot: String,
    },
    /// The retreat was abandoned.
    RetreatStopped {
        /// Robot.
        robot: String,
        /// Why the robot now holds.
        reason: Hold,
        /// What was observed, in words.
        what: String,
        /// The sample that showed it.
        seen: Time,
    },
    /// An object of the world was added, moved, changed or removed.
    World {
        /// Its name.
        object: String,
        /// How it changed.
        what: WorldChange,
        /// Its class now, if it still exists.
        class: Option<mobee_model::ObjectClass>,
        /// Its position now, meters, if it still exists.
        at: Option<[f64; 3]>,
    },
    /// An agent's note.
    Note {
        /// Robot.
        robot: String,
        /// The note.
        note: Note,
    },
    /// An agent has nothing more to do.
    Done {
        /// Robot.
        robot: String,
        /// Its summary.
        summary: Summary,
    },
    /// The built-in agent was told how its motion ended, and asked what comes next.
    Told {
        /// Robot.
        robot: String,
        /// The motion's commit; none if it was refused.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        id: Option<CommitId>,
        /// What it was told.
        end: MotionEnd,
    },
    /// The built-in agent may act again, or pauses for another agent.
    AgentActs {
        /// Robot.
        robot: String,
        /// Whether it may make motions.
        acts: bool,
    },
    /// A person halted the robot: until `Released` nothing moves it. Recorded again by a part that is restarted meanwhile.
    Halted {
        /// Robot.
        robot: String,
    },
    /// A person released the robot.
    Released {
        /// Robot.
        robot: String,
    },
    /// A part of a running robot is being swapped.
    Swap {
        /// Robot.
        robot: String,
        /// Which part.
        part: SwapPart,
        /// The step reached.
        #[serde(flatten)]
        step: SwapStep,
    },
    /// A part that runs beside the robots is being swapped.
    SwapBeside {
        /// The name of the bridge, of the camera whose detector it is, or of the sensor whose locator.
        name: String,
        /// Which part.
        part: SwapPart,
        /// The step reached.
        #[serde(flatten)]
        step: SwapStep,
    },
    /// What an agent that only observes would have done; none of it is carried out.
    Shadow {
        /// Robot.
        robot: String,
        /// What it would have done.
        intent: IntentKind,
        /// Targets per motor index, rad, if it is a move.
        q: Vec<(usize, f64)>,
    },
    /// A detector has looked at a frame.
    Sighted {
        /// The camera.
        camera: String,
        /// When the frame was exposed.
        exposed: Time,
        /// What it shows: the first regions of each object, as many as the sensor may report.
        regions: Vec<Region>,
        /// The number of regions that were left out, since they were more.
        #[serde(default, skip_serializing_if = "is_zero")]
        omitted: u64,
        /// Whether a new detector saw it that only looks on so far.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        is_shadow: bool,
    },
    /// A locator has placed what a detector saw.
    Located {
        /// The sensor.
        sensor: String,
        /// When the frame was exposed.
        exposed: Time,
        /// What is where.
        objects: Vec<Located>,
        /// What became of each of them at the world gate, in their order; none if there is no gate.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        admissions: Vec<Admission>,
    },
    /// An object has not been seen for so long that the model may have it at the wrong place.
    Stale {
        /// The sensor that keeps it.
        sensor: String,
        /// The object.
        object: String,
    },
    /// An actor died.
    Died {
        /// Its name.
        actor: String,
        /// The cause.
        reason: String,
    },
    /// An actor was restarted.
    Restarted {
        /// Its name.
        actor: String,
        /// Restarts within the intensity period, including this one.
        restarts: u32,
    },
    /// A group's restart budget is used up: it stays down.
    GaveUp {
        /// The group's name.
        group: String,
    },
    /// A fault was injected (simulation only).
    Injected {
        /// The fault, in words.
        fault: String,
    },
    /// Something needs attention.
    Warning {
        /// In words, with a remedy.
        text: String,
    },
    /// The counters of a link at the end of the run (I6): sent = handled + queued + dropped.
    Link {
        /// Its name.
        link: String,
        /// Sent.
        sent: u64,
        /// Handled.
        handled: u64,
        /// Still queued.
        queued: u64,
        /// Discarded, by design or by a restart.
        dropped: u64,
        /// The most items waiting at once; 0 if not measured.
        #[serde(default)]
        most: u64,
        /// How many items may wait (I7); 0 if not recorded.
        #[serde(default)]
        capacity: u64,
    },
    /// A step of the motion to a robot's rest pose, at the end of a run.
    Rest {
        /// Robot.
        robot: String,
        /// The step.
        step: RestStep,
    },
    /// Last event: the run ended in an orderly way.
    Ended {
        /// Why: `done`, `time`, `interrupted`, `gave up`.
        reason: String,
    },
}

/// Whether a field is left out of the journal.
fn is_zero(n: &u64) -> bool {
    *n == 0
}
