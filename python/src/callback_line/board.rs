//! The line as the board of a robot: hardware, and the driver of each connection.

use super::{CallbackLine, LineState, RESTART_AFTER};
use crate::callback_arm::CallbackArm;
use mobee_contract::{AnswerTime, Board, Command, ControlMode, Driver, DriverFault, Hardware, Known, Sample, Time};
use std::sync::{Arc, PoisonError};
use std::time::Duration;

/// An arm whose motors Python code moves and reads; it outlives its drivers.
pub(crate) struct CallbackHardware {
    pub(super) line: Arc<CallbackLine>,
    pub(super) board: Board,
}

impl CallbackHardware {
    /// A driver, once the Python code gives readings (and its motors are driven). In a running system there is no wait.
    fn driver(&self, looks: bool) -> Result<Box<dyn Driver>, DriverFault> {
        let line = &self.line;
        let mut state = line.lock();
        state.is_wanted = true;
        state.drives |= !looks;
        let now = line.now();
        if state.failure.as_ref().is_some_and(|failure| now.since(failure.at) > RESTART_AFTER) {
            state.restarts = true;
        }
        line.bell.notify_all();
        let is_ready = |state: &LineState| {
            state.arm.as_ref().is_some_and(|arm| if looks { arm.read_at().is_some() } else { arm.is_driven() })
        };
        if !state.was_driven {
            let waits = |state: &mut LineState| !is_ready(state) && state.failure.is_none() && !state.is_gone;
            let waited = line.bell.wait_timeout_while(state, line.spec.patience, waits);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
        if is_ready(&state) && state.failure.is_none() {
            return Ok(Box::new(CallbackDriver {
                line: line.clone(),
                board: self.board.clone(),
                offset: None,
                last: Time::ZERO,
                looks,
            }));
        }
        let class = &line.spec.class;
        Err(match &state.failure {
            Some(failure) => DriverFault::Hardware(failure.line.clone()),
            None if state.was_driven => DriverFault::Lost,
            None => DriverFault::Hardware(format!(
                "the driver {class} gives no reading within {:.1} s; see whether its `connect` or `read` blocks or `read` returns None, or \
                 raise its connect_s",
                line.spec.patience.as_secs_f64()
            )),
        })
    }
}

impl Hardware for CallbackHardware {
    fn connect(&self) -> Result<Box<dyn Driver>, DriverFault> {
        self.driver(false)
    }

    fn look(&self) -> Option<Result<Box<dyn Driver>, DriverFault>> {
        Some(self.driver(true))
    }

    fn let_go(&self) {
        self.line.lock().is_let_go = true;
    }

    fn known(&self) -> Known {
        Known { start: None, period: Some(self.board.period), motors: None }
    }
}

impl Drop for CallbackHardware {
    fn drop(&mut self) {
        self.line.end();
    }
}

/// A connection.
struct CallbackDriver {
    line: Arc<CallbackLine>,
    board: Board,
    /// The run's time when the line's clock began, ns.
    offset: Option<i128>,
    last: Time,
    /// A driver that only reads.
    looks: bool,
}

impl CallbackDriver {
    /// The line's time now. Both clocks run alike; the smallest delay seen between them is their offset.
    fn line_time(&mut self, now: Time) -> Time {
        let line = self.line.now();
        let offset = i128::from(now.0) - i128::from(line.0);
        self.offset = Some(self.offset.map_or(offset, |before| before.max(offset)));
        line
    }

    fn run_time(&mut self, at: Time, now: Time) -> Time {
        let read = i128::from(at.0) + self.offset.unwrap_or_default();
        let read = Time(u64::try_from(read.max(0)).unwrap_or(u64::MAX)).min(now);
        self.last = if read > self.last { read } else { (self.last + Duration::from_nanos(1)).min(now) };
        self.last
    }
}

impl Driver for CallbackDriver {
    fn board(&self) -> &Board {
        &self.board
    }

    fn command(&mut self, now: Time, command: &Command) -> Result<(), DriverFault> {
        let at = self.line_time(now);
        let mut state = self.line.lock();
        if self.looks {
            return Err(DriverFault::Refused("this driver only reads: the arm has not been connected to".into()));
        }
        if matches!(command, Command::Stop { motors } if motors.is_empty()) {
            // a stop of an arm that is lost has been made already
            state.arm.iter_mut().for_each(CallbackArm::brake);
            return Ok(());
        }
        if let Some(fault) = state.fault(at) {
            return Err(fault);
        }
        let arm = state.arm.as_mut().ok_or(DriverFault::Lost)?;
        arm.command(at, command).map_err(DriverFault::Refused)
    }

    fn sample(&mut self, now: Time) -> Result<Option<Sample>, DriverFault> {
        let at = self.line_time(now);
        let taken = {
            let mut state = self.line.lock();
            state.watch(at, self.line.max_answer());
            if let Some(fault) = state.fault(at) {
                return Err(fault);
            }
            state.arm.as_mut().and_then(CallbackArm::take_sample)
        };
        Ok(taken.map(|sample| Sample { at: self.run_time(sample.at, now), ..sample }))
    }

    fn next_sample(&self, now: Time) -> Time {
        if self.line.lock().arm.as_ref().is_some_and(CallbackArm::has_sample) {
            return now;
        }
        let due = self.last + self.board.period + self.board.period / 10;
        // a reading that is overdue is looked for several times a period
        if due > now { due } else { now + self.board.period / 5 }
    }

    fn lease(&mut self, now: Time, until: Time) {
        let at = self.line_time(now);
        let mut state = self.line.lock();
        if let Some(arm) = state.arm.as_mut().filter(|arm| !self.looks && arm.is_driven()) {
            arm.lease(at, if until > now { at + until.since(now) } else { Time::ZERO });
        }
    }

    fn answer_time(&self) -> Option<AnswerTime> {
        self.line.lock().answer_time()
    }

    fn news(&mut self) -> Option<String> {
        self.line.lock().news.take()
    }

    fn leads(&self) -> bool {
        true
    }

    fn modes(&self) -> Vec<ControlMode> {
        self.line.lock().arm.as_ref().map(CallbackArm::modes).unwrap_or_default()
    }
}
