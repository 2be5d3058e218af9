//! Set-points of a program outside the run, such as a learned policy: a service of the run. No Python here.
//!
//! ```text
//! program ──set-point, chunk──> FollowLine ══> Follower: limits, speed, simulation ahead ──stream──> supervise
//!         <──what was really sent, and why──                 <──verdict──
//! ```
//!
//! In real time the program waits for milliseconds, and a set-point that was not taken over by then is withdrawn. In virtual time the
//! run's clock stands until the program's next command: equal commands give equal runs.

mod course;
mod follower;
mod guard;

use crate::motion_book::MotionBook;
use crate::wait::Cancelled;
use follower::Follower;
use mobee_contract::{Answer, CommitId, Filtered, Latest, Running, Service, Time, View};
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::Notify;

/// Period of looking whether a run in virtual time is being ended.
const POLL: Duration = Duration::from_millis(10);
/// Time of a run in which its robot must become ready.
const READY_TIMEOUT: Duration = Duration::from_secs(30);

/// Settings of a robot that follows a program.
#[derive(Clone, Debug)]
pub(crate) struct FollowSettings {
    /// Name of the robot.
    pub robot: String,
    /// Time between two set-points of the program.
    pub period: Duration,
    /// Share of each motor's greatest speed.
    pub speed: f64,
    /// Age of the last set-point after which the stream ends.
    pub hold_after: Duration,
    /// Distance beyond that of the controller, m.
    pub extra: f64,
    /// Repeats failed retreats, and escapes from contacts.
    pub recover: bool,
    /// Time between two set-points to the controller.
    pub tick: Duration,
    /// The controller's margin, m.
    pub margin: f64,
}

/// Command of a program; configurations in rad of encoder.
#[derive(Clone, Debug)]
pub(crate) enum FollowCommand {
    /// Set-point, to be reached within a period.
    Target(Vec<f64>),
    /// Set-points, each a period after the one before.
    Chunk(Vec<Vec<f64>>, Duration),
    /// Nothing: the state is replied.
    Pause,
    /// The robot brakes, and its transaction ends.
    Finish,
}

/// Share of a command that is carried out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FollowStatus {
    /// All.
    Sent,
    /// A part.
    Limited,
    /// Nothing.
    Held,
}

impl FollowStatus {
    pub fn word(self) -> &'static str {
        match self {
            FollowStatus::Sent => "sent",
            FollowStatus::Limited => "limited",
            FollowStatus::Held => "held",
        }
    }
}

/// Reply to a command.
#[derive(Clone, Debug)]
pub(crate) struct FollowReply {
    /// The configurations that were sent, one after the other, or the one that is held; rad of encoder.
    pub q: Vec<f64>,
    pub status: FollowStatus,
    /// Reason for which it is not all, in a word; else empty.
    pub code: &'static str,
    /// The same as a sentence.
    pub reason: String,
    /// The transaction.
    pub id: Option<CommitId>,
}

const WAITING: u8 = 0;
const TAKEN: u8 = 1;
const WITHDRAWN: u8 = 2;

/// A command under way.
pub(crate) struct FollowRequest {
    pub command: FollowCommand,
    /// Time by which a run in virtual time goes on.
    span: Duration,
    ticket: Arc<AtomicU8>,
    reply: SyncSender<FollowReply>,
}

impl FollowRequest {
    /// Takes the command over, immediately before it takes effect. False if it was withdrawn.
    fn take(&self) -> bool {
        self.ticket.compare_exchange(WAITING, TAKEN, Ordering::SeqCst, Ordering::SeqCst).is_ok()
    }
}

/// The program's side of a command.
pub(crate) struct FollowTicket {
    ticket: Arc<AtomicU8>,
    reply: Mutex<Receiver<FollowReply>>,
}

impl FollowTicket {
    /// Waits for the reply.
    ///
    /// # Errors
    /// If it does not come in time, or not at all.
    pub fn wait(&self, patience: Duration) -> Result<FollowReply, RecvTimeoutError> {
        self.reply.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(patience)
    }

    /// Withdraws the command. False if it takes effect already.
    pub fn withdraw(&self) -> bool {
        self.ticket.compare_exchange(WAITING, WITHDRAWN, Ordering::SeqCst, Ordering::SeqCst).is_ok()
    }
}

/// Connection of a program and the service.
#[derive(Clone, Default)]
pub(crate) struct FollowLine(Arc<LineState>);

#[derive(Default)]
struct LineState {
    slot: Mutex<LineSlot>,
    arrived: Condvar,
    notify: Notify,
}

#[derive(Default)]
struct LineSlot {
    request: Option<FollowRequest>,
    access: Option<(Arc<dyn Running>, Arc<dyn Filtered>)>,
    /// Reason for which the last chunk was ended early.
    cut: Option<String>,
}

impl FollowLine {
    fn lock(&self) -> MutexGuard<'_, LineSlot> {
        self.0.slot.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sends a command; one that still waits is replaced.
    pub fn send(&self, command: FollowCommand, span: Duration) -> FollowTicket {
        let (reply, replied) = sync_channel(1);
        let ticket = Arc::new(AtomicU8::new(WAITING));
        self.lock().request = Some(FollowRequest { command, span, ticket: ticket.clone(), reply });
        self.0.arrived.notify_all();
        self.0.notify.notify_one();
        FollowTicket { ticket, reply: Mutex::new(replied) }
    }

    /// Newest reading and state; `None` while the service is not running.
    pub fn latest(&self) -> Option<Latest> {
        self.lock().access.as_ref().map(|(_, robot)| robot.latest())
    }

    /// Reason for which the last chunk was ended early, if it was.
    pub fn cut(&self) -> Option<String> {
        self.lock().cut.clone()
    }

    /// Returns whether a transaction has ended; true if the service is not running.
    pub fn has_ended(&self, id: CommitId) -> bool {
        self.lock().access.as_ref().is_none_or(|(_, robot)| robot.end_of(id).is_some())
    }

    /// Snapshot of the run; `None` while the service is not running.
    pub fn view(&self, clearance: f64) -> Option<View> {
        let (running, robot) = self.lock().access.clone()?;
        let latest = robot.latest();
        Some(View {
            at: latest.at,
            robot: robot.index(),
            axes: robot.board().axes.clone().into(),
            poses: running.robots().iter().map(|robot| robot.latest().q).collect(),
            scene: running.scene(),
            contacts: latest.contacts,
            clearance,
            seen: Arc::from([]),
        })
    }

    /// Waits for a command with the clock standing; `None` if the run is being ended.
    fn wait(&self, cancelled: &Cancelled) -> Option<FollowRequest> {
        let mut slot = self.lock();
        loop {
            if cancelled.is_set() {
                return None;
            }
            if let Some(request) = slot.request.take() {
                return Some(request);
            }
            slot = self.0.arrived.wait_timeout(slot, POLL).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

/// Gives the program no access any more when the service ends.
struct OpenLine<'a>(&'a FollowLine);

impl Drop for OpenLine<'_> {
    fn drop(&mut self) {
        self.0.lock().access = None;
    }
}

/// The service of a run.
pub(crate) struct FollowService {
    pub line: FollowLine,
    pub settings: FollowSettings,
    pub book: MotionBook,
    pub cancelled: Cancelled,
    pub real: bool,
}

impl Service for FollowService {
    fn name(&self) -> String {
        "follow".into()
    }

    fn runs_in_virtual_time(&self) -> bool {
        true
    }

    fn serve(self: Arc<Self>, running: Arc<dyn Running>, until: Answer<()>) -> Answer<Result<(), String>> {
        Box::pin(async move {
            let named = |robot: &&Arc<dyn Filtered>| robot.name() == self.settings.robot;
            let robot = running.robots().iter().find(named).cloned().ok_or("the run has no such robot")?;
            self.line.lock().access = Some((running.clone(), robot.clone()));
            let _open = OpenLine(&self.line);
            let follower = Follower::new(self.settings.clone(), running.clone(), robot, self.book.clone());
            match self.real {
                true => self.follow_real(follower, running, until).await,
                false => self.follow_virtual(follower, running, until).await,
            }
        })
    }
}

impl FollowService {
    async fn follow_real(
        &self,
        mut follower: Follower,
        running: Arc<dyn Running>,
        mut until: Answer<()>,
    ) -> Result<(), String> {
        follower.set_scene()?;
        let mut tick = running.now();
        loop {
            let now = running.now();
            if now >= tick {
                follower.tick(now).await?;
                self.line.lock().cut.clone_from(&follower.cut);
                tick = (tick + self.settings.tick).max(now);
            }
            let request = self.line.lock().request.take();
            if let Some(request) = request
                && let Some(reply) = follower.obey(&request, running.now()).await?
            {
                // fails if the program has gone
                let _ = request.reply.try_send(reply);
            }
            tokio::select! {
                biased;
                () = &mut until => return Ok(()),
                () = self.line.0.notify.notified() => {}
                () = running.sleep_until(tick) => {}
            }
        }
    }

    async fn follow_virtual(
        &self,
        mut follower: Follower,
        running: Arc<dyn Running>,
        mut until: Answer<()>,
    ) -> Result<(), String> {
        let began = running.now();
        let mut tick = began;
        // none before the robot is ready
        let mut boundary: Option<Time> = None;
        let mut open: Option<(SyncSender<FollowReply>, FollowReply)> = None;
        loop {
            let now = running.now();
            if now >= tick {
                follower.tick(now).await?;
                self.line.lock().cut.clone_from(&follower.cut);
                tick = tick + self.settings.tick;
            }
            if boundary.is_none() && (follower.is_ready() || now >= began + READY_TIMEOUT) {
                boundary = Some(now);
            }
            if let Some(due) = boundary.filter(|due| now >= *due) {
                if let Some((reply, answer)) = open.take() {
                    let _ = reply.try_send(answer);
                }
                let Some(request) = self.line.wait(&self.cancelled) else { return Ok(()) };
                if let Some(answer) = follower.obey(&request, now).await? {
                    // counted from when it was due: the clock goes in milliseconds
                    boundary = Some(due + request.span);
                    open = Some((request.reply, answer));
                }
                if request.span.is_zero() {
                    continue;
                }
            }
            let wake = boundary.map_or(tick, |boundary| boundary.min(tick));
            tokio::select! {
                biased;
                () = &mut until => return Ok(()),
                () = running.sleep_until(wake) => {}
            }
        }
    }
}
