//! The guard before a robot's driver: what passes, what is thrown away, and what is told of it (I1, I5).
//!
//! The last that a command meets, and the only place that all of them meet, whoever wrote them: agents through
//! supervise, the reflex on its retreat, supervise's own stops. It trusts none of them; what it refuses that supervise
//! let pass is a defect, and told as one.

use crate::Rules;
use crate::gate::Gate;
use mobee_contract::{Axis, Command, CommandKind, Event, Sample, Time, Writer};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Share of a motor's greatest speed that a set-point which had to wait may ask for: what is left is for the board to
/// catch up.
const SHARE: f64 = 0.95;

/// How far beyond its limits a motor may be read to be, rad: motors may rest a few degrees outside, and no farther than
/// a thumb can be bent.
const BEYOND: f64 = 20.0 * std::f64::consts::PI / 180.0;

/// A stream of set-points that is being written.
#[derive(Clone, Debug)]
struct Streaming {
    /// Under which token, and by whom: another is another stream.
    token: u64,
    /// Who writes it.
    writer: Writer,
    /// How many commands there were.
    count: u64,
    /// The motors that they named.
    motors: BTreeSet<usize>,
    /// Whether all of them were finite and within limits.
    within: bool,
    /// When the first and the last of them were written.
    span: (Time, Time),
    /// The last position of each motor that it named, rad; a stream of velocities has none.
    last: Option<Setpoints>,
    /// The greatest share of its motor's speed that one of them asked for.
    greatest_step: f64,
}

/// Positions that would be a jump if they were written at once.
#[derive(Debug)]
struct Waiting {
    /// Under which token they were written.
    token: u64,
    /// By whom.
    writer: Writer,
    /// Where to, rad.
    q: Setpoints,
}

/// What going on from a stream's last set-points to others would ask for.
struct NextStep<'a> {
    /// The set-points that were written last, rad.
    last: &'a Setpoints,
    /// The greatest share of a motor's speed.
    share: f64,
    /// The time since they were written, s.
    secs: f64,
}

/// Positions of some motors, rad, by their index.
type Setpoints = BTreeMap<usize, f64>;

/// The state machine before the driver. It clamps nothing: what does not fit is refused.
#[derive(Debug)]
pub struct CommandGuard {
    /// Of its robot.
    rules: Arc<Rules>,
    /// The stream under way: told as one line when it ends, since a journal of every set-point would be read by nobody.
    streaming: Option<Streaming>,
    /// The newest positions that had to wait; older ones are overtaken.
    waiting: Option<Waiting>,
    /// Whether the driver makes moves of set-points.
    pub leads: bool,
}

impl CommandGuard {
    /// A guard to one robot.
    pub fn new(rules: Arc<Rules>) -> CommandGuard {
        CommandGuard { rules, streaming: None, waiting: None, leads: false }
    }

    /// Whether this command may pass the gate. The token first: what was written before a close is void, whatever it
    /// says, and no defect of its writer's.
    ///
    /// # Errors
    /// Why not, in words.
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

    /// What is wrong with a reading: it must have a finite position for every motor. Such a one is thrown away; a board
    /// that tells only such ones is stale.
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

    /// A reading that no robot of this model can have: a motor far beyond its limits. Its name, and where it is said to
    /// be.
    pub fn is_beyond(&self, sample: &Sample) -> Option<String> {
        let far = |(q, axis): &(&f64, &Axis)| **q < axis.min - BEYOND || **q > axis.max + BEYOND;
        let (q, axis) = sample.q.iter().zip(self.rules.axes.iter()).find(far)?;
        let [min, max] = [axis.min, axis.max].map(f64::to_degrees);
        let (name, q) = (&axis.name, axis.motion.told(*q, 1));
        Some(format!("{name} reads {q}, and its limits are {min:.1}..{max:.1}: calibrate it, or mend the model"))
    }

    /// Whether a command fits its motors: written so that what is no number does not fit.
    fn fits(&self, command: &Command) -> Result<(), String> {
        let within = |motor: usize, q: f64| match self.rules.axes.get(motor) {
            None => Err(format!("there is no motor {motor}")),
            Some(axis) if !(q >= axis.min && q <= axis.max) => {
                Err(format!("{} is asked to go to {}", axis.name, axis.motion.told(q, 3)))
            }
            Some(_) => Ok(()),
        };
        let speeds = |list: &Option<Vec<f64>>| match list.iter().flatten().find(|v| !(v.is_finite() && **v >= 0.0)) {
            Some(v) => Err(format!("a reference of {v} makes no sense")),
            None => Ok(()),
        };
        match command {
            Command::Move(m) if m.relative => Err("relative moves do not pass the filter".into()),
            Command::Move(m) => {
                speeds(&m.speed)?;
                speeds(&m.acceleration)?;
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
            Command::Stop { .. } | Command::Reference { .. } | Command::Mode { .. } => Ok(()),
        }
    }

    /// Whether a motor may go so fast, rad/s; the last bit of a product may be rounded up.
    fn slow(&self, motor: usize, v: f64) -> Result<(), String> {
        match self.rules.axes.get(motor) {
            None => Err(format!("there is no motor {motor}")),
            // a comparison that is false for what is no number
            Some(axis) if v.abs() <= axis.max_speed * (1.0 + 1e-9) => Ok(()),
            Some(axis) => Err(format!("{} is asked to go at {}", axis.name, axis.motion.told_speed(v, 3))),
        }
    }

    /// The command if it may be written at once. Set-points of positions that come in a bunch, as after a driver that
    /// was held up, would make a board without limits of its own jump: the newest of them waits for
    /// [`CommandGuard::due`].
    pub fn pace(&mut self, token: u64, writer: Writer, command: Command, now: Time) -> Option<Command> {
        // whatever comes is newer than what waits: a stop, too, which must not be followed by a step
        self.waiting = None;
        let Command::Direct { motors, q } = command else { return Some(command) };
        let all: Setpoints = motors.iter().copied().zip(q.iter().copied()).collect();
        if self.step_to(token, writer, &all, now).is_none_or(|step| step.share <= 1.0) {
            return Some(Command::Direct { motors, q });
        }
        self.waiting = Some(Waiting { token, writer, q: all });
        None
    }

    /// What has waited and may be written now: a step towards it, or all of the way.
    pub fn due(&mut self, now: Time) -> Option<(u64, Writer, Command)> {
        let Waiting { token, writer, q } = self.waiting.take()?;
        let Some(NextStep { last, share, secs }) = self.step_to(token, writer, &q, now) else {
            return Some((token, writer, direct(q)));
        };
        let period = self.rules.period.as_secs_f64();
        // half a sample early rather than a whole one late
        if secs < 0.75 * period {
            self.waiting = Some(Waiting { token, writer, q });
            return None;
        }
        let part = SHARE * secs.min(1.5 * period) / (share * secs).max(1e-12);
        if part >= 1.0 {
            return Some((token, writer, direct(q)));
        }
        let towards = |(m, b): (&usize, &f64)| (*m, last.get(m).map_or(*b, |a| a + (b - a) * part));
        let step = q.iter().map(towards).collect();
        self.waiting = Some(Waiting { token, writer, q });
        Some((token, writer, direct(step)))
    }

    /// What going on to `q` now would ask for. `None`: it would be the stream's first, which is where the robot is.
    fn step_to(&self, token: u64, writer: Writer, q: &Setpoints, now: Time) -> Option<NextStep<'_>> {
        let stream = self.streaming.as_ref().filter(|s| s.token == token && s.writer == writer)?;
        let (last, secs) = (stream.last.as_ref()?, now.since(stream.span.1).as_secs_f64());
        Some(NextStep { last, share: share(&self.rules.axes, last, q, secs), secs })
    }

    /// What to tell of a command that the driver took: a stream only at its end.
    pub fn took(&mut self, token: u64, writer: Writer, command: &Command, now: Time) -> Vec<Event> {
        let by_motor = |motors: &[usize], values: &[f64]| motors.iter().copied().zip(values.iter().copied()).collect();
        let none = Vec::new;
        let Some(kind) = command.kind() else {
            let velocity = matches!(command, Command::Velocity { .. });
            // one of velocities after one of positions is another, though one program writes both
            let goes_on = |s: &Streaming| s.token == token && s.writer == writer && s.last.is_none() == velocity;
            let ended = self.streaming.as_ref().is_some_and(|s| !goes_on(s));
            let told = if ended { self.end_stream() } else { None };
            self.stream(token, writer, command, now);
            return told.into_iter().collect();
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
        let (robot, motors) = (self.rules.robot.clone(), motors.clone());
        let led = kind == CommandKind::Move && self.leads;
        let command = Event::Command { robot, token, writer, kind, motors, q, speed, led };
        self.end_stream().into_iter().chain([command]).collect()
    }

    /// Counts a set-point that was written.
    fn stream(&mut self, token: u64, writer: Writer, command: &Command, now: Time) {
        let stream = self.streaming.get_or_insert(Streaming {
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
                let all: Setpoints = motors.iter().copied().zip(q.iter().copied()).collect();
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

    /// Ends the stream of set-points, if there is one: what to tell of it.
    pub fn end_stream(&mut self) -> Option<Event> {
        let Streaming { token, writer, count, motors, within, span, last, greatest_step } = self.streaming.take()?;
        let (robot, motors) = (self.rules.robot.clone(), motors.into_iter().collect());
        let (last, within_limits) = (last.into_iter().flatten().collect(), within);
        Some(Event::Streamed { robot, token, writer, motors, count, span, greatest_step, within_limits, last })
    }
}

/// What the journal is told of a set-point that was written, whoever let it pass.
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

/// The command that goes there.
fn direct(q: Setpoints) -> Command {
    let (motors, q) = q.into_iter().unzip();
    Command::Direct { motors, q }
}

/// The greatest share of its axis' speed that a motor would need to get from one to the other in this time. One that
/// joins begins where it is.
fn share(axes: &[Axis], from: &Setpoints, to: &Setpoints, secs: f64) -> f64 {
    let step = |(m, b): (&usize, &f64)| {
        let (axis, a) = (axes.get(*m)?, from.get(m)?);
        Some((a - b).abs() / (axis.max_speed * secs).max(1e-12))
    };
    to.iter().filter_map(step).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests;
