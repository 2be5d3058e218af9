//! Requested and written set-points of a stream.
//!
//! Written set-points never jump. A position set-point that is farther than its axis can move in [`MAX_LEAD`] is
//! refused; a nearer one is approached at the axis' own speed. Velocities are lowered to the greatest speed of the
//! axis, and to the speed from which it can still brake before a limit when the lease expires.
//!
//! The reason: a board in position-direct or velocity mode executes a command at once, without a profile of its own.
//! A faulty stream (a jump, a pause, a velocity and then silence) would shake or overrun the robot, and the limits of
//! moves do not apply.

use crate::{Rules, within};
use mobee_contract::{Axis, Command, ControlMode, Pose, Refusal, Setpoints, Time, Values};
use std::time::Duration;

/// Greatest lead of a position set-point over the written one, in time at its axis' greatest speed. At ten set-points
/// a second, the slowest usual stream, each may still request full speed.
const MAX_LEAD: Duration = Duration::from_millis(100);
/// Greatest speed of written set-points, as a share of an axis' greatest speed: the rest lets a board catch up.
const MAX_SPEED_SHARE: f64 = 0.95;

/// Stream in progress. Several programs may share it, some motors in positions and others in velocities.
#[derive(Clone, Debug)]
pub(super) struct OpenStream {
    /// Set-points of each motor; `None`: the motor is not in the stream and is not commanded.
    slots: Vec<Option<MotorSetpoint>>,
    /// State of writing positions. Separate from velocities: each kind is one command, and two programs have their
    /// own rates.
    positions: Writing,
    /// State of writing velocities.
    velocities: Writing,
    /// Time of the last requested set-point.
    pub(super) last_request: Time,
    /// Time since which the robot brakes, by the times of the readings.
    pub(super) braking: Option<Time>,
    /// Detection of frozen encoders.
    pub(super) freeze_watch: StreamFreezeWatch,
    /// Time of the last reading.
    pub(super) seen: Time,
}

/// Detects frozen encoders during a stream: the motion of the set-points while readings are equal.
#[derive(Clone, Copy, Debug)]
pub(super) struct StreamFreezeWatch {
    /// Time since which the readings are equal bit for bit, from the history.
    pub(super) since: Time,
    /// Motion of the set-points since then, rad: that of the motor with the longest way.
    pub(super) moved: f64,
    /// The same at the last reading.
    pub(super) counted: f64,
    /// Time of the reading since which the set-points have moved, without a long pause; `None`: they rest.
    pub(super) began: Option<Time>,
    /// Time of the last reading at which they had moved.
    pub(super) moved_at: Time,
}

impl StreamFreezeWatch {
    /// Begins with readings that are equal since this time.
    pub(super) fn begin(since: Time) -> StreamFreezeWatch {
        StreamFreezeWatch { since, moved: 0.0, counted: 0.0, began: None, moved_at: since }
    }

    /// Notes whether the set-points have moved since the last reading. A robot that rested for long is not expected to
    /// have moved before its set-points did, so the time begins again after a pause of this length. The motion does not:
    /// steps with pauses between them add up.
    pub(super) fn count(&mut self, sampled_at: Time, pause: Duration) {
        if self.moved <= self.counted {
            return;
        }
        if self.began.is_none() || sampled_at.since(self.moved_at) >= pause {
            self.began = Some(sampled_at);
        }
        self.counted = self.moved;
        self.moved_at = sampled_at;
    }
}

/// Set-points of one motor: positions, rad, or velocities, rad/s.
#[derive(Clone, Copy, Debug)]
struct MotorSetpoint {
    /// Kind of the set-points.
    mode: ControlMode,
    /// Last requested value.
    requested: f64,
    /// Last written value, on the way to the requested one.
    written: f64,
    /// Time of the request.
    requested_at: Time,
}

/// State of writing one kind of set-points.
#[derive(Clone, Copy, Debug)]
struct Writing {
    /// Time of the last writing, by the clock.
    wrote: Time,
    /// True if a requested set-point has not been written, or not completely.
    pending: bool,
}

impl OpenStream {
    /// An empty stream. It counts as having written a period ago: its first set-point need not wait.
    pub(super) fn new(rules: &Rules, now: Time) -> OpenStream {
        let writing = Writing { wrote: now - rules.period, pending: false };
        OpenStream {
            slots: vec![None; rules.axes.len()],
            positions: writing,
            velocities: writing,
            last_request: now,
            braking: None,
            freeze_watch: StreamFreezeWatch::begin(now),
            seen: now,
        }
    }

    /// Motors of the stream.
    pub(super) fn named(&self) -> Vec<usize> {
        self.each().map(|(m, _)| m).collect()
    }

    /// Motors of the stream in this mode.
    pub(super) fn named_in(&self, mode: ControlMode) -> Vec<usize> {
        self.each().filter(|(_, slot)| slot.mode == mode).map(|(m, _)| m).collect()
    }

    /// Motors of the stream, with their set-points.
    fn each(&self) -> impl Iterator<Item = (usize, &MotorSetpoint)> {
        self.slots.iter().enumerate().filter_map(|(m, slot)| Some((m, slot.as_ref()?)))
    }

    /// Set-points of this motor, if it is in the stream.
    fn slot(&self, motor: usize) -> Option<&MotorSetpoint> {
        self.slots.get(motor)?.as_ref()
    }

    /// Returns whether this motor is in the stream.
    pub(super) fn names(&self, motor: usize) -> bool {
        self.slot(motor).is_some()
    }

    /// Returns whether the stream drives this motor in this mode.
    pub(super) fn drives(&self, motor: usize, mode: ControlMode) -> bool {
        self.slot(motor).is_some_and(|slot| slot.mode == mode)
    }

    /// Returns whether positions wait to be written.
    pub(super) fn goes_on(&self) -> bool {
        self.positions.pending
    }

    /// Greatest written velocity, rad/s; zero without velocities.
    pub(super) fn fastest(&self) -> f64 {
        self.each()
            .filter(|(_, slot)| slot.is_velocity())
            .fold(0.0, |most: f64, (_, slot)| most.max(slot.written.abs()))
    }

    /// Whole configuration with the requested positions, rad: the target of the open transaction. `rest`: values of
    /// the other motors.
    pub(super) fn requested(&self, rest: &[f64]) -> Pose {
        let requested = |(m, q): (usize, &f64)| self.slot(m).filter(|s| !s.is_velocity()).map_or(*q, |s| s.requested);
        rest.iter().enumerate().map(requested).collect()
    }

    /// Whole configuration with these values for the motors of the stream.
    pub(super) fn with(&self, rest: &[f64], values: &[f64]) -> Pose {
        let named = |(m, q): (usize, &f64)| values.get(m).filter(|_| self.names(m)).copied().unwrap_or(*q);
        rest.iter().enumerate().map(named).collect()
    }

    /// Last written position of a motor; `None` if it is driven by velocities or not in the stream.
    pub(super) fn sent(&self, motor: usize) -> Option<f64> {
        self.slot(motor).filter(|slot| !slot.is_velocity()).map(|slot| slot.written)
    }

    /// Removes these motors from the stream.
    pub(super) fn leave(&mut self, motors: &[usize]) {
        for m in motors {
            if let Some(slot) = self.slots.get_mut(*m) {
                *slot = None;
            }
        }
    }

    /// Ends the requests: velocities become zero, positions end at the last set-point, where the board holds. Returns
    /// the motors to stop: a velocity goes on until it is revoked.
    pub(super) fn brake(&mut self, now: Time) -> Vec<usize> {
        self.braking.get_or_insert(now);
        self.velocities.pending = false;
        for slot in self.slots.iter_mut().flatten().filter(|slot| slot.is_velocity()) {
            slot.requested = 0.0;
            slot.written = 0.0;
        }
        self.named_in(ControlMode::Velocity)
    }

    /// Adds set-points of the controller itself for these motors; `all`: one value per motor of the robot.
    pub(super) fn request(
        &mut self,
        motors: &[usize],
        mode: ControlMode,
        all: &[f64],
        (here, now): (&[f64], Time),
        rules: &Rules,
    ) {
        for m in motors {
            if let Some(value) = all.get(*m) {
                self.put(*m, mode, *value, (here, now), rules);
            }
        }
    }

    /// Adds one set-point of any size: writing limits it later.
    fn put(&mut self, motor: usize, mode: ControlMode, requested: f64, (here, now): (&[f64], Time), rules: &Rules) {
        let Some(slot) = self.slots.get_mut(motor) else { return };
        // A new set-point starts at the present position, and takes over from any other motion.
        let written = match slot.filter(|slot| slot.mode == mode) {
            Some(slot) => slot.written,
            None => start(motor, mode, here, rules),
        };
        let new = MotorSetpoint { mode, requested, written, requested_at: now };
        *slot = Some(new);
        self.last_request = now;
        let writing = if new.is_velocity() { &mut self.velocities } else { &mut self.positions };
        writing.pending = true;
    }

    /// Adds checked set-points, for a robot at `here`, rad. Positions are compared with the last written ones, not
    /// with readings, which lag behind.
    ///
    /// # Errors
    /// If a position is too far ahead; then nothing is changed.
    pub(super) fn take(
        &mut self,
        setpoints: &Setpoints,
        (here, now): (&[f64], Time),
        rules: &Rules,
    ) -> Result<(), Refusal> {
        let mode = mode_of(&setpoints.values);
        let (Values::Position(values) | Values::Velocity(values)) = &setpoints.values;
        let velocity = mode == ControlMode::Velocity;
        let each = || setpoints.motors.iter().zip(values).filter_map(|(m, v)| Some((*m, *v, rules.axes.get(*m)?)));
        // All are checked before any is accepted: half of a configuration would be another configuration.
        for (m, q, axis) in each().filter(|_| !velocity) {
            let written = self.sent(m).unwrap_or_else(|| start(m, mode, here, rules));
            let by = (q - written).abs();
            let most = axis.max_speed * MAX_LEAD.as_secs_f64() + rules.tolerance;
            if by > most {
                return Err(Refusal::Jump {
                    motor: axis.name.clone(),
                    by_deg: by.to_degrees(),
                    most_deg: most.to_degrees(),
                    motion: axis.motion,
                });
            }
        }
        for (m, value, axis) in each() {
            let requested = if velocity { value.clamp(-axis.max_speed, axis.max_speed) } else { value };
            self.put(m, mode, requested, (here, now), rules);
        }
        Ok(())
    }

    /// Returns the next commands, if any are due. Called at each reading and each set-point: after the last
    /// set-point, its position is still approached, and velocities are lowered before a limit.
    pub(super) fn write(&mut self, here: &[f64], rules: &Rules, now: Time) -> Vec<Command> {
        [self.write_velocities(here, rules, now), self.write_positions(rules, now)].into_iter().flatten().collect()
    }

    /// Writes new velocities, and lowers a velocity at once if necessary: braking does not wait for the period.
    fn write_velocities(&mut self, here: &[f64], rules: &Rules, now: Time) -> Option<Command> {
        let due = self.velocities.is_due(rules, now);
        let mut motors = Vec::new();
        let mut speed = Vec::new();
        let mut brakes = false;
        for (m, slot) in self.slots.iter_mut().enumerate() {
            let (Some(slot), Some(axis), Some(q)) = (slot, rules.axes.get(m), here.get(m)) else { continue };
            if !slot.is_velocity() {
                continue;
            }
            // A motor without new set-points stops, even if others go on.
            if now >= slot.requested_at + rules.stream_quiet {
                slot.requested = 0.0;
            }
            let allowed = before_limit(axis, *q, slot.requested, rules);
            brakes |= allowed.abs() < slot.written.abs() - 1e-9;
            motors.push(m);
            speed.push(allowed);
        }
        if motors.is_empty() || !(brakes || self.velocities.pending && due) {
            return None;
        }
        for (m, speed) in motors.iter().zip(&speed) {
            if let Some(Some(slot)) = self.slots.get_mut(*m) {
                slot.written = *speed;
            }
        }
        self.velocities = Writing { wrote: now, pending: false };
        Some(Command::Velocity { motors, speed })
    }

    /// Writes positions in steps, one per period, until the last requested ones are written.
    fn write_positions(&mut self, rules: &Rules, now: Time) -> Option<Command> {
        let Writing { wrote, pending } = self.positions;
        if !(pending && self.positions.is_due(rules, now)) {
            return None;
        }
        // After a pause only a little is made up for: a step for all of it would be the jump that must be avoided.
        let step = now.since(wrote).as_secs_f64().min(1.5 * rules.period.as_secs_f64());
        let mut motors = Vec::new();
        let mut q = Vec::new();
        let mut way = 0.0;
        let mut pending = false;
        for (m, (slot, axis)) in self.slots.iter_mut().zip(rules.axes.iter()).enumerate() {
            let Some(slot) = slot.as_mut().filter(|slot| !slot.is_velocity()) else { continue };
            let most = MAX_SPEED_SHARE * axis.max_speed * step;
            let by = (slot.requested - slot.written).clamp(-most, most);
            way = f64::max(way, by.abs());
            // Exactly the requested value, without rounding: equality marks completion.
            slot.written = if by == slot.requested - slot.written { slot.requested } else { slot.written + by };
            pending |= slot.written != slot.requested;
            motors.push(m);
            q.push(slot.written);
        }
        self.freeze_watch.moved += way;
        self.positions = Writing { wrote: now, pending };
        (!motors.is_empty()).then_some(Command::Direct { motors, q })
    }
}

impl MotorSetpoint {
    /// Returns whether these are velocities.
    fn is_velocity(self) -> bool {
        self.mode == ControlMode::Velocity
    }
}

/// Control mode for these set-points.
pub(super) fn mode_of(values: &Values) -> ControlMode {
    match values {
        Values::Position(_) => ControlMode::PositionDirect,
        Values::Velocity(_) => ControlMode::Velocity,
    }
}

impl Writing {
    /// Returns whether writing is due: half a sample early rather than a whole one late.
    fn is_due(self, rules: &Rules, now: Time) -> bool {
        now.since(self.wrote).as_secs_f64() >= 0.75 * rules.period.as_secs_f64()
    }
}

/// Value that a motor's first set-point starts from: its present position, or zero velocity.
fn start(motor: usize, mode: ControlMode, here: &[f64], rules: &Rules) -> f64 {
    match (here.get(motor), rules.axes.get(motor)) {
        (Some(q), Some(axis)) if mode == ControlMode::PositionDirect => within(*q, axis),
        _ => 0.0,
    }
}

/// Greatest velocity of a motor at `q` towards a limit: if there are no further commands, the driver brakes it when
/// the lease expires, and it must still come to rest before the limit.
fn before_limit(axis: &Axis, q: f64, v: f64, rules: &Rules) -> f64 {
    // Half of the tolerance, so that a target at the limit is reached.
    let room = if v > 0.0 { axis.max - q } else { q - axis.min } - 0.5 * rules.tolerance;
    let a = axis.max_acceleration;
    let late = (rules.fresh + rules.latency).as_secs_f64();
    if room <= 0.0 || a <= 0.0 {
        return 0.0;
    }
    // It moves on for `late`, until lease and latency have expired, then brakes: v late + v^2 / (2 a) = room.
    let most = a * ((late * late + 2.0 * room / a).sqrt() - late);
    v.clamp(-most, most)
}

#[cfg(test)]
mod tests;
