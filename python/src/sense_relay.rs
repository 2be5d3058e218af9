//! The detectors and locators of a run that pass each call on to Python code. No Python here.
//!
//! ```text
//! detector's shell ──Frame──────> RelaySense ══Question══> thread of Python ──regions──> RelaySense ──> detector's shell
//! locator's shell  ──Sightings──> RelaySense ══Question══> thread of Python ──places───> RelaySense ──> locator's shell
//! ```
//!
//! In virtual time the relay waits for the reply and the clock stands; then the stated duration of the call passes. In real time the shell
//! waits on a thread of its own, and drops the frames in between. Sensing is not part of the pulse.

use crate::relay::{RelayLine, RunMessage};
use mobee_contract::{BodyState, Detector, Frame, Located, Locator, Refusal, Region, Sighting, Snapshot};
use serde_json::Value;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

/// Period of looking whether the run is being ended.
const POLL: Duration = Duration::from_millis(10);
/// Version of the states of detectors and locators in Python.
const STATE_VERSION: u32 = 1;

/// A call to the code outside.
pub(crate) enum SenseQuestion {
    /// The regions of a frame.
    Detect(Frame),
    /// The positions of what a camera detected; the robot with this index carries it.
    Locate { seen: Vec<Sighting>, body: BodyState, robot: usize },
}

/// Code that a call is for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct SenseName {
    /// The key under which it was passed.
    pub key: String,
    /// The camera of a detector (`<sensor>/<camera>`), the sensor of a locator.
    pub part: Arc<str>,
}

/// A call with where its reply goes.
pub(crate) struct PendingSense {
    pub question: SenseQuestion,
    pub name: SenseName,
    /// Number of its lives before this one.
    pub life: u32,
    /// A state to take over first.
    pub import: Option<Value>,
    /// An error is its death, in words.
    pub reply: SyncSender<Result<SenseReply, String>>,
}

/// A reply.
pub(crate) struct SenseReply {
    pub found: SenseFound,
    /// Duration of the call by a virtual clock.
    pub takes: Duration,
    /// Its state after it.
    pub state: Value,
}

/// Results of a call.
pub(crate) enum SenseFound {
    Regions(Vec<Region>),
    Places(Vec<Located>),
}

/// The detector or locator in the run.
pub(crate) struct RelaySense<E> {
    line: RelayLine<E>,
    name: SenseName,
    /// Of a locator: the robot that carries the cameras.
    robot: usize,
    life: u32,
    state: Value,
    import: Option<Value>,
    takes: Duration,
    failure: Option<String>,
}

impl<E: Send + 'static> RelaySense<E> {
    /// In its first life, or in the next one after a death.
    pub fn new(line: &RelayLine<E>, name: &SenseName, robot: usize) -> Self {
        let (line, name, life) = (line.clone(), name.clone(), line.begin_life());
        Self { line, name, robot, life, state: Value::Null, import: None, takes: Duration::ZERO, failure: None }
    }

    /// The results of a call; `None` if the run is being ended.
    ///
    /// # Errors
    /// Its death, in words.
    fn call(&mut self, question: SenseQuestion) -> Result<Option<SenseFound>, String> {
        if self.line.cancelled.is_set() {
            return Ok(None);
        }
        let (reply, replied) = sync_channel(1);
        let (name, life, import) = (self.name.clone(), self.life, self.import.take());
        let pending = PendingSense { question, name, life, import, reply };
        match self.line.questions.try_send(RunMessage::Sense(Box::new(pending))) {
            Ok(()) => {}
            Err(TrySendError::Disconnected(_)) => return Ok(None),
            Err(TrySendError::Full(_)) => return Err("too many calls wait for Python".to_owned()),
        }
        let Some(reply) = self.wait(&replied)? else { return Ok(None) };
        (self.takes, self.state) = (reply.takes, reply.state);
        Ok(Some(reply.found))
    }

    fn wait(&self, replied: &Receiver<Result<SenseReply, String>>) -> Result<Option<SenseReply>, String> {
        loop {
            match replied.recv_timeout(POLL) {
                Ok(reply) => return reply.map(Some),
                Err(RecvTimeoutError::Disconnected) => return Ok(None),
                Err(RecvTimeoutError::Timeout) if self.line.cancelled.is_set() => return Ok(None),
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
    }

    fn snapshot(&self) -> Option<Snapshot> {
        let state =
            || Snapshot { kind: mobee::kinds::PYTHON.into(), version: STATE_VERSION, state: self.state.clone() };
        (!self.state.is_null()).then(state)
    }

    fn take_over(&mut self, from: Snapshot) -> Result<(), Refusal> {
        if from.kind != mobee::kinds::PYTHON || from.version != STATE_VERSION {
            let what = format!("it is of kind {}, version {}", from.kind, from.version);
            return Err(Refusal::State { what });
        }
        self.state = from.state.clone();
        self.import = Some(from.state);
        Ok(())
    }
}

impl<E: Send + 'static> Detector for RelaySense<E> {
    fn detect(&mut self, frame: &Frame) -> Vec<Region> {
        match self.call(SenseQuestion::Detect(frame.clone())) {
            Ok(Some(SenseFound::Regions(regions))) => regions,
            Ok(_) => Vec::new(),
            Err(why) => {
                self.failure = Some(why);
                Vec::new()
            }
        }
    }

    fn failure(&mut self) -> Option<String> {
        self.failure.take()
    }

    fn takes(&self) -> Duration {
        self.takes
    }

    fn export(&self) -> Option<Snapshot> {
        self.snapshot()
    }

    fn import(&mut self, from: Snapshot) -> Result<(), Refusal> {
        self.take_over(from)
    }
}

impl<E: Send + 'static> Locator for RelaySense<E> {
    fn locate(&mut self, seen: &[Sighting], body: &BodyState) -> Vec<Located> {
        let question = SenseQuestion::Locate { seen: seen.to_vec(), body: body.clone(), robot: self.robot };
        match self.call(question) {
            Ok(Some(SenseFound::Places(places))) => places,
            Ok(_) => Vec::new(),
            // the locator's death: its actor ends, and supervision starts it again
            Err(why) => std::panic::resume_unwind(Box::new(why)),
        }
    }

    fn takes(&self) -> Duration {
        self.takes
    }

    fn export(&self) -> Option<Snapshot> {
        self.snapshot()
    }

    fn import(&mut self, from: Snapshot) -> Result<(), Refusal> {
        self.take_over(from)
    }
}
