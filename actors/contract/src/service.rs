//! What programs outside the safety chain may do with a running system: a port filter, the world's RPC, a panel.
//!
//! A service sees robots only through their filtered interface (paper, fig. 3): it commits, as any agent does.

use crate::{
    Board, Commit, CommitId, DriverFault, Event, KindError, MotionEnd, NativeMessage, NativeState, Pose, Refusal,
    Setpoints, Status, Time, Verdict,
};
use mobee_model::{Contact, Edit, Robot, Scene};
use std::collections::BTreeSet;
use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;

/// An answer that comes later.
pub type Answer<T> = Pin<Box<dyn Future<Output = T> + Send>>;

/// What a robot's readers may know at any time.
#[derive(Clone, Debug)]
pub struct Latest {
    /// When the reading was taken.
    pub at: Time,
    /// The pose, rad.
    pub q: Pose,
    /// The contacts that an agent may learn from.
    pub contacts: Arc<[Contact]>,
    /// The filter's state.
    pub status: Status,
    /// Whether the filter takes commits: at rest with every outcome given.
    pub ready: bool,
}

/// One robot through its filtered interface.
pub trait Filtered: Send + Sync {
    /// Its name in the run.
    fn name(&self) -> &str;
    /// Its index among the robots of the scene.
    fn index(&self) -> usize;
    /// Its board.
    fn board(&self) -> &Board;
    /// Its newest reading and state.
    fn latest(&self) -> Latest;
    /// Commits a motion: a new transaction at rest, an amendment in mid-motion.
    fn commit(&self, commit: Commit) -> Answer<Verdict>;
    /// Streams set-points: the first opens a transaction, each of the next amends it, and when they go quiet the robot
    /// brakes and the transaction ends where it then rests. Positions that jump farther than a motor can follow are
    /// refused; velocities are lowered to what a motor can do, and to what still brakes before its limit. Refused with
    /// [`Refusal::Holding`] while the robot holds: an escape is a commit.
    fn stream(&self, agent: Arc<str>, setpoints: Setpoints) -> Answer<Verdict>;
    /// Brakes the agent's motion; it then ends as failed.
    fn stop(&self, agent: Arc<str>);
    /// How an accepted motion ended; `None` while it is under way. Ends older than the newest hundred are `Failed`.
    fn end_of(&self, id: CommitId) -> Option<MotionEnd>;
    /// The robot's motors that brought together what touched in a motion that failed by contact; `None` if it failed by something
    /// else, did not fail, or is not remembered.
    fn to_blame(&self, id: CommitId) -> Option<BTreeSet<usize>>;
    /// Lets the built-in agent make motions, or (at the end of its present one) makes it pause for another.
    ///
    /// # Errors
    /// [`Refusal::NotReady`] if the robot has no agent of its own.
    fn let_agent_act(&self, act: bool) -> Result<(), Refusal>;
    /// Tries a failed retreat again.
    ///
    /// # Errors
    /// There is none; a sentence says why the robot holds, if it does, and what opens its filter.
    fn recover(&self) -> Result<(), String>;
    /// Stops the robot: its filter closes, the motion under way ends with an outcome, a retreat stops where it is, and
    /// nothing moves the robot until [`Filtered::release`].
    ///
    /// # Errors
    /// If the caller's access was revoked.
    fn halt(&self) -> Result<(), String>;
    /// Lets a halted robot act again. Its filter opens by a fresh reading at rest, free of contact.
    ///
    /// # Errors
    /// Why it can't be released, as a sentence.
    fn release(&self) -> Result<(), String>;
    /// Whether the robot is halted.
    fn is_halted(&self) -> bool;
    /// Passes a question through to a part's board; see [`crate::Hardware::passthrough`].
    fn passthrough(&self, part: &str, request: NativeMessage) -> Option<Answer<Result<NativeMessage, DriverFault>>>;
    /// The newest state of a part's board in its own protocol; see [`crate::Hardware::native_state`].
    fn native_state(&self, part: &str) -> Option<NativeState>;
}

/// Robots and world of a running system.
pub trait Running: Send + Sync {
    /// The time of the run.
    fn now(&self) -> Time;
    /// The time of day when the run's clock shows this, seconds since 1970; on a virtual clock the run's own time.
    fn time_of_day(&self, at: Time) -> f64;
    /// The robots, in the scene's order.
    fn robots(&self) -> &[Arc<dyn Filtered>];
    /// The robots' models, in the same order.
    fn models(&self) -> Vec<Arc<Robot>>;
    /// Waits, by the run's clock, until it shows this; not at all if that is past.
    fn sleep_until(&self, at: Time) -> Answer<()>;
    /// Robots and world now.
    fn scene(&self) -> Arc<Scene>;
    /// Changes the world; answered when the change is in force.
    fn edit(&self, edit: Edit) -> Answer<Result<(), String>>;
    /// Tells the taps.
    fn tell(&self, event: Event);
}

/// Something that runs beside the safety chain until the run ends: on a thread of its own by a real clock, supervised in any case.
///
/// This is what each of its lives begins from. A life that ends by an error or a panic, or blocks its thread for long, is over: what it has
/// under way is taken back, and it is served anew.
pub trait Service: Send + Sync {
    /// Its name, for supervision and warnings.
    fn name(&self) -> String;
    /// Whether the run goes on for it although all agents are done, until it ends in order: somebody may still want to move the robots
    /// through it.
    fn keeps_run(&self) -> bool {
        true
    }
    /// Whether it may run in virtual time: it knows no time but that of [`Running`], and nothing outside of the run.
    fn runs_in_virtual_time(&self) -> bool {
        false
    }

    /// Checks, before anything of a run moves, that it can serve these robots: that what it needs of the outside, such as the
    /// names of its ports, is free.
    ///
    /// # Errors
    /// Why it can't serve, as a sentence with its remedy. The run does not begin then.
    fn prepare(self: Arc<Self>, _robots: Vec<Arc<Robot>>) -> Answer<Result<(), String>> {
        Box::pin(std::future::ready(Ok(())))
    }

    /// One life: serves until `until` is ready, then leaves in order. Called within a tokio runtime with network and timers. Who has no more
    /// to do may leave before, and is not served again.
    ///
    /// # Errors
    /// Why it can't serve, as a sentence with its remedy. It is then tried again, a few times.
    fn serve(self: Arc<Self>, running: Arc<dyn Running>, until: Answer<()>) -> Answer<Result<(), String>>;
}

/// A service that a configuration file names, by its kind: a bridge to programs outside, which commit through it as agents do.
pub trait Bridge: Service {
    /// Checks the robots, parts and motors that its settings name against those there are.
    ///
    /// # Errors
    /// Every name that is none; paths are those of the settings.
    fn check(&self, _robots: &[Arc<Robot>]) -> Result<(), KindError> {
        Ok(())
    }
    /// The share of each motor's greatest speed at which programs may move robots through it, so that the margin can be judged by it.
    /// `None`: nobody moves anything through it, or it is not known how fast.
    fn speed(&self) -> Option<f64> {
        None
    }
    /// What it serves to programs outside for these robots, for people: the names of its ports, for instance.
    fn serves(&self, _robots: &[Arc<Robot>]) -> Vec<String> {
        Vec::new()
    }
}
