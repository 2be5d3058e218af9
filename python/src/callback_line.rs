//! The line between the driver of a run and the thread of a driver in Python. No Python here.
//!
//! ```text
//! driver actor ──Command, lease──> CallbackArm ──positions──> reply: `command(q)`  ┐
//!              <─────Sample─────── CallbackArm <──reading──── wait:  `read()`      ┘ thread of Python
//! ```
//! No thread of a run waits for Python. A cycle that takes too long is a lost reading, and the arm brakes; without readings the driver
//! reports that the board is lost; an exception is a fault of the board.

mod board;

use crate::callback_arm::{CallbackArm, CycleTargets};
pub(crate) use board::CallbackHardware;
use mobee_contract::{AnswerTime, Axis, Board, DriverFault, KindError, Time};
use mobee_model::{JointMotion, Robot, suggestion};
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// A cycle that takes longer than this, or than five periods, is late.
const MAX_ANSWER: Duration = Duration::from_millis(50);
/// A board whose last reading is older than this is lost.
const LOST_AFTER: Duration = Duration::from_millis(200);
/// Time from an exception to the next attempt to connect.
const RESTART_AFTER: Duration = Duration::from_secs(1);
/// Longest time in which the arm brakes at the end.
const MAX_ENDING: Duration = Duration::from_secs(2);
/// Longest wait of the Python thread without looking at signals.
const SLICE: Duration = Duration::from_millis(100);
/// Cycles whose duration is stored.
const CYCLES: usize = 1000;
/// Cycles of which the answer time is taken.
const RECENT_CYCLES: usize = 100;

/// A motor as its driver describes it, rad or m.
#[derive(Clone, Debug)]
pub(crate) struct CallbackAxis {
    pub name: String,
    pub lower: Option<f64>,
    pub upper: Option<f64>,
    pub max_speed: f64,
    pub max_acceleration: f64,
    pub motion: JointMotion,
    pub resolution: f64,
    pub hold_error: f64,
    /// N m or N.
    pub contact_effort: f64,
}

/// A driver as it describes itself.
#[derive(Clone, Debug)]
pub(crate) struct CallbackSpec {
    /// The name of its class.
    pub class: String,
    pub axes: Vec<CallbackAxis>,
    pub period: Duration,
    pub latency: Duration,
    /// Longest wait for its first reading.
    pub patience: Duration,
}

/// A reading in the driver's own order.
#[derive(Clone, Debug, Default)]
pub(crate) struct LineReading {
    /// Positions, rad or m.
    pub q: Vec<f64>,
    /// External torques, N m or N; empty: not measured.
    pub external: Vec<f64>,
    /// The positions that the motors hold, rad or m; empty: unknown to the driver.
    pub held: Vec<f64>,
}

/// Next action of the Python thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LineCall {
    /// Call `connect`.
    Connect,
    /// Call `read`, reply, and call `command` with what the reply returns.
    Cycle,
    /// Nothing for now: call again.
    Again,
    /// Call `close`, and end.
    End,
}

/// Duration of the cycles: from the call of `read` to the return of `command`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct LineCycles {
    pub cycles: u64,
    /// Cycles that were late.
    pub lost: u64,
    /// Of the last thousand.
    pub median: Duration,
    pub p99: Duration,
    pub most: Duration,
}

/// An exception of the driver.
struct LineFailure {
    /// The last line of its traceback.
    line: String,
    at: Time,
    is_reported: bool,
}

/// The state of a line.
struct LineState {
    arm: Option<CallbackArm>,
    /// For each motor of the board, the index of the driver's axis.
    order: Vec<usize>,
    called: Option<LineCall>,
    /// Begin of the cycle under way.
    asked: Option<Time>,
    is_late: bool,
    due: Time,
    /// True once a run needs readings.
    is_wanted: bool,
    /// True if the motors are to be driven.
    drives: bool,
    was_driven: bool,
    is_connected: bool,
    is_let_go: bool,
    restarts: bool,
    failure: Option<LineFailure>,
    news: Option<String>,
    /// True once a late cycle was reported.
    has_warned: bool,
    ended: Option<Time>,
    /// True once the Python thread has ended.
    is_gone: bool,
    cycles: u64,
    lost: u64,
    took: VecDeque<Duration>,
}

/// A line; it outlives the drivers of a run.
pub(crate) struct CallbackLine {
    pub spec: CallbackSpec,
    state: Mutex<LineState>,
    bell: Condvar,
    begun: Instant,
}

#[expect(clippy::disallowed_methods, reason = "a driver in Python lives in real time")]
fn monotonic() -> Instant {
    Instant::now()
}

impl CallbackLine {
    /// A line that no hardware uses yet.
    pub fn new(spec: CallbackSpec) -> Self {
        let state = LineState {
            arm: None,
            order: Vec::new(),
            called: None,
            asked: None,
            is_late: false,
            due: Time::ZERO,
            is_wanted: false,
            drives: false,
            was_driven: false,
            is_connected: false,
            is_let_go: false,
            restarts: false,
            failure: None,
            news: None,
            has_warned: false,
            ended: None,
            is_gone: false,
            cycles: 0,
            lost: 0,
            took: VecDeque::with_capacity(CYCLES),
        };
        Self { spec, state: Mutex::new(state), bell: Condvar::new(), begun: monotonic() }
    }

    /// Held for computing only.
    fn lock(&self) -> MutexGuard<'_, LineState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The time by the line's own clock.
    fn now(&self) -> Time {
        Time(u64::try_from(self.begun.elapsed().as_nanos()).unwrap_or(u64::MAX))
    }

    /// Duration after which a cycle is late.
    fn max_answer(&self) -> Duration {
        MAX_ANSWER.max(5 * self.spec.period)
    }

    /// Waits for what the Python thread has to do next, for a tenth of a second at most. The call before is over then.
    pub fn wait(&self) -> LineCall {
        let mut state = self.lock();
        self.finish_call(&mut state);
        let call = self.next_call(state);
        let mut state = self.lock();
        state.called = Some(call);
        if call == LineCall::Cycle {
            state.asked = Some(self.now());
        }
        call
    }

    fn finish_call(&self, state: &mut LineState) {
        let now = self.now();
        state.watch(now, self.max_answer());
        match state.called.take() {
            Some(LineCall::Connect) if state.failure.is_none() => {
                state.is_connected = true;
                state.due = now;
                self.bell.notify_all();
            }
            Some(LineCall::Cycle) => {
                if let Some(asked) = state.asked {
                    state.note(now.since(asked));
                }
            }
            _ => {}
        }
        state.asked = None;
        state.is_late = false;
    }

    fn next_call(&self, mut state: MutexGuard<'_, LineState>) -> LineCall {
        let begun = self.now();
        loop {
            let now = self.now();
            if let Some(ended) = state.ended {
                let is_over = now.since(ended) > MAX_ENDING;
                let rests = state.arm.as_ref().is_none_or(CallbackArm::is_at_rest);
                if is_over || rests || !state.is_connected || state.is_let_go {
                    return LineCall::End;
                }
            }
            if state.is_wanted && !state.is_connected && (state.failure.is_none() || state.restarts) {
                (state.failure, state.restarts) = (None, false);
                return LineCall::Connect;
            }
            let mut left = SLICE.saturating_sub(now.since(begun));
            if state.is_wanted && state.is_connected {
                if state.due <= now {
                    // periods that were missed are not made up for
                    let next = state.due + self.spec.period;
                    state.due = if now < next { next } else { now + self.spec.period };
                    return LineCall::Cycle;
                }
                left = left.min(state.due.since(now));
            }
            if left.is_zero() {
                return LineCall::Again;
            }
            state = self.bell.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Takes a reading of the driver, or none if it was lost; returns the positions for its motors, rad or m in its own order, and whether they are to be stopped
    /// afterwards.
    ///
    /// # Errors
    /// A joint that can't be driven where it is.
    pub fn reply(&self, reading: Option<&LineReading>) -> Result<CycleTargets, String> {
        let mut state = self.lock();
        let now = self.now();
        state.watch(now, self.max_answer());
        let (asked, is_late, drives) = (state.asked, state.is_late, state.drives && !state.is_let_go);
        let LineState { arm: Some(arm), order, was_driven, .. } = &mut *state else {
            return Ok(CycleTargets::default());
        };
        if reading.is_none() {
            arm.miss_reading();
        }
        if let Some((asked, reading)) = asked.filter(|_| !is_late).zip(reading) {
            let encoder = |values: &[f64]| -> Vec<f64> {
                let each = order.iter().filter_map(|i| values.get(*i).zip(self.spec.axes.get(*i)));
                each.map(|(value, axis)| axis.motion.encoder(*value)).collect()
            };
            let external = order.iter().filter_map(|i| reading.external.get(*i).copied()).collect();
            arm.take_reading(asked, encoder(&reading.q), external);
            if drives && !arm.is_driven() {
                arm.take_over(&encoder(&reading.held))?;
                *was_driven = true;
            }
        }
        let targets = arm.tick(now);
        let given = targets.q.filter(|_| drives).map(|q| {
            let mut given = vec![0.0; q.len()];
            for (i, q) in order.iter().zip(q) {
                let motion = self.spec.axes.get(*i).map_or(JointMotion::Turn, |axis| axis.motion);
                if let Some(slot) = given.get_mut(*i) {
                    *slot = q / motion.encoder(1.0);
                }
            }
            given
        });
        self.bell.notify_all();
        Ok(CycleTargets { q: given, stop: targets.stop && drives })
    }

    /// An exception of the driver: its last line, and the whole traceback.
    pub fn fail(&self, line: String, traceback: &str) {
        let mut state = self.lock();
        let now = self.now();
        state.called = None;
        state.is_connected = false;
        if let Some(arm) = &mut state.arm {
            arm.release();
        }
        state.news = Some(format!("the driver {} failed:\n{traceback}", self.spec.class));
        state.failure = Some(LineFailure { line, at: now, is_reported: false });
        self.bell.notify_all();
    }

    /// Brakes the arm; the Python thread then ends.
    pub fn end(&self) {
        let mut state = self.lock();
        let now = self.now();
        state.ended.get_or_insert(now);
        if let Some(arm) = &mut state.arm {
            arm.lease(now, Time::ZERO);
        }
        self.bell.notify_all();
    }

    /// The Python thread has ended.
    pub fn leave(&self) {
        let mut state = self.lock();
        state.is_gone = true;
        if let Some(arm) = &mut state.arm {
            arm.release();
        }
        self.bell.notify_all();
    }

    /// Duration of the cycles.
    pub fn cycles(&self) -> LineCycles {
        let state = self.lock();
        let mut took: Vec<Duration> = state.took.iter().copied().collect();
        took.sort();
        let at = |share: f64| took.get((share * took.len() as f64) as usize).or(took.last()).copied();
        LineCycles {
            cycles: state.cycles,
            lost: state.lost,
            median: at(0.5).unwrap_or_default(),
            p99: at(0.99).unwrap_or_default(),
            most: took.last().copied().unwrap_or_default(),
        }
    }

    /// The arm as the board of a robot; of all its motors, in its order.
    ///
    /// # Errors
    /// Axes that are not the motors of this robot, or a line that is in use.
    pub fn attach(self: &Arc<Self>, robot: &Robot) -> Result<CallbackHardware, KindError> {
        let wrong = |what: String, help: String| KindError::new("", what, help);
        let class = &self.spec.class;
        let known: Vec<&str> = robot.motors.iter().map(|m| m.name.as_str()).collect();
        if let Some(stray) = self.spec.axes.iter().find(|axis| !known.contains(&axis.name.as_str())) {
            let what = format!("{class}.axes: the robot {} has no joint {:?}", robot.name, stray.name);
            return Err(wrong(what, suggestion(&stray.name, "joint", &known)));
        }
        let mut axes = Vec::new();
        let mut order = Vec::new();
        for motor in &robot.motors {
            let Some(i) = self.spec.axes.iter().position(|axis| axis.name == motor.name) else {
                let what = format!("{class}.axes lacks joint {:?} of the robot {}", motor.name, robot.name);
                return Err(wrong(what, "give an axis for each joint of the robot".into()));
            };
            let Some(given) = self.spec.axes.get(i).filter(|axis| axis.motion == motor.motion) else {
                let what = format!("{class}.axes: joint {:?} has another unit than in the robot's model", motor.name);
                return Err(wrong(what, "give unit=\"rad\" for a joint that turns, \"m\" for one that slides".into()));
            };
            let axis = given.axis(motor.min, motor.max);
            let max_speed = motor.limit_speed(axis.max_speed);
            if axis.min >= axis.max {
                let what = format!("{class}.axes: the limits of joint {:?} are outside those of the model", motor.name);
                return Err(wrong(what, "correct lower and upper, rad or m".into()));
            }
            axes.push(Axis { max_speed, ..axis });
            order.push(i);
        }
        self.attached(axes, order)
    }

    /// The arm as a board of its own.
    ///
    /// # Errors
    /// Axes without limits.
    pub fn attach_alone(self: &Arc<Self>) -> Result<CallbackHardware, KindError> {
        let axis = |(i, given): (usize, &CallbackAxis)| match (given.lower, given.upper) {
            (Some(_), Some(_)) => Ok(given.axis(f64::NEG_INFINITY, f64::INFINITY)),
            _ => {
                let what = format!("{}.axes[{i}]: joint {:?} has no limits", self.spec.class, given.name);
                Err(KindError::new("", what, "give lower and upper, rad or m"))
            }
        };
        let axes = KindError::gather(self.spec.axes.iter().enumerate().map(axis))?;
        let order = (0..axes.len()).collect();
        self.attached(axes, order)
    }

    fn attached(self: &Arc<Self>, axes: Vec<Axis>, order: Vec<usize>) -> Result<CallbackHardware, KindError> {
        let CallbackSpec { period, latency, .. } = self.spec;
        let mut state = self.lock();
        if state.is_wanted || state.ended.is_some() {
            let what = format!("the driver {} is in use, or was used before", self.spec.class);
            return Err(KindError::new("", what, "give each robot and each run a driver of its own"));
        }
        state.arm = Some(CallbackArm::new(axes.clone(), period));
        state.order = order;
        let board = Board { axes, period, latency, position_direct: true };
        Ok(CallbackHardware { line: self.clone(), board })
    }
}

impl CallbackAxis {
    /// As the board's axis, within the limits of a model, rad of encoder.
    fn axis(&self, min: f64, max: f64) -> Axis {
        let encoder = |value: f64| self.motion.encoder(value);
        Axis {
            name: self.name.clone(),
            min: self.lower.map_or(min, |q| min.max(encoder(q))),
            max: self.upper.map_or(max, |q| max.min(encoder(q))),
            max_speed: encoder(self.max_speed),
            max_acceleration: encoder(self.max_acceleration),
            motion: self.motion,
            resolution: encoder(self.resolution),
            hold_error: encoder(self.hold_error),
            contact_effort: self.contact_effort,
            ..Axis::default()
        }
    }
}

impl LineState {
    /// Looks whether the cycle under way is late; the first one that is late is reported.
    fn watch(&mut self, now: Time, max_answer: Duration) {
        let is_over = self.asked.is_some_and(|asked| now.since(asked) > max_answer);
        if is_over && !self.is_late && self.called == Some(LineCall::Cycle) {
            self.is_late = true;
            self.lost += 1;
            if !std::mem::replace(&mut self.has_warned, true) {
                self.news = Some(format!(
                    "`read` and `command` of the driver took longer than {:.0} ms: the reading is lost, and the arm brakes; make them shorter, \
                     and let no other code hold the interpreter's lock for so long",
                    1e3 * max_answer.as_secs_f64()
                ));
            }
            if let Some(arm) = &mut self.arm {
                arm.lose_reading();
            }
        }
    }

    fn note(&mut self, took: Duration) {
        self.cycles += 1;
        if self.took.len() == CYCLES {
            self.took.pop_front();
        }
        self.took.push_back(took);
    }

    /// Duration of the last hundred cycles.
    fn answer_time(&self) -> Option<AnswerTime> {
        let mut took: Vec<Duration> = self.took.iter().rev().take(RECENT_CYCLES).copied().collect();
        took.sort();
        let (median, most) = (*took.get(took.len() / 2)?, *took.get(took.len() * 9 / 10)?);
        Some(AnswerTime { median, most, greatest: *took.last()? })
    }

    /// The fault to report, if the arm gives no readings: an exception once, and then that it is lost.
    fn fault(&mut self, now: Time) -> Option<DriverFault> {
        if let Some(failure) = &mut self.failure {
            if failure.is_reported {
                return Some(DriverFault::Lost);
            }
            failure.is_reported = true;
            return Some(DriverFault::Hardware(failure.line.clone()));
        }
        let is_old = |arm: &CallbackArm| arm.read_at().is_some_and(|at| now.since(at) > LOST_AFTER);
        let arm = self.arm.as_mut()?;
        if self.is_gone || (is_old(arm) && self.ended.is_none()) {
            arm.release();
            return Some(DriverFault::Lost);
        }
        None
    }
}
