//! The driver's shell: owns the connection to one robot's hardware.

use crate::clock::ClockKind;
use crate::wiring::{DriverMsg, HardwareHandle, RobotContext, SharedContext, SuperviseMsg};
use mobee_contract::{Command, Driver, DriverFault, Event, Sample, Time, Writer};
use mobee_controller::command_guard::CommandGuard;
use mobee_controller::hold_offset::HoldOffsets;
use mobee_controller::pulse::Pulse;
use ractor::{Actor, ActorProcessingErr, ActorRef};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// The driver's actor.
pub struct DriverActor;

/// Shortest and longest time between two attempts to connect.
const BACK_OFF: (Duration, Duration) = (Duration::from_millis(50), Duration::from_secs(1));

/// State of a [`DriverActor`].
pub struct DriverState {
    shared: Arc<SharedContext>,
    context: Arc<RobotContext>,
    plug: HardwareHandle,
    driver: Option<Box<dyn Driver>>,
    guard: CommandGuard,
    offsets: HoldOffsets,
    back_off: Duration,
    /// True if the last reading was invalid.
    invalid: bool,
    /// True if the last reading was far beyond the limits.
    beyond: bool,
    /// Time at which the next poll is due.
    due: Option<Time>,
}

impl Actor for DriverActor {
    type Msg = DriverMsg;
    type State = DriverState;
    type Arguments = (Arc<SharedContext>, Arc<RobotContext>);

    async fn pre_start(
        &self,
        myself: ActorRef<DriverMsg>,
        (shared, context): Self::Arguments,
    ) -> Result<DriverState, ActorProcessingErr> {
        let plug = context.parts.lock().plug.clone();
        let guard = CommandGuard::new(context.rules());
        let (rules, model) = (context.rules(), context.parts.lock().model.clone());
        let offsets = HoldOffsets::new(&rules).with_weight(&rules, &model);
        let mut state = DriverState {
            shared,
            context,
            plug,
            driver: None,
            guard,
            offsets,
            back_off: BACK_OFF.0,
            invalid: false,
            beyond: false,
            due: None,
        };
        state.context.lease.store(0, Ordering::SeqCst);
        state.context.hold_offsets.lock().clear();
        state.connect();
        state.context.driver.connect(myself.clone());
        let _ = myself.send_message(DriverMsg::Poll);
        Ok(state)
    }

    async fn handle(
        &self,
        myself: ActorRef<DriverMsg>,
        message: DriverMsg,
        state: &mut DriverState,
    ) -> Result<(), ActorProcessingErr> {
        match message {
            DriverMsg::Poll => {
                state.count_delay();
                let next = state.poll();
                state.due = Some(next);
                let clock = state.shared.clock.clone();
                tokio::spawn(async move {
                    clock.sleep_until(next).await;
                    let _ = myself.send_message(DriverMsg::Poll);
                });
            }
            DriverMsg::Command(token, writer, command) => state.command(token, writer, command),
        }
        Ok(())
    }
}

impl DriverState {
    /// Connects to the hardware. A new connection begins with a stop, whatever the board was doing (I10).
    fn connect(&mut self) {
        let Ok(driver) = self.plug.0.connect() else { return };
        let robot = self.context.name.clone();
        let motors = driver.found();
        if !motors.is_empty() {
            self.shared.emit(Event::Found { robot, motors });
        }
        self.driver = Some(driver);
        self.back_off = BACK_OFF.0;
        let token = self.context.gate.token();
        self.give(token, Writer::Driver, &Command::Stop { motors: Vec::new() });
    }

    /// Counts the control periods by which the poll is late. In virtual time only a planted stall makes it
    /// late.
    fn count_delay(&self) {
        let now = self.shared.clock.now();
        if let Some(due) = self.due.filter(|_| self.shared.clock.kind() == ClockKind::Real) {
            let period = self.context.rules().period;
            self.shared.counts.lock().late.note(Duration::from_nanos(now.0), now.since(due), period);
        }
    }

    /// Reads the encoders, and returns the time of the next poll.
    fn poll(&mut self) -> Time {
        let now = self.shared.clock.now();
        if self.driver.is_none() {
            self.connect();
        }
        if let Some((token, writer, command)) = self.guard.due(now) {
            match self.guard.admit(&self.context.gate, token, writer, &command) {
                Ok(()) => self.give(token, writer, &command),
                Err(reason) => self.drop_command(token, writer, reason),
            }
        }
        let Some(driver) = self.driver.as_mut() else {
            self.back_off = (self.back_off * 2).min(BACK_OFF.1);
            return now + self.back_off;
        };
        driver.lease(now, Time(self.context.lease.load(Ordering::SeqCst)));
        if let Some(news) = driver.news() {
            self.shared.emit(Event::Warning { text: format!("{}: {news}", self.context.name) });
        }
        match driver.sample(now) {
            Ok(sample) => {
                let next = driver.next_sample(now).max(now + Duration::from_micros(100));
                if let Some(sample) = sample {
                    self.take(sample);
                }
                next
            }
            Err(fault) => self.trouble(&fault, now),
        }
    }

    /// Passes a reading on to history, unless it is invalid.
    fn take(&mut self, sample: Sample) {
        let wrong = self.guard.makes_no_sense(&sample);
        if let Some(what) = &wrong
            && !self.invalid
        {
            let robot = &self.context.name;
            let text = format!("{robot}: discarding invalid encoder readings: {what}");
            self.shared.emit(Event::Warning { text });
        }
        self.invalid = wrong.is_some();
        self.shared.counts.lock().samples += 1;
        let beyond = self.guard.is_beyond(&sample).filter(|_| wrong.is_none());
        if let Some(what) = &beyond
            && !self.beyond
        {
            self.context.supervise.send(SuperviseMsg::Fault(what.clone()));
        }
        self.beyond = beyond.is_some();
        if !self.invalid && !self.beyond {
            let unexplained = self.offsets.unexplained(&sample);
            let learned = self.offsets.learn(&sample);
            if !learned.is_empty() {
                self.context.hold_offsets.lock().extend(learned);
            }
            let answers = self.driver.as_ref().and_then(|driver| driver.answer_time());
            *self.context.answers.lock() = answers;
            self.context.to_history.push(Pulse { answers, unexplained, ..Pulse::new(sample, &self.shared.none) });
        }
    }

    fn trouble(&mut self, fault: &DriverFault, now: Time) -> Time {
        match fault {
            DriverFault::Lost => self.driver = None,
            DriverFault::Refused(what) | DriverFault::Hardware(what) => {
                self.context.supervise.send(SuperviseMsg::Fault(what.clone()));
            }
            DriverFault::TooFast(what) => {
                self.context.supervise.send(SuperviseMsg::TooFast(what.clone()));
            }
        }
        now + BACK_OFF.0
    }

    fn command(&mut self, token: u64, writer: Writer, command: Command) {
        if let Err(reason) = self.guard.admit(&self.context.gate, token, writer, &command) {
            return self.drop_command(token, writer, reason);
        }
        if let Some(command) = self.guard.pace(token, writer, command, self.shared.clock.now()) {
            self.give(token, writer, &command);
        }
    }

    fn give(&mut self, token: u64, writer: Writer, command: &Command) {
        let now = self.shared.clock.now();
        let Some(driver) = self.driver.as_mut() else {
            return self.drop_command(token, writer, DriverFault::Lost.to_string());
        };
        driver.lease(now, Time(self.context.lease.load(Ordering::SeqCst)));
        let hold = self.offsets.hold_after(command);
        let sent = if self.offsets.are_used() { &self.offsets.apply(command, now) } else { command };
        match driver.command(now, sent) {
            Ok(()) => {
                // Part of the stop. A board that does not accept it holds what it measured.
                hold.into_iter().for_each(|hold| drop(driver.command(now, &hold)));
                self.guard.leads = driver.leads();
                for event in self.guard.took(token, writer, command, now) {
                    self.shared.emit(event);
                }
            }
            Err(fault) => {
                self.drop_command(token, writer, fault.to_string());
                match fault {
                    DriverFault::Lost => self.driver = None,
                    DriverFault::Hardware(what) => {
                        self.context.supervise.send(SuperviseMsg::Fault(what));
                    }
                    DriverFault::TooFast(what) => {
                        self.context.supervise.send(SuperviseMsg::TooFast(what));
                    }
                    DriverFault::Refused(_) => {}
                }
            }
        }
    }

    fn drop_command(&mut self, token: u64, writer: Writer, reason: String) {
        let robot = self.context.name.clone();
        self.shared.emit(Event::CommandDropped { robot, token, writer, reason });
    }
}
