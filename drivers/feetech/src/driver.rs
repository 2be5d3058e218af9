//! The driver: checks, and never waits.

use crate::core::ConnectionStage;
use crate::worker::SharedArm;
use mobee_contract::{AnswerTime, Board, Command, ControlMode, Driver, DriverFault, Sample, Time};
use std::sync::Arc;
use std::time::Duration;

/// A connection to an arm of servos.
pub struct FeetechDriver {
    shared: Arc<SharedArm>,
    board: Board,
    /// The run's time when the arm's clock began, ns.
    offset: Option<i128>,
    last: Time,
    /// A driver that only reads.
    looks: bool,
}

impl FeetechDriver {
    /// A driver of an arm that has been reached.
    pub fn new(shared: Arc<SharedArm>, board: Board, looks: bool) -> FeetechDriver {
        FeetechDriver { shared, board, offset: None, last: Time::ZERO, looks }
    }

    /// The arm's time now. Both clocks run alike; the smallest delay seen between them is their offset.
    fn arm_time(&mut self, now: Time) -> Time {
        let arm = self.shared.now();
        let offset = i128::from(now.0) - i128::from(arm.0);
        self.offset = Some(self.offset.map_or(offset, |before| before.max(offset)));
        arm
    }

    fn run_time(&mut self, at: Time, now: Time) -> Time {
        let read = i128::from(at.0) + self.offset.unwrap_or_default();
        let read = Time(u64::try_from(read.max(0)).unwrap_or(u64::MAX)).min(now);
        self.last = if read > self.last { read } else { (self.last + Duration::from_nanos(1)).min(now) };
        self.last
    }
}

impl Driver for FeetechDriver {
    fn board(&self) -> &Board {
        &self.board
    }

    fn command(&mut self, now: Time, command: &Command) -> Result<(), DriverFault> {
        let arm = self.arm_time(now);
        let mut state = self.shared.lock();
        if self.looks {
            return Err(DriverFault::Refused("this driver only reads: the arm has not been connected to".into()));
        }
        if let Command::Stop { motors } = command
            && motors.is_empty()
        {
            // a stop of an arm without torque, or with a fault, has been made already
            state.core.brake();
            return Ok(());
        }
        if let Some(what) = state.core.fault() {
            return Err(DriverFault::Hardware(what.to_owned()));
        }
        state.core.command(arm, command).map_err(DriverFault::Refused)
    }

    fn sample(&mut self, now: Time) -> Result<Option<Sample>, DriverFault> {
        self.arm_time(now);
        let taken = {
            let mut state = self.shared.lock();
            if let Some(what) = state.core.fault() {
                return Err(DriverFault::Hardware(what.to_owned()));
            }
            state.core.take_sample()
        };
        Ok(taken.map(|sample| Sample { at: self.run_time(sample.at, now), ..sample }))
    }

    fn next_sample(&self, now: Time) -> Time {
        if self.shared.lock().core.has_sample() {
            return now;
        }
        let due = self.last + self.board.period + self.board.period / 10;
        // a reading that is overdue is looked for several times a period
        if due > now { due } else { now + self.board.period / 5 }
    }

    fn lease(&mut self, now: Time, until: Time) {
        let arm = self.arm_time(now);
        let mut state = self.shared.lock();
        if !self.looks && state.core.stage() == ConnectionStage::Driving {
            state.core.lease(arm, if until > now { arm + until.since(now) } else { Time::ZERO });
        }
    }

    fn answer_time(&self) -> Option<AnswerTime> {
        self.shared.lock().answer_time()
    }

    fn news(&mut self) -> Option<String> {
        self.shared.lock().news.take()
    }

    fn leads(&self) -> bool {
        true
    }

    fn modes(&self) -> Vec<ControlMode> {
        self.shared.lock().core.modes()
    }
}
