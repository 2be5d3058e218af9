//! State shared by drivers and the network thread: the newest values of everything, behind one lock held for
//! moments only.

use super::answers::Answers;
use super::found::{Finding, Owed};
use super::gauge::Gauge;
use super::layout::{Layout, disagreement};
use super::motion::BoardMotions;
use super::pace::Pace;
use mobee_contract::{AnswerTime, AsFound, Axis, Board, ControlMode, DriverFault, Pose};
use mobee_yarp::board::{AxisFacts, RemoteState, mode};
use mobee_yarp::{Bottle, Vocab};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::watch;
use tokio::time::Instant;

/// State shared by all drivers and tasks.
#[derive(Debug)]
pub struct SharedBoards {
    inner: Mutex<BoardsState>,
    changed: Condvar,
    /// Origin of the time of readings.
    pub base: Instant,
    /// True while another program or robot object drives the boards.
    let_go: AtomicBool,
    /// True once a run drives the robot. Before that it is only observed, and nothing is sent to it.
    taken: watch::Sender<bool>,
}

/// Present state.
#[derive(Debug)]
pub struct BoardsState {
    /// The boards.
    pub boards: Vec<BoardFacts>,
    /// See [`SharedBoards::take`].
    pub taken: bool,
    /// Description of the robot; set once all boards have been reached, and constant from then on.
    pub board: Option<Board>,
    /// Reason why the robot can't be used at all.
    pub misfit: Option<Trouble>,
    /// Newest reading of all boards together.
    pub joined: Option<Joined>,
    /// True until a driver has fetched it.
    pub unread: bool,
    /// Warning for the operator, until it has been fetched.
    pub news: Option<String>,
    /// Per motor, the mode after all orders in transit have arrived.
    pub expected: Vec<ControlMode>,
    /// Per motor, the ticket of the last order that changes its mode, until that order has been executed.
    pub switching: Vec<Option<u64>>,
}

/// State of one board.
#[derive(Debug)]
pub struct BoardFacts {
    /// Reason why the board can't be used, if any.
    pub trouble: Option<Trouble>,
    /// Reason why the stop connection can't be used, if any.
    pub brake: Option<String>,
    /// True if the board was reached and belongs to no other program.
    pub reached: bool,
    /// Facts that the board reports of its axes, in its own units.
    pub facts: Option<Arc<[AxisFacts]>>,
    /// Newest state as received.
    pub received: Option<Arc<RemoteState>>,
    /// Positions, deg or mm.
    pub q: Vec<f64>,
    /// Time at which the positions were read, s.
    pub read_at: f64,
    /// True if the positions are newer than the joined reading.
    pub fresh: bool,
    /// States lost until now, and until the joined reading.
    pub lost: (u64, u64),
    /// Control modes as last reported.
    pub modes: Vec<Vocab>,
    /// Interaction modes as last reported.
    pub interactions: Vec<Vocab>,
    /// Motions of the joints.
    pub motions: BoardMotions,
    /// Ticket of the newest order that moves a joint.
    pub moved: u64,
    /// Speed limits of the joints.
    pub pace: Pace,
    /// Check that reference speeds mean speeds on this board.
    pub gauge: Gauge,
    /// True if the board accepts reference accelerations but keeps greater ones of its own.
    pub own_acceleration: bool,
    /// Settings to restore.
    pub owed: Owed,
    /// Fault to report to the filter, until it has been fetched.
    pub alarm: Option<DriverFault>,
    /// True if a joint was faster than commanded at the newest reading.
    pub outruns: bool,
    /// Answer times.
    pub answers: Answers,
    /// Greatest possible lead of our clock over the board's, s, from its newest stamped answer.
    pub ahead: Option<f64>,
}

impl BoardFacts {
    /// Torques of the newest state, N m (N for prismatic joints), if the board marks them valid.
    fn torques(&self) -> Option<&[f64]> {
        let joints = &self.received.as_ref()?.joints;
        joints.torque.valid().filter(|torques| torques.len() == joints.axes())
    }

    /// Records an answer that arrived at `now` to a request of `asked`. The stamp of an answer lies in
    /// between.
    pub fn answered(&mut self, asked: f64, now: f64, answer: &Bottle) {
        self.answers.note(now, now - asked);
        if let Some(stamp) = stamp_of(answer) {
            self.ahead = Some(now - stamp);
        }
    }
}

/// Time in an answer that ends with `[tsta] COUNT TIME [ok]`, s on the board's clock.
fn stamp_of(answer: &Bottle) -> Option<f64> {
    let [.., word, _, time, _] = answer.0.as_slice() else { return None };
    (word.as_vocab() == Some(Vocab::new("tsta"))).then_some(())?;
    time.as_f64().filter(|t| t.is_finite() && *t > 0.0)
}

/// Reason why a board can't be used.
#[derive(Clone, Debug, PartialEq)]
pub enum Trouble {
    /// It does not answer.
    Lost(String),
    /// It must not be used.
    Forbidden(String),
}

/// Reading of the whole robot.
#[derive(Clone, Debug)]
pub struct Joined {
    /// Counter of readings, lost ones included.
    pub seq: u64,
    /// Time at which the oldest of its parts was read, s.
    pub at: f64,
    /// Positions, rad.
    pub q: Pose,
    /// True where the motion is done.
    pub done: Vec<bool>,
    /// External torques on the motors, N m (N for prismatic joints); empty if no board reports any.
    pub external: Vec<f64>,
}

impl SharedBoards {
    /// Creates the state before any board is reached.
    pub fn new(layout: &Layout) -> SharedBoards {
        let known = |p: &super::layout::Patch| BoardFacts {
            trouble: Some(Trouble::Lost("not reached yet".into())),
            brake: Some(format!("{}: not reached yet", p.port)),
            reached: false,
            facts: None,
            received: None,
            q: vec![0.0; p.motors.len()],
            read_at: 0.0,
            fresh: false,
            lost: (0, 0),
            modes: vec![mode::UNKNOWN; p.motors.len()],
            interactions: vec![mode::UNKNOWN; p.motors.len()],
            motions: BoardMotions::new(p.motors.len()),
            moved: 0,
            pace: Pace::new(p.motors.len()),
            gauge: Gauge::new(p.motors.len()),
            own_acceleration: false,
            owed: Owed::new(p.motors.len()),
            alarm: None,
            outruns: false,
            answers: Answers::default(),
            ahead: None,
        };
        let inner = BoardsState {
            boards: layout.patches.iter().map(known).collect(),
            taken: false,
            board: None,
            misfit: None,
            joined: None,
            unread: false,
            news: None,
            expected: vec![ControlMode::Position; layout.motors()],
            switching: vec![None; layout.motors()],
        };
        SharedBoards {
            inner: Mutex::new(inner),
            changed: Condvar::new(),
            base: instant(),
            let_go: AtomicBool::new(false),
            taken: watch::Sender::new(false),
        }
    }

    /// Locks the state. A poisoned lock is used anyway, because the robot is intact when a program
    /// crashed while holding it.
    pub fn lock(&self) -> MutexGuard<'_, BoardsState> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Releases the boards: nothing is written to them from now on.
    pub fn let_go(&self) {
        self.let_go.store(true, Ordering::SeqCst);
    }

    /// True once the boards have been released to another driver.
    pub fn is_let_go(&self) -> bool {
        self.let_go.load(Ordering::SeqCst)
    }

    /// Starts driving the robot: each board is stopped, and used once it has answered. Returns true for the
    /// first call.
    pub fn take(&self) -> bool {
        let mut inner = self.lock();
        let begins = !std::mem::replace(&mut inner.taken, true);
        if begins {
            let is_there = |b: &&mut BoardFacts| b.trouble.is_none();
            for board in inner.boards.iter_mut().filter(is_there) {
                board.trouble = Some(Trouble::Lost("it has not answered to a stop yet".into()));
            }
            (inner.joined, inner.unread) = (None, false);
        }
        drop(inner);
        // later connections take the boards as they are, and stop nothing
        self.taken.send_if_modified(|taken| !std::mem::replace(taken, true));
        begins
    }

    /// Receiver that changes with [`SharedBoards::take`].
    pub fn taking(&self) -> watch::Receiver<bool> {
        self.taken.subscribe()
    }

    /// True if this program may write to a board: it drives the robot, has reached the board, and no other
    /// program drives it.
    pub fn is_ours(&self, board: usize) -> bool {
        let inner = self.lock();
        !self.is_let_go() && inner.taken && inner.boards.get(board).is_some_and(|known| known.reached)
    }

    /// Wakes all waiters after a change.
    pub fn ring(&self) {
        self.changed.notify_all();
    }

    /// Waits until all boards can be used and a reading is available, the robot turns out to be unusable, or
    /// `patience` is over.
    pub fn wait(&self, patience: Duration) -> MutexGuard<'_, BoardsState> {
        let waits = |inner: &mut BoardsState| !inner.is_ready() && inner.misfit.is_none();
        let waited = self.changed.wait_timeout_while(self.lock(), patience, waits);
        waited.unwrap_or_else(PoisonError::into_inner).0
    }

    /// Speed limits of some of a board's joints, deg/s or mm/s.
    pub fn greatest(&self, layout: &Layout, board: usize, joints: &[usize]) -> Vec<f64> {
        let inner = self.lock();
        let first = layout.patches.get(board).map_or(0, |p| p.motors.start);
        let axis = |j: &usize| inner.board.as_ref().and_then(|b| b.axes.get(first + j));
        joints.iter().map(|j| axis(j).map_or(f64::INFINITY, |a| a.max_speed.to_degrees())).collect()
    }

    /// Position limits of a board's joints, deg or mm.
    pub fn limits(&self, layout: &Layout, board: usize) -> Vec<(f64, f64)> {
        let inner = self.lock();
        let (Some(patch), Some(board)) = (layout.patches.get(board), &inner.board) else { return Vec::new() };
        let axes = board.axes.iter().skip(patch.motors.start).take(patch.motors.len());
        axes.map(|a| (a.min.to_degrees(), a.max.to_degrees())).collect()
    }

    /// Seconds since `base`.
    pub fn secs(&self, at: Instant) -> f64 {
        at.saturating_duration_since(self.base).as_secs_f64()
    }
}

impl BoardsState {
    /// True if drivers can work.
    pub fn is_ready(&self) -> bool {
        self.board.is_some() && self.joined.is_some() && self.trouble().is_none()
    }

    /// The first board that can't be used.
    pub fn trouble(&self) -> Option<Trouble> {
        let all = || self.boards.iter().filter_map(|b| b.trouble.as_ref());
        let forbidden = || all().find(|t| matches!(t, Trouble::Forbidden(_)));
        let taken = Some(()).filter(|()| self.taken);
        let brake = || taken.and_then(|()| self.boards.iter().find_map(|b| b.brake.clone())).map(Trouble::Lost);
        self.misfit.as_ref().or_else(forbidden).or_else(|| all().next()).cloned().or_else(brake)
    }

    /// Description of the first board whose reference speeds are not speeds, with the consequence; for the
    /// operator.
    pub fn unfair(&self, layout: &Layout) -> Option<String> {
        let mut boards = layout.patches.iter().zip(&self.boards);
        let seen =
            boards.find_map(|(patch, board)| board.gauge.is_unfair().then(|| board.gauge.in_words(&patch.port)))?;
        let goes_on = self.board.as_ref().is_some_and(|board| board.position_direct);
        let then = if goes_on {
            "moves are made of set-points from now on; set moves = \"set-points\" to begin so"
        } else {
            "and without position_direct no move can be made of set-points either, so none is made"
        };
        Some(format!("{seen}; {then}"))
    }

    /// Answer times of the slowest board.
    pub fn answer_time(&self, now: f64) -> Option<AnswerTime> {
        self.boards.iter().filter_map(|b| b.answers.summary(now)).max_by_key(|a| a.most)
    }

    /// Description of the first motor that reports a hardware fault.
    pub fn fault(&self, layout: &Layout) -> Option<String> {
        let faulty = |(patch, board): (&super::layout::Patch, &BoardFacts)| {
            let joint = board.modes.iter().position(|m| *m == mode::HARDWARE_FAULT)?;
            let name = layout.names.get(patch.motors.start + joint)?;
            Some(format!("motor {name} (joint {joint} of {}) has a hardware fault", patch.port))
        };
        layout.patches.iter().zip(&self.boards).find_map(faulty)
    }

    /// Joins the newest states to a reading, once every board has sent a new one.
    pub fn join(&mut self, layout: &Layout) {
        if self.board.is_none() || !self.boards.iter().all(|b| b.fresh && b.trouble.is_none()) {
            return;
        }
        let mut q = layout.home.clone();
        let mut done = vec![true; q.len()];
        let mut external = vec![0.0; if self.boards.iter().any(|b| b.torques().is_some()) { q.len() } else { 0 }];
        let mut lost = 0;
        for (patch, board) in layout.patches.iter().zip(&mut self.boards) {
            let slots = q.iter_mut().zip(&mut done).skip(patch.motors.start).take(patch.motors.len());
            for ((slot, rests), (deg, over)) in slots.zip(board.q.iter().zip(board.motions.done())) {
                (*slot, *rests) = (deg.to_radians(), over);
            }
            let pushed = external.iter_mut().skip(patch.motors.start).take(patch.motors.len());
            for (slot, torque) in pushed.zip(board.torques().unwrap_or_default()) {
                // the board reports the effort of its joint; the external one is opposite
                *slot = if torque.is_finite() { 0.0 - torque } else { 0.0 };
            }
            lost = lost.max(board.lost.0.saturating_sub(board.lost.1));
            board.lost.1 = board.lost.0;
            board.fresh = false;
        }
        let at = self.boards.iter().map(|b| b.read_at).fold(f64::INFINITY, f64::min);
        let seq = self.joined.as_ref().map_or(0, |j| j.seq + 1 + lost);
        self.joined = Some(Joined { seq, at, q: q.into(), done, external });
        self.unread = true;
        for (patch, board) in layout.patches.iter().zip(&self.boards) {
            for (motor, word) in patch.motors.clone().zip(&board.modes) {
                if let (Some(expected), Some(None)) = (self.expected.get_mut(motor), self.switching.get(motor)) {
                    *expected = from_word(*word);
                }
            }
        }
    }

    /// Takes over the settings found by an earlier process. A board owes its settings if those of all its
    /// motors are given.
    pub fn inherit(&mut self, layout: &Layout, found: &[AsFound]) {
        for (patch, board) in layout.patches.iter().zip(&mut self.boards) {
            let of = |motor: usize| found.iter().find(|f| f.motor == motor).map(Finding::of);
            if let Some(all) = patch.motors.clone().map(of).collect() {
                board.owed.inherit(all);
            }
        }
    }

    /// Control modes as the boards last reported them. Motors without a board are in the commanded mode.
    pub fn modes(&self, layout: &Layout) -> Vec<ControlMode> {
        let mut modes = self.expected.clone();
        for (patch, board) in layout.patches.iter().zip(&self.boards) {
            for (slot, word) in modes.iter_mut().skip(patch.motors.start).zip(&board.modes) {
                *slot = from_word(*word);
            }
        }
        modes
    }

    /// Marks an order as executed or dropped: the modes of its motors are now those that the board reports.
    pub fn switched(&mut self, motors: impl Iterator<Item = usize>, ticket: u64) {
        for m in motors {
            if let Some(slot) = self.switching.get_mut(m).filter(|s| **s == Some(ticket)) {
                *slot = None;
            }
        }
    }
}

/// Board description, once the facts of all boards have arrived. Names must agree; the narrower limits apply.
///
/// # Errors
/// A board whose axes don't fit the model, in number or joint kind.
pub fn describe(
    layout: &Layout,
    boards: &[BoardFacts],
    settings: &super::YarpDriverSettings,
) -> Result<Option<Board>, String> {
    let fastest = settings.max_speed_deg_per_s.to_radians();
    let unbounded = |m: usize| Axis {
        name: layout.names.get(m).cloned().unwrap_or_default(),
        min: layout.limits.get(m).map_or(0.0, |l| l.0),
        max: layout.limits.get(m).map_or(0.0, |l| l.1),
        max_speed: layout.speeds.get(m).map_or(fastest, |v| v.min(fastest)),
        max_acceleration: settings.max_acceleration_deg_per_s2.to_radians(),
        motion: layout.motions.get(m).copied().unwrap_or_default(),
        ..Default::default()
    };
    let mut axes: Vec<Axis> = (0..layout.motors()).map(unbounded).collect();
    for (patch, board) in layout.patches.iter().zip(boards) {
        let Some(facts) = &board.facts else { return Ok(None) };
        let port = &patch.port;
        let want = patch.motors.len();
        let have = facts.len();
        if have < want {
            return Err(format!("{port} has {have} axes, but part {} of the model has {want} motors", patch.part));
        }
        for (joint, (axis, fact)) in axes.iter_mut().skip(patch.motors.start).take(want).zip(facts.iter()).enumerate() {
            let fact = &patch.units.facts_from_wire(joint, fact);
            disagreement(fact.kind, patch.units.kind(joint), &axis.name, &format!("joint {joint} of {port}"))
                .map_or(Ok(()), |[what, remedy]| Err(format!("{what}; {remedy}")))?;
            if let Some((min, max)) = fact.limits {
                (axis.min, axis.max) = (axis.min.max(min.to_radians()), axis.max.min(max.to_radians()));
            }
            if axis.min >= axis.max {
                return Err(format!("the limits of {} at {port} and in the model have nothing in common", axis.name));
            }
            let measured = board.motions.resolutions().nth(joint).unwrap_or_default();
            axis.resolution = settings.resolution_deg.unwrap_or(measured).to_radians();
            if axis.motion.is_turn() {
                axis.hold_error = settings.hold_error_deg.to_radians();
                axis.deflection = settings.deflection_deg.to_radians();
            }
            if board.torques().is_some() {
                axis.contact_effort = Axis::UNRATED;
            }
            axis.max_speed = fact.max_speed.map_or(axis.max_speed, |v| v.to_radians().min(axis.max_speed));
        }
    }
    let period = settings.period();
    let latency = settings.latency();
    Ok(Some(Board { axes, period, latency, position_direct: settings.position_direct }))
}

/// Control mode of a board's vocab.
pub fn from_word(word: Vocab) -> ControlMode {
    match word {
        mode::POSITION => ControlMode::Position,
        mode::DIRECT => ControlMode::PositionDirect,
        mode::VELOCITY => ControlMode::Velocity,
        _ => ControlMode::Idle,
    }
}

/// Vocab of a control mode.
pub fn word(of: ControlMode) -> Vocab {
    match of {
        ControlMode::Idle => mode::IDLE,
        ControlMode::Position => mode::POSITION,
        ControlMode::PositionDirect => mode::DIRECT,
        ControlMode::Velocity => mode::VELOCITY,
    }
}

/// True while the lease lasts.
pub fn holds(lease: Option<Instant>) -> bool {
    lease.is_some_and(|until| until > instant())
}

/// Now, on the monotonic clock of arrivals. A robot behind a network lives in real time; the time of the run
/// comes in with every call of the driver contract.
#[expect(
    clippy::disallowed_methods,
    reason = "arrivals and leases of a real network are measured on its own monotonic clock"
)]
pub fn instant() -> Instant {
    Instant::now()
}

#[cfg(test)]
mod tests;
