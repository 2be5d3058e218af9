//! The driver's own rules: fencing, limits, and what is told of commands.

use crate::controller::Rules;
use crate::gate::Gate;
use mobee_contract::{Command, ControlMode, Driver, DriverFault, Event, Sample, Time, Writer};
use std::sync::Arc;
use std::time::Duration;

/// A stream of set-points that pauses for longer than this many control periods has ended.
const QUIET: u32 = 5;
/// How far beyond a limit a value may lie by rounding, rad.
const ROUNDING: f64 = 1e-9;

/// What the driver wants done.
pub enum DriverOut {
    /// Tell the taps.
    Event(Event),
    /// Begin the pulse.
    Sample(Sample),
    /// The board reports a fault of its own.
    Fault(DriverFault),
    /// Look again then.
    PollAt(Time),
}

/// Set-points since the stream began.
struct Streamed {
    token: u64,
    writer: Writer,
    count: u64,
    first: Time,
    last: Time,
    q: Vec<f64>,
    greatest_step: f64,
}

/// The state machine around a [`Driver`].
pub struct DriverCore {
    rules: Arc<Rules>,
    driver: Option<Box<dyn Driver>>,
    streamed: Option<Streamed>,
    faulty: bool,
}

impl DriverCore {
    /// Without a board yet.
    pub fn new(rules: Arc<Rules>) -> DriverCore {
        DriverCore { rules, driver: None, streamed: None, faulty: false }
    }

    /// Whether there is a board to talk to.
    pub fn is_connected(&self) -> bool {
        self.driver.is_some()
    }

    /// A board was found: it is stopped before anything else, whatever it was doing.
    pub fn connected(&mut self, now: Time, driver: Box<dyn Driver>, token: u64) -> Vec<DriverOut> {
        self.driver = Some(driver);
        let mut out = self.command(now, token, token, Writer::Driver, &Command::Stop { motors: Vec::new() });
        let mode = Command::Mode { motors: Vec::new(), mode: ControlMode::Position };
        out.extend(self.command(now, token, token, Writer::Driver, &mode));
        if let Some(driver) = &self.driver {
            out.push(DriverOut::PollAt(driver.next_sample(now)));
        } else {
            out.push(DriverOut::PollAt(now));
        }
        out
    }

    /// Passes a lease on.
    pub fn lease(&mut self, now: Time, until: Time) {
        if let Some(driver) = &mut self.driver {
            driver.lease(now, until);
        }
    }

    /// Looks at the encoders.
    pub fn poll(&mut self, now: Time) -> Vec<DriverOut> {
        let mut out = Vec::new();
        let quiet = self.rules.period * QUIET;
        if self.streamed.as_ref().is_some_and(|s| now.since(s.last) > quiet) {
            self.end_stream(&mut out);
        }
        let Some(driver) = &mut self.driver else { return out };
        match driver.sample(now) {
            Ok(sample) => {
                self.faulty = false;
                out.extend(sample.map(DriverOut::Sample));
            }
            Err(fault @ DriverFault::Hardware(_)) => {
                if !self.faulty {
                    out.push(DriverOut::Fault(fault));
                }
                self.faulty = true;
            }
            Err(_) => {
                self.driver = None;
                self.end_stream(&mut out);
                out.push(DriverOut::PollAt(now + self.rules.period));
                return out;
            }
        }
        // never in a tight loop, whatever a driver says
        out.push(DriverOut::PollAt(driver.next_sample(now).max(now + Duration::from_millis(1))));
        out
    }

    /// Gives a command to the board, if it was written under the present token and fits.
    pub fn command(&mut self, now: Time, present: u64, token: u64, writer: Writer, command: &Command) -> Vec<DriverOut> {
        let mut out = Vec::new();
        let refused = if token != present {
            Some(format!("written under token {token}, the present one is {present}"))
        } else if writer == Writer::Agent && !Gate::opens(token) {
            Some("an agent's command while the filter is closed".to_owned())
        } else {
            self.unfit(command).or_else(|| match &mut self.driver {
                None => Some(DriverFault::Lost.to_string()),
                Some(driver) => driver.command(now, command).err().map(|e| e.to_string()),
            })
        };
        let robot = self.rules.robot.clone();
        if let Some(reason) = refused {
            out.push(DriverOut::Event(Event::CommandDropped { robot, token, writer, reason }));
            return out;
        }
        if let Command::Direct { q } = command {
            self.stream(now, token, writer, q, &mut out);
        } else {
            self.end_stream(&mut out);
            out.push(DriverOut::Event(told(robot, token, writer, command)));
        }
        out
    }

    /// Why a command must not reach any board: values that are not finite or outside the limits (I5).
    fn unfit(&self, command: &Command) -> Option<String> {
        let axes = &self.rules.axes;
        let legal = |i: usize, q: f64| match axes.get(i) {
            None => Some(format!("there is no motor {i}")),
            Some(a) if !q.is_finite() => Some(format!("{}: not a finite number", a.name)),
            Some(a) if q < a.min - ROUNDING || q > a.max + ROUNDING => {
                Some(format!("{}: {:.4} deg is outside the limits", a.name, q.to_degrees()))
            }
            Some(_) => None,
        };
        match command {
            Command::Direct { q } if q.len() != axes.len() => Some("a set-point needs a value for every motor".into()),
            Command::Direct { q } => q.iter().enumerate().find_map(|(i, q)| legal(i, *q)),
            Command::Move(m) if m.motors.len() != m.q.len() => Some("lists of different length".into()),
            Command::Move(m) if !m.relative => m.motors.iter().zip(&m.q).find_map(|(i, q)| legal(*i, *q)),
            _ => None,
        }
    }

    fn stream(&mut self, now: Time, token: u64, writer: Writer, q: &[f64], out: &mut Vec<DriverOut>) {
        if self.streamed.as_ref().is_some_and(|s| s.token != token || s.writer != writer) {
            self.end_stream(out);
        }
        let axes = &self.rules.axes;
        match &mut self.streamed {
            None => {
                let q = q.to_vec();
                let s = Streamed { token, writer, count: 1, first: now, last: now, q, greatest_step: 0.0 };
                self.streamed = Some(s);
            }
            Some(s) => {
                let secs = now.since(s.last).max(self.rules.period).as_secs_f64();
                for ((new, old), axis) in q.iter().zip(&mut s.q).zip(axes.iter()) {
                    s.greatest_step = s.greatest_step.max((new - *old).abs() / (axis.max_speed * secs));
                    *old = *new;
                }
                s.count += 1;
                s.last = now;
            }
        }
    }

    fn end_stream(&mut self, out: &mut Vec<DriverOut>) {
        if let Some(s) = self.streamed.take() {
            out.push(DriverOut::Event(Event::Streamed {
                robot: self.rules.robot.clone(),
                token: s.token,
                writer: s.writer,
                count: s.count,
                span: (s.first, s.last),
                greatest_step: s.greatest_step,
                within_limits: true,
            }));
        }
    }
}

/// A command as an event.
fn told(robot: String, token: u64, writer: Writer, command: &Command) -> Event {
    let pairs = |motors: &[usize], values: &[f64]| motors.iter().copied().zip(values.iter().copied()).collect::<Vec<_>>();
    let (kind, q, speed) = match command {
        Command::Move(m) => {
            ("move", pairs(&m.motors, &m.q), m.speed.as_ref().map(|s| pairs(&m.motors, s)).unwrap_or_default())
        }
        Command::Direct { q } => ("direct", q.iter().copied().enumerate().collect(), Vec::new()),
        Command::Stop { .. } => ("stop", Vec::new(), Vec::new()),
        Command::Reference { motors, speed, .. } => ("reference", Vec::new(), pairs(motors, speed)),
        Command::Mode { .. } => ("mode", Vec::new(), Vec::new()),
    };
    Event::Command { robot, token, writer, kind: kind.into(), q, speed }
}
