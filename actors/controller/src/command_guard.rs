//! Command guard of a robot's driver: it admits, discards and journals commands (I1, I5).
//!
//! The guard is the last stage that a command passes, and the only one for all writers: agents through Supervise, the
//! reflex during its retreat, and Supervise with its own stops. It trusts none of them. A command that it rejects
//! after Supervise admitted it is a defect, and is reported as one.

use crate::Rules;
use crate::gate::Gate;
use mobee_contract::{Axis, Command, CommandKind, Event, Sample, Time, Writer};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Greatest speed of a delayed set-point, as a share of a motor's greatest speed: the rest lets the board catch up.
const MAX_SPEED_SHARE: f64 = 0.95;

/// Greatest plausible reading beyond a limit, rad: motors may rest a few degrees outside, and no farther than a thumb
/// can be bent.
const MAX_BEYOND_LIMIT: f64 = 20.0 * std::f64::consts::PI / 180.0;

/// Stream of set-points in progress.
#[derive(Clone, Debug)]
struct GuardedStream {
    /// Token of the stream; another token or writer means another stream.
    token: u64,
    /// Writer of the stream.
    writer: Writer,
    /// Number of commands.
    count: u64,
    /// Motors named by the commands.
    motors: BTreeSet<usize>,
    /// True if all set-points were finite and within limits.
    within: bool,
    /// Times of the first and the last command.
    span: (Time, Time),
    /// Last position of each named motor, rad; `None` for a stream of velocities.
    last: Option<MotorPositions>,
    /// Greatest requested speed, as a share of the motor's greatest speed.
    greatest_step: f64,
}

/// Positions that would be a jump if they were written at once.
#[derive(Debug)]
struct Waiting {
    /// Token under which they were written.
    token: u64,
    /// Writer.
    writer: Writer,
    /// Target positions, rad.
    q: MotorPositions,
}

/// Requested step from a stream's last set-points to the next.
struct NextStep<'a> {
    /// Last written set-points, rad.
    last: &'a MotorPositions,
    /// Greatest requested speed, as a share of the motor's greatest speed.
    share: f64,
    /// Time since the last set-points, s.
    secs: f64,
}

/// Positions of some motors, rad, by their index.
type MotorPositions = BTreeMap<usize, f64>;

/// State machine in front of the driver. It does not clamp: a command that does not fit is rejected.
#[derive(Debug)]
pub struct CommandGuard {
    /// Parameters of the robot's controller.
    rules: Arc<Rules>,
    /// Stream in progress. It is journaled as one event when it ends, since a journal of every set-point would be
    /// unreadable.
    streaming: Option<GuardedStream>,
    /// Newest delayed positions; older ones are superseded.
    waiting: Option<Waiting>,
    /// True if the driver converts moves to set-points.
    pub leads: bool,
}

impl CommandGuard {
    /// Creates the guard of one robot.
    pub fn new(rules: Arc<Rules>) -> CommandGuard {
        CommandGuard { rules, streaming: None, waiting: None, leads: false }
    }

    /// Checks whether this command may pass the gate. The token is checked first: a command written before a closing
    /// is void, whatever its content, and this is no defect of its writer.
    ///
    /// # Errors
    /// The reason for the rejection, in words.
    pub fn admit(&self, gate: &Gate, token: u64, writer: Writer, command: &Command) -> Result<(), String> {
        let present = gate.token();
        if token != present {
            return Err(format!("written under token {token}, the present one is {present}"));
        }
        if writer == Writer::Agent && !Gate::opens(token) {
            return Err("the filter is closed".into());
        }
        if writer == Writer::Supervise && !matches!(command, Command::Stop { .. } | Command::Mode { .. }) {
            return Err("supervise itself only stops and sets modes".into());
        }
        self.fits(command)
    }

    /// Returns the defect of a malformed reading: it must have a finite position for every motor. Such readings are
    /// discarded; a board that sends no others is stale.
    pub fn makes_no_sense(&self, sample: &Sample) -> Option<String> {
        let n = self.rules.axes.len();
        if sample.q.len() != n || sample.done.len() != n {
            return Some(format!("{} positions of {n} motors", sample.q.len()));
        }
        if !sample.external.is_empty() && sample.external.len() != n {
            return Some(format!("{} external torques of {n} motors", sample.external.len()));
        }
        let not_finite = |list: &[f64]| list.iter().position(|x| !x.is_finite()).and_then(|m| self.rules.axes.get(m));
        let position = not_finite(&sample.q).map(|axis| format!("{} is not a finite number", axis.name));
        let torque =
            || not_finite(&sample.external).map(|axis| format!("{}'s torque is not a finite number", axis.name));
        let force = || (!sample.contact_n.is_finite()).then(|| "the contact force is not a finite number".to_owned());
        position.or_else(torque).or_else(force)
    }

    /// Describes a reading that is impossible for this robot model: a motor far beyond its limits.
    pub fn is_beyond(&self, sample: &Sample) -> Option<String> {
        let far = |(q, axis): &(&f64, &Axis)| **q < axis.min - MAX_BEYOND_LIMIT || **q > axis.max + MAX_BEYOND_LIMIT;
        let (q, axis) = sample.q.iter().zip(self.rules.axes.iter()).find(far)?;
        let [min, max] = [axis.min, axis.max].map(f64::to_degrees);
        let name = &axis.name;
        let q = axis.motion.told(*q, 1);
        Some(format!("{name} reads {q}, but its limits are {min:.1}..{max:.1}: calibrate it, or correct the model"))
    }

    /// Checks whether a command fits its motors; NaN never fits.
    fn fits(&self, command: &Command) -> Result<(), String> {
        let within = |motor: usize, q: f64| match self.rules.axes.get(motor) {
            None => Err(format!("there is no motor {motor}")),
            Some(axis) if !(q >= axis.min && q <= axis.max) => {
                Err(format!("{} is commanded to {}", axis.name, axis.motion.told(q, 3)))
            }
            Some(_) => Ok(()),
        };
        let exist = |motors: &[usize]| match motors.iter().find(|motor| self.rules.axes.get(**motor).is_none()) {
            Some(motor) => Err(format!("there is no motor {motor}")),
            None => Ok(()),
        };
        let references = |list: &[f64]| match list.iter().find(|v| !(v.is_finite() && **v >= 0.0)) {
            Some(v) => Err(format!("a reference of {v} is invalid")),
            None => Ok(()),
        };
        match command {
            Command::Move(m) if m.relative => Err("relative moves do not pass the filter".into()),
            Command::Move(m) => {
                references(m.speed.as_deref().unwrap_or_default())?;
                references(m.acceleration.as_deref().unwrap_or_default())?;
                if m.motors.len() != m.q.len() {
                    return Err("a move with lists of different length".into());
                }
                m.motors.iter().zip(&m.q).try_for_each(|(i, q)| within(*i, *q))
            }
            Command::Direct { motors, q } if motors.is_empty() || motors.len() != q.len() => {
                Err(format!("{} set-points for {} motors", q.len(), motors.len()))
            }
            Command::Direct { motors, q } => motors.iter().zip(q).try_for_each(|(i, q)| within(*i, *q)),
            Command::Velocity { motors, speed } if motors.is_empty() || motors.len() != speed.len() => {
                Err(format!("{} velocities for {} motors", speed.len(), motors.len()))
            }
            Command::Velocity { motors, speed } => motors.iter().zip(speed).try_for_each(|(i, v)| self.slow(*i, *v)),
            Command::Mode { motors, .. } if motors.is_empty() => Err("a mode for no motor".into()),
            Command::Reference { motors, .. } if motors.is_empty() => Err("references for no motor".into()),
            Command::Reference { motors, speed, acceleration } => {
                if [speed.len(), acceleration.len()] != [motors.len(); 2] {
                    return Err("references with lists of different length".into());
                }
                exist(motors)?;
                references(speed)?;
                references(acceleration)
            }
            // A stop of no motor stops all.
            Command::Stop { motors } | Command::Mode { motors, .. } => exist(motors),
        }
    }

    /// Checks whether a motor may move at this speed, rad/s; tolerates a product rounded up in its last bit.
    fn slow(&self, motor: usize, v: f64) -> Result<(), String> {
        match self.rules.axes.get(motor) {
            None => Err(format!("there is no motor {motor}")),
            // false for NaN
            Some(axis) if v.abs() <= axis.max_speed * (1.0 + 1e-9) => Ok(()),
            Some(axis) => Err(format!("{} is commanded to move at {}", axis.name, axis.motion.told_speed(v, 3))),
        }
    }

    /// Returns the command if it may be written at once. Position set-points that arrive in a burst, as after a delay
    /// in the driver, would make a board without limits of its own jump: the newest of them waits for
    /// [`CommandGuard::due`].
    pub fn pace(&mut self, token: u64, writer: Writer, command: Command, now: Time) -> Option<Command> {
        // Each command supersedes a waiting one, also a stop, after which no step may follow.
        self.waiting = None;
        let Command::Direct { motors, q } = command else { return Some(command) };
        let all: MotorPositions = motors.iter().copied().zip(q.iter().copied()).collect();
        if self.step_to(token, writer, &all, now).is_none_or(|step| step.share <= 1.0) {
            return Some(Command::Direct { motors, q });
        }
        self.waiting = Some(Waiting { token, writer, q: all });
        None
    }

    /// Returns the next step of the delayed set-points, if it may be written now: a part or all of the remaining
    /// distance.
    pub fn due(&mut self, now: Time) -> Option<(u64, Writer, Command)> {
        let Waiting { token, writer, q } = self.waiting.take()?;
        let Some(NextStep { last, share, secs }) = self.step_to(token, writer, &q, now) else {
            return Some((token, writer, direct(q)));
        };
        let period = self.rules.period.as_secs_f64();
        // Half a sample early rather than a whole one late.
        if secs < 0.75 * period {
            self.waiting = Some(Waiting { token, writer, q });
            return None;
        }
        let part = MAX_SPEED_SHARE * secs.min(1.5 * period) / (share * secs).max(1e-12);
        if part >= 1.0 {
            return Some((token, writer, direct(q)));
        }
        let towards = |(m, b): (&usize, &f64)| (*m, last.get(m).map_or(*b, |a| a + (b - a) * part));
        let step = q.iter().map(towards).collect();
        self.waiting = Some(Waiting { token, writer, q });
        Some((token, writer, direct(step)))
    }

    /// Computes the step of the present stream to `q`. `None` for the first set-points of a stream, which are at the
    /// robot's present position.
    fn step_to(&self, token: u64, writer: Writer, q: &MotorPositions, now: Time) -> Option<NextStep<'_>> {
        let stream = self.streaming.as_ref().filter(|s| s.token == token && s.writer == writer)?;
        let last = stream.last.as_ref()?;
        let secs = now.since(stream.span.1).as_secs_f64();
        Some(NextStep { last, share: share(&self.rules.axes, last, q, secs), secs })
    }

    /// Returns the events for a command that the driver accepted; a stream is journaled only at its end.
    pub fn took(&mut self, token: u64, writer: Writer, command: &Command, now: Time) -> Vec<Event> {
        let by_motor = |motors: &[usize], values: &[f64]| motors.iter().copied().zip(values.iter().copied()).collect();
        let none = Vec::new;
        let Some(kind) = command.kind() else {
            let velocity = matches!(command, Command::Velocity { .. });
            // A stream of velocities after one of positions is a new stream, even from the same writer.
            let goes_on = |s: &GuardedStream| s.token == token && s.writer == writer && s.last.is_none() == velocity;
            let ended = self.streaming.as_ref().is_some_and(|s| !goes_on(s));
            let event = if ended { self.end_stream() } else { None };
            self.stream(token, writer, command, now);
            return event.into_iter().collect();
        };
        let (motors, q, speed) = match command {
            Command::Move(m) => {
                let speed = m.speed.as_deref().unwrap_or_default();
                (&m.motors, by_motor(&m.motors, &m.q), by_motor(&m.motors, speed))
            }
            Command::Stop { motors } | Command::Mode { motors, .. } => (motors, none(), none()),
            Command::Reference { motors, speed, .. } => (motors, none(), by_motor(motors, speed)),
            Command::Direct { motors, .. } | Command::Velocity { motors, .. } => (motors, none(), none()),
        };
        let robot = self.rules.robot.clone();
        let motors = motors.clone();
        let led = kind == CommandKind::Move && self.leads;
        let command = Event::Command { robot, token, writer, kind, motors, q, speed, led };
        self.end_stream().into_iter().chain([command]).collect()
    }

    /// Adds a written set-point to the stream.
    fn stream(&mut self, token: u64, writer: Writer, command: &Command, now: Time) {
        let stream = self.streaming.get_or_insert(GuardedStream {
            token,
            writer,
            count: 0,
            motors: BTreeSet::new(),
            within: true,
            span: (now, now),
            last: None,
            greatest_step: 0.0,
        });
        let axes = &self.rules.axes;
        let step = match command {
            Command::Direct { motors, q } => {
                let secs = now.since(stream.span.1).as_secs_f64();
                let all: MotorPositions = motors.iter().copied().zip(q.iter().copied()).collect();
                let last = stream.last.get_or_insert_default();
                let step = share(axes, last, &all, secs);
                last.extend(all);
                step
            }
            Command::Velocity { motors, speed } => {
                let share = |(m, v): (&usize, &f64)| axes.get(*m).map_or(0.0, |axis| v.abs() / axis.max_speed);
                motors.iter().zip(speed).map(share).fold(0.0, f64::max)
            }
            _ => 0.0,
        };
        if let Command::Direct { motors, .. } | Command::Velocity { motors, .. } = command {
            stream.motors.extend(motors);
        }
        stream.within &= within_limits(axes, command);
        stream.greatest_step = stream.greatest_step.max(step);
        stream.count += 1;
        stream.span.1 = now;
    }

    /// Ends the stream of set-points, if there is one, and returns its event.
    pub fn end_stream(&mut self) -> Option<Event> {
        let GuardedStream { token, writer, count, motors, within, span, last, greatest_step } =
            self.streaming.take()?;
        let robot = self.rules.robot.clone();
        let motors = motors.into_iter().collect();
        let last = last.into_iter().flatten().collect();
        Some(Event::Streamed { robot, token, writer, motors, count, span, greatest_step, within_limits: within, last })
    }
}

/// Returns whether a written set-point is within limits, for the journal; independent of the checks that admitted it.
fn within_limits(axes: &[Axis], command: &Command) -> bool {
    match command {
        Command::Direct { motors, q } => {
            let fits = |(m, q): (&usize, &f64)| axes.get(*m).is_some_and(|axis| (axis.min..=axis.max).contains(q));
            motors.iter().zip(q).all(fits)
        }
        Command::Velocity { motors, speed } => {
            let slow =
                |(m, v): (&usize, &f64)| axes.get(*m).is_some_and(|axis| v.abs() <= axis.max_speed * (1.0 + 1e-9));
            motors.iter().zip(speed).all(slow)
        }
        _ => true,
    }
}

/// Creates the command with these set-points.
fn direct(q: MotorPositions) -> Command {
    let (motors, q) = q.into_iter().unzip();
    Command::Direct { motors, q }
}

/// Greatest speed between these set-points in this time, as a share of the axis' greatest speed. A motor without a
/// last set-point starts at its present position.
fn share(axes: &[Axis], from: &MotorPositions, to: &MotorPositions, secs: f64) -> f64 {
    let step = |(m, b): (&usize, &f64)| {
        let axis = axes.get(*m)?;
        let a = from.get(m)?;
        Some((a - b).abs() / (axis.max_speed * secs).max(1e-12))
    };
    to.iter().filter_map(step).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests;
