//! The agent of a run that passes each question on: to Python code, or to the steps of an environment. No Python here.
//!
//! ```text
//! agent's shell ──next──> RelayAgent ══Question══> thread of Python ──Reply──> RelayAgent ──Intent──> agent's shell
//! ```
//!
//! In virtual time the relay waits for the reply, and the clock stands. In real time it waits for some milliseconds and then returns
//! `Wait`: Python code delays its own motions alone, and no part of the run waits for it.

use crate::sense_relay::PendingSense;
use crate::wait::Cancelled;
use mobee_contract::{Agent, Intent, MotionEnd, Refusal, Snapshot, View};
use serde_json::Value;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

/// Period of looking whether the run is being ended.
const POLL: Duration = Duration::from_millis(10);
/// Time in which Python code is expected to reply in a run by a real clock, before the agent's shell is sent away.
const REAL_PATIENCE: Duration = Duration::from_millis(4);
/// Pause before the reply is looked for again.
const REAL_PAUSE: Duration = Duration::from_millis(5);
/// Kind and version of the states of agents in Python.
const STATE_VERSION: u32 = 1;

/// A question to the code outside.
pub(crate) enum AgentQuestion {
    /// The robot rests.
    Next {
        /// The end of the last motion.
        last: Option<MotionEnd>,
        /// A state to take over first.
        import: Option<Value>,
    },
    /// The world changed in mid-motion, or a setpoint is due.
    Revise,
}

/// A question with what it is about.
pub(crate) struct PendingQuestion {
    pub question: AgentQuestion,
    pub view: View,
    /// Number of the agent's lives before this one.
    pub life: u32,
    /// The reply; an error is the agent's death, in words.
    pub reply: SyncSender<Result<AgentReply, String>>,
}

/// A reply.
pub(crate) struct AgentReply {
    /// None: go on as before.
    pub intent: Option<Intent>,
    /// The agent's state after it; none: unchanged.
    pub state: Option<Value>,
}

/// A message of the run's thread.
pub(crate) enum RunMessage<E> {
    Question(Box<PendingQuestion>),
    Sense(Box<PendingSense>),
    Ended(E),
}

/// The relay's side that outlives its lives.
pub(crate) struct RelayLine<E> {
    pub questions: SyncSender<RunMessage<E>>,
    pub cancelled: Cancelled,
    pub real: bool,
    lives: Arc<AtomicU32>,
}

// by hand: a derive would want E: Clone
impl<E> Clone for RelayLine<E> {
    fn clone(&self) -> Self {
        let Self { questions, cancelled, real, lives } = self;
        Self { questions: questions.clone(), cancelled: cancelled.clone(), real: *real, lives: lives.clone() }
    }
}

impl<E> RelayLine<E> {
    pub fn new(questions: SyncSender<RunMessage<E>>, cancelled: Cancelled, real: bool) -> Self {
        Self { questions, cancelled, real, lives: Arc::default() }
    }

    /// Counts a life; returns the number of those before it.
    pub fn begin_life(&self) -> u32 {
        self.lives.fetch_add(1, Ordering::Relaxed)
    }
}

/// The agent in the run.
pub(crate) struct RelayAgent<E> {
    line: RelayLine<E>,
    life: u32,
    state: Value,
    import: Option<Value>,
    next: Option<Receiver<Result<AgentReply, String>>>,
    revise: Option<Receiver<Result<AgentReply, String>>>,
}

/// The outcome of waiting for a reply.
enum Waited {
    Replied(AgentReply),
    NotYet,
    /// The run is being ended, or there is no Python any more.
    Gone,
}

impl<E: Send + 'static> RelayAgent<E> {
    /// The agent in its first life, or in the next one after a death.
    pub fn new(line: &RelayLine<E>) -> Self {
        let life = line.begin_life();
        Self { line: line.clone(), life, state: Value::Null, import: None, next: None, revise: None }
    }

    /// Passes a question on; `None` if the other side has gone, or its queue is full.
    fn send(&self, question: AgentQuestion, view: &View) -> Option<Receiver<Result<AgentReply, String>>> {
        let (reply, replied) = sync_channel(1);
        let pending = PendingQuestion { question, view: view.clone(), life: self.life, reply };
        match self.line.questions.try_send(RunMessage::Question(Box::new(pending))) {
            Ok(()) => Some(replied),
            Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => None,
        }
    }

    fn wait(&mut self, replied: &Receiver<Result<AgentReply, String>>) -> Waited {
        let mut waited = Duration::ZERO;
        loop {
            let slice = if self.line.real { REAL_PATIENCE } else { POLL };
            match replied.recv_timeout(slice) {
                Ok(Ok(mut reply)) => {
                    if let Some(state) = reply.state.take() {
                        self.state = state;
                    }
                    return Waited::Replied(reply);
                }
                // the agent's death: its actor ends, its motion is rolled back, and supervision starts it again
                Ok(Err(why)) => std::panic::resume_unwind(Box::new(why)),
                Err(RecvTimeoutError::Disconnected) => return Waited::Gone,
                Err(RecvTimeoutError::Timeout) if self.line.cancelled.is_set() => return Waited::Gone,
                Err(RecvTimeoutError::Timeout) => waited += slice,
            }
            if self.line.real && waited >= REAL_PATIENCE {
                return Waited::NotYet;
            }
        }
    }
}

/// The run is being ended: its control comes by itself.
const ENDED: Intent = Intent::Wait(REAL_PAUSE);

impl<E: Send + 'static> Agent for RelayAgent<E> {
    fn next(&mut self, last: Option<MotionEnd>, view: &View) -> Intent {
        if self.line.cancelled.is_set() {
            return ENDED;
        }
        self.revise = None;
        let replied = match self.next.take() {
            Some(replied) => replied,
            None => {
                let import = self.import.take();
                let Some(replied) = self.send(AgentQuestion::Next { last, import }, view) else { return ENDED };
                replied
            }
        };
        match self.wait(&replied) {
            Waited::Replied(reply) => reply.intent.unwrap_or(ENDED),
            Waited::Gone => ENDED,
            Waited::NotYet => {
                self.next = Some(replied);
                Intent::Wait(REAL_PAUSE)
            }
        }
    }

    fn revise(&mut self, view: &View) -> Option<Intent> {
        if self.line.cancelled.is_set() || self.next.is_some() {
            return None;
        }
        let replied = match self.revise.take() {
            Some(replied) => replied,
            None => self.send(AgentQuestion::Revise, view)?,
        };
        match self.wait(&replied) {
            Waited::Replied(reply) => reply.intent,
            Waited::Gone => None,
            Waited::NotYet => {
                self.revise = Some(replied);
                None
            }
        }
    }

    fn export(&self) -> Snapshot {
        Snapshot { kind: mobee::kinds::PYTHON.into(), version: STATE_VERSION, state: self.state.clone() }
    }

    fn import(&mut self, from: Snapshot) -> Result<(), Refusal> {
        if from.kind != mobee::kinds::PYTHON || from.version != STATE_VERSION {
            let what = format!("it is of kind {}, version {}", from.kind, from.version);
            return Err(Refusal::State { what });
        }
        self.state = from.state.clone();
        self.import = Some(from.state);
        Ok(())
    }
}
