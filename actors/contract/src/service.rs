//! Interface of a running system for programs outside the safety chain: a port filter, the world's RPC, a panel.
//!
//! A service accesses robots only through their filtered interface (paper, fig. 3): it commits, as any agent does.

use crate::{
    Board, Commit, CommitId, DriverFault, Event, KindError, MotionEnd, NativeMessage, NativeState, Pose, Refusal,
    Setpoints, Status, Time, Verdict,
};
use mobee_model::{Contact, Edit, Robot, Scene};
use std::collections::BTreeSet;
use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;

/// Asynchronous answer.
pub type Answer<T> = Pin<Box<dyn Future<Output = T> + Send>>;

/// Present state of a robot, readable at any time.
#[derive(Clone, Debug)]
pub struct Latest {
    /// Time of the reading.
    pub at: Time,
    /// Configuration, rad.
    pub q: Pose,
    /// Contacts that an agent may learn from.
    pub contacts: Arc<[Contact]>,
    /// State of the filter.
    pub status: Status,
    /// True if the filter accepts commits: at rest with every outcome given.
    pub ready: bool,
}

/// Filtered interface of one robot.
pub trait Filtered: Send + Sync {
    /// Name in the run.
    fn name(&self) -> &str;
    /// Index among the robots of the scene.
    fn index(&self) -> usize;
    /// Its board.
    fn board(&self) -> &Board;
    /// Newest reading and state.
    fn latest(&self) -> Latest;
    /// Commits a motion: a new transaction at rest, an amendment in mid-motion.
    fn commit(&self, commit: Commit) -> Answer<Verdict>;
    /// Streams set-points: the first opens a transaction, and each further one amends it. When there are no more, the
    /// robot brakes and the transaction ends where it rests. Positions that jump farther than a motor can follow are
    /// refused; velocities are lowered to the motor's greatest speed, and to the speed from which it can brake before
    /// its limit. Refused with [`Refusal::Holding`] while the robot holds: an escape is a commit.
    fn stream(&self, agent: Arc<str>, setpoints: Setpoints) -> Answer<Verdict>;
    /// Brakes the agent's motion; it then ends as failed.
    fn stop(&self, agent: Arc<str>);
    /// End of an accepted motion; `None` while it is in progress. Ends older than the newest hundred are `Failed`.
    fn end_of(&self, id: CommitId) -> Option<MotionEnd>;
    /// Motors of the robot that caused the contact in a motion that failed by contact; `None` if it failed by
    /// something else, did not fail, or is not remembered.
    fn to_blame(&self, id: CommitId) -> Option<BTreeSet<usize>>;
    /// Allows the built-in agent to make motions, or (at the end of its present one) pauses it for another agent.
    ///
    /// # Errors
    /// [`Refusal::NotReady`] if the robot has no agent of its own.
    fn let_agent_act(&self, act: bool) -> Result<(), Refusal>;
    /// Retries a failed retreat.
    ///
    /// # Errors
    /// If there is none: a sentence that states why the robot holds, if it does, and how its filter can be opened.
    fn recover(&self) -> Result<(), String>;
    /// Halts the robot: its filter closes, the motion in progress ends with an outcome, a retreat stops where it is,
    /// and nothing moves the robot until [`Filtered::release`].
    ///
    /// # Errors
    /// If the caller's access was revoked.
    fn halt(&self) -> Result<(), String>;
    /// Releases a halted robot. Its filter opens by a fresh reading at rest, free of contact.
    ///
    /// # Errors
    /// The reason why it can't be released, as a sentence.
    fn release(&self) -> Result<(), String>;
    /// Returns whether the robot is halted.
    fn is_halted(&self) -> bool;
    /// Passes a query through to a part's board; see [`crate::Hardware::passthrough`].
    fn passthrough(&self, part: &str, request: NativeMessage) -> Option<Answer<Result<NativeMessage, DriverFault>>>;
    /// Newest state of a part's board in its own protocol; see [`crate::Hardware::native_state`].
    fn native_state(&self, part: &str) -> Option<NativeState>;
}

/// Robots and world of a running system.
pub trait Running: Send + Sync {
    /// Time of the run.
    fn now(&self) -> Time;
    /// Time of day at this time of the run, seconds since 1970; on a virtual clock the run's own time.
    fn time_of_day(&self, at: Time) -> f64;
    /// Robots, in the scene's order.
    fn robots(&self) -> &[Arc<dyn Filtered>];
    /// Models of the robots, in the same order.
    fn models(&self) -> Vec<Arc<Robot>>;
    /// Waits until this time by the run's clock; returns at once if it has passed.
    fn sleep_until(&self, at: Time) -> Answer<()>;
    /// Present robots and world.
    fn scene(&self) -> Arc<Scene>;
    /// Changes the world; answers when the change is in force.
    fn edit(&self, edit: Edit) -> Answer<Result<(), String>>;
    /// Publishes an event.
    fn tell(&self, event: Event);
}

/// Component that runs beside the safety chain until the run ends: with a real clock on its own thread, and always
/// supervised.
///
/// A value of this type starts each instance of the service. An instance that ends by an error or a panic, or blocks
/// its thread for long, is over: its motions in progress are rolled back, and it is started again.
pub trait Service: Send + Sync {
    /// Name, for supervision and warnings.
    fn name(&self) -> String;
    /// Returns whether the run continues for it although all agents are done, until the service ends: a program may
    /// still move the robots through it.
    fn keeps_run(&self) -> bool {
        true
    }
    /// Returns whether it may run in virtual time: it uses no time but that of [`Running`], and nothing outside the
    /// run.
    fn runs_in_virtual_time(&self) -> bool {
        false
    }

    /// Checks, before any motion of a run, that it can serve these robots: that the external resources it needs, such
    /// as the names of its ports, are free.
    ///
    /// # Errors
    /// The reason why it can't serve, as a sentence with its remedy. The run is then not started.
    fn prepare(self: Arc<Self>, _robots: Vec<Arc<Robot>>) -> Answer<Result<(), String>> {
        Box::pin(std::future::ready(Ok(())))
    }

    /// Serves until `until` is ready, then ends in order. Called within a tokio runtime with network and timers. A
    /// service that has nothing more to do may end earlier, and is not started again.
    ///
    /// # Errors
    /// The reason why it can't serve, as a sentence with its remedy. It is then tried again, a few times.
    fn serve(self: Arc<Self>, running: Arc<dyn Running>, until: Answer<()>) -> Answer<Result<(), String>>;
}

/// Service that a configuration file names by its kind: a bridge to external programs, which commit through it as
/// agents do.
pub trait Bridge: Service {
    /// Checks the robots, parts and motors that its settings name against those there are.
    ///
    /// # Errors
    /// Every name that does not exist; paths are those of the settings.
    fn check(&self, _robots: &[Arc<Robot>]) -> Result<(), KindError> {
        Ok(())
    }
    /// Share of each motor's greatest speed at which programs may move robots through it, for checking the margin.
    /// `None`: no program moves robots through it, or the speed is unknown.
    fn speed(&self) -> Option<f64> {
        None
    }
    /// Services that it offers to external programs for these robots, for people: for example the names of its ports.
    fn serves(&self, _robots: &[Arc<Robot>]) -> Vec<String> {
        Vec::new()
    }
}
