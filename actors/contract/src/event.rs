//! The events that a run records.

use crate::{
    Admission, Cause, CommandKind, CommitId, Hold, IntentKind, Located, MotionEnd, Note, Outcome, Pose, Refusal,
    Region, RestStep, Status, Summary, SwapPart, SwapStep, Time,
};
use mobee_model::{Contact, JointMotion};
use serde::{Deserialize, Serialize};

/// Writer of a command to a driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Writer {
    /// An agent, through the filtered interface.
    Agent,
    /// The reflex.
    Reflex,
    /// Supervise on its own behalf: the stop when it closes the filter, and the control modes before it reopens it.
    /// Older journals attribute these to the reflex.
    Supervise,
    /// The driver itself: the stop that follows every start.
    Driver,
}

/// Change of an object of the world.
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
    /// Word shown to users.
    pub fn word(self) -> &'static str {
        match self {
            WorldChange::Added => "added",
            WorldChange::Moved => "moved",
            WorldChange::Changed => "changed",
            WorldChange::Removed => "removed",
        }
    }
}

/// Returns whether a value is omitted from the journal.
fn is_nothing(x: &f64) -> bool {
    *x == 0.0
}

/// A robot's constraints: every clause must hold. A clause holds if one of its members has a positive value. This is
/// the sum of the member's coefficients, each times the position of the motor with the given index (degrees), plus
/// its constant.
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
        /// Number of events recorded before.
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
        /// Displacement, rad of encoder.
        by: f64,
        /// Kind of the joint.
        #[serde(default, skip_serializing_if = "JointMotion::is_turn")]
        motion: JointMotion,
    },
    /// State of a robot's motors before the first command, as found by its driver.
    Found {
        /// Robot.
        robot: String,
        /// Its motors, as far as their boards report this.
        motors: Vec<crate::AsFound>,
    },
    /// Description of a robot and its controller, for the checker.
    Robot {
        /// Name of the robot.
        robot: String,
        /// Motor names, in the order of configurations.
        motors: Vec<String>,
        /// Indices of the prismatic joints: their encoders count millimeters.
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
        /// Maximum distance per motor at which a configuration counts as reached, rad.
        tolerance: f64,
        /// Speed below which a motor counts as at rest, rad/s.
        rest_speed: f64,
        /// Resolution of its coarsest encoder, rad; absent if all are fine.
        #[serde(default, skip_serializing_if = "is_nothing")]
        resolution: f64,
        /// Greatest error between a motor at rest and its commanded position, rad; absent if boards hold exactly.
        #[serde(default, skip_serializing_if = "is_nothing")]
        hold_error: f64,
        /// Greatest distance by which a push moves a motor from its commanded position, rad; absent if unknown.
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
        /// True if the reflex stops and rolls back motions when a pair gets too close. If not, contacts are recorded
        /// but stop nothing.
        reflex: bool,
        /// Time by which it undoes streams, s; half a second if absent.
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
        /// Cause.
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
        /// Configuration, rad.
        q: Pose,
        /// Age of the reading, s.
        age: f64,
        /// Greatest motor speed of the reading, rad/s.
        speed: f64,
        /// True if it is known to be free of contact; always false under a controller without a reflex.
        free: bool,
    },
    /// The safe pose of a motion moved: to the oldest recorded free configuration, if the motion outlasted the
    /// history; to an earlier rest, if during the retreat another robot has to pass where this one would stand; or,
    /// before the retreat of a stream, back by the controller's `undo_s` from the stop.
    SafePoseMoved {
        /// Robot.
        robot: String,
        /// The open commit.
        id: CommitId,
        /// Configuration, rad.
        q: Pose,
        /// Time at which that configuration was recorded; only for a stream.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        recorded: Option<Time>,
    },
    /// A commit was accepted.
    Commit {
        /// Robot.
        robot: String,
        /// Number of the commit.
        id: CommitId,
        /// Agent that committed it.
        agent: String,
        /// Whole target configuration, rad.
        target: Pose,
        /// True if it is an escape from a hold.
        escape: bool,
        /// Motors that it names, by index, each with its maximum permitted speed, rad/s. Every commit names some;
        /// empty in journals older than version 2.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        motors: Vec<(usize, f64)>,
        /// True if it is a stream of set-points and not a move to the target.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        stream: bool,
    },
    /// A command in mid-motion changed the open commit's target, or more motors joined its stream.
    Amended {
        /// Robot.
        robot: String,
        /// Number of the commit.
        id: CommitId,
        /// New whole target configuration, rad.
        target: Pose,
        /// Motors that it names, by index, each with its maximum permitted speed from now on, rad/s; the speeds of
        /// the others are unchanged.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        motors: Vec<(usize, f64)>,
        /// True if set-points caused the change, and not a move.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        stream: bool,
    },
    /// A commit was refused and changed nothing.
    Refused {
        /// Robot.
        robot: String,
        /// Committing agent.
        agent: String,
        /// Reason.
        refusal: Refusal,
    },
    /// The single outcome of a commit.
    Outcome {
        /// Robot.
        robot: String,
        /// The commit.
        id: CommitId,
        /// Outcome.
        outcome: Outcome,
        /// Configuration at rest, rad.
        q: Pose,
        /// Safe pose of the motion; escapes have none.
        safe: Option<Pose>,
        /// Reason for not reaching the target.
        cause: Option<Cause>,
    },
    /// A command reached the driver (set-points of a stream are summarized in [`Event::Streamed`]).
    Command {
        /// Robot.
        robot: String,
        /// Token that it was written under.
        token: u64,
        /// Writer.
        writer: Writer,
        /// Kind.
        kind: CommandKind,
        /// Motors that it names, by index; a stop that names none stops all. Absent in older journals.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        motors: Vec<usize>,
        /// Targets per motor index, rad, if any.
        q: Vec<(usize, f64)>,
        /// Reference speeds per motor index, rad/s, if any.
        speed: Vec<(usize, f64)>,
        /// True if it is a move that the driver converts to set-points.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        led: bool,
    },
    /// A command arrived under an old token, or did not fit the board, and was discarded.
    CommandDropped {
        /// Robot.
        robot: String,
        /// Token that it was written under.
        token: u64,
        /// Writer.
        writer: Writer,
        /// Reason.
        reason: String,
    },
    /// A stream of set-points, of positions or of velocities, ended.
    Streamed {
        /// Robot.
        robot: String,
        /// Token that it was written under.
        token: u64,
        /// Writer.
        writer: Writer,
        /// Motors that they named, by index. Absent in older journals.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        motors: Vec<usize>,
        /// Number of set-points.
        count: u64,
        /// Times of the first and the last set-point.
        span: (Time, Time),
        /// Greatest step of a motor between two set-points, as a share of what its maximum speed allows in that time;
        /// for velocities the greatest share of a motor's maximum speed.
        greatest_step: f64,
        /// True if every value was finite and within limits.
        within_limits: bool,
        /// Last position written to each motor, by index, rad; empty for velocities. Absent in older journals.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        last: Vec<(usize, f64)>,
    },
    /// A contact of a reflex pair began.
    ContactBegan {
        /// Robot.
        robot: String,
        /// The contact.
        contact: Contact,
        /// Names of the two shapes.
        names: (String, String),
        /// State of the filter at that time.
        during: Status,
    },
    /// A contact ended.
    ContactEnded {
        /// Robot.
        robot: String,
        /// Names of the two shapes.
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
        /// Names of the two shapes.
        names: (String, String),
    },
    /// A robot has pushed an obstacle, as computed by a simulation with forces: reported at the end of the contact,
    /// and after a second of pushing.
    Pushed {
        /// Robot.
        robot: String,
        /// Greatest force so far, N.
        newtons: f64,
        /// Time with a force above 5 N so far, s.
        secs: f64,
        /// True if it still pushes.
        lasting: bool,
    },
    /// Readings were missing, and the history bridges the gap by the path that was commanded.
    Bridged {
        /// Robot.
        robot: String,
        /// Time of the last reading before the gap.
        since: Time,
        /// Time of the first reading after it.
        until: Time,
        /// Number of configurations that stand for the missing readings.
        poses: usize,
    },
    /// The retreat begins.
    RetreatBegan {
        /// Robot.
        robot: String,
        /// Number of the commit that is being rolled back.
        id: CommitId,
        /// Number of recorded configurations to retrace.
        poses: usize,
        /// Recorded time to retrace, s.
        secs: f64,
        /// Pairs that came below the margin since the filter closed, each at its least distance: during the retreat,
        /// none of them may get more than 1 mm closer than that.
        #[serde(default)]
        near: Vec<Contact>,
    },
    /// The retreat also moves motors that the motion did not name and a contact has bent.
    RetreatJoined {
        /// Robot.
        robot: String,
        /// Number of the commit that is being rolled back.
        id: CommitId,
        /// Indices of these motors.
        motors: Vec<usize>,
    },
    /// The retreat waits where it is, until another robot that blocks it has retreated.
    RetreatWaits {
        /// Robot.
        robot: String,
        /// Observation, in words.
        what: String,
        /// Time of the sample that showed it.
        seen: Time,
    },
    /// A retreat that waited goes on.
    RetreatGoesOn {
        /// Robot.
        robot: String,
    },
    /// The retreat was aborted.
    RetreatStopped {
        /// Robot.
        robot: String,
        /// Reason of the robot's hold.
        reason: Hold,
        /// Observation, in words.
        what: String,
        /// Time of the sample that showed it.
        seen: Time,
    },
    /// An object of the world was added, moved, changed or removed.
    World {
        /// Name of the object.
        object: String,
        /// Kind of the change.
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
    /// The built-in agent was notified of the end of its motion, and returned its next intent.
    Told {
        /// Robot.
        robot: String,
        /// Commit of the motion; absent if it was refused.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        id: Option<CommitId>,
        /// Reported end.
        end: MotionEnd,
    },
    /// The built-in agent may act again, or pauses for another agent.
    AgentActs {
        /// Robot.
        robot: String,
        /// True if it may make motions.
        acts: bool,
    },
    /// A person halted the robot: until `Released` nothing moves it. Recorded again by a part that is restarted in
    /// between.
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
        /// Part that is being swapped.
        part: SwapPart,
        /// The step reached.
        #[serde(flatten)]
        step: SwapStep,
    },
    /// A part that runs beside the robots is being swapped.
    SwapBeside {
        /// Name of the bridge, of the camera of the detector, or of the sensor of the locator.
        name: String,
        /// Part that is being swapped.
        part: SwapPart,
        /// The step reached.
        #[serde(flatten)]
        step: SwapStep,
    },
    /// Intent of an agent that only observes; it is not carried out.
    Shadow {
        /// Robot.
        robot: String,
        /// Kind of the intent.
        intent: IntentKind,
        /// Targets per motor index, rad, if it is a move.
        q: Vec<(usize, f64)>,
    },
    /// A detector has processed a frame.
    Sighted {
        /// Name of the camera.
        camera: String,
        /// Exposure time of the frame.
        exposed: Time,
        /// Regions found: the first ones of each object, as many as the sensor may report.
        regions: Vec<Region>,
        /// Number of omitted regions beyond that limit.
        #[serde(default, skip_serializing_if = "is_zero")]
        omitted: u64,
        /// True if a new detector found them that only observes so far.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        is_shadow: bool,
    },
    /// A locator has located the regions of a detector.
    Located {
        /// Name of the sensor.
        sensor: String,
        /// Exposure time of the frame.
        exposed: Time,
        /// Positions of the objects.
        objects: Vec<Located>,
        /// Decisions of the world gate on each of them, in their order; empty without a gate.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        admissions: Vec<Admission>,
    },
    /// An object has not been observed for so long that its position in the model may be wrong.
    Stale {
        /// Sensor that tracks it.
        sensor: String,
        /// Name of the object.
        object: String,
    },
    /// An actor died.
    Died {
        /// Name of the actor.
        actor: String,
        /// The cause.
        reason: String,
    },
    /// An actor was restarted.
    Restarted {
        /// Name of the actor.
        actor: String,
        /// Restarts within the intensity period, including this one.
        restarts: u32,
    },
    /// A group has used up its restart budget: it stays down.
    GaveUp {
        /// Name of the group.
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
        /// Name of the link.
        link: String,
        /// Sent.
        sent: u64,
        /// Handled.
        handled: u64,
        /// Still queued.
        queued: u64,
        /// Discarded, by design or by a restart.
        dropped: u64,
        /// Greatest number of waiting items; 0 if not measured.
        #[serde(default)]
        most: u64,
        /// Capacity of the queue (I7); 0 if not recorded.
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
        /// Reason: `done`, `time`, `interrupted`, `gave up`.
        reason: String,
    },
}

/// Returns whether a field is omitted from the journal.
fn is_zero(n: &u64) -> bool {
    *n == 0
}
