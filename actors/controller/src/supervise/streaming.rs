//! What is asked in a stream of set-points, and what of it is written.
//!
//! What is written never jumps: a set-point of position that is farther than its axis can go in [`AHEAD`] is refused,
//! and one that is nearer is gone to at the axis' own speed. Velocities are lowered to what the axis can do, and to
//! what can still be braked before a limit when the lease is over.
//!
//! Why so much care: a board in position-direct or velocity mode does at once what it is told, without a profile of its
//! own. Whoever streams badly (a jump, a pause, a velocity and then silence) would shake or overrun the robot, and no
//! limit of a move protects it.

use crate::{Rules, within};
use mobee_contract::{Axis, Command, ControlMode, Pose, Refusal, Setpoints, Time, Values};
use std::time::Duration;

/// How far ahead of what was written a set-point of position may be, in time at its axis' greatest speed. At ten
/// set-points a second, the slowest that anybody streams, each may still ask for full speed.
const AHEAD: Duration = Duration::from_millis(100);
/// Share of an axis' greatest speed that a written set-point may ask for: what is left is for a board that catches up.
const SHARE: f64 = 0.95;

/// A stream under way. Several programs may share it, some motors in positions and others in velocities.
#[derive(Clone, Debug)]
pub(super) struct Streaming {
    /// What each motor is asked for; no other is written to.
    slots: Vec<Option<Slot>>,
    /// When positions were written. Apart from velocities: each kind is one command, and two programs keep their own
    /// rates.
    positions: Writing,
    /// When velocities were written.
    velocities: Writing,
    /// When the last set-point came.
    pub(super) heard: Time,
    /// Since when the robot brakes, by the readings' time.
    pub(super) braking: Option<Time>,
    /// What tells frozen encoders.
    pub(super) still: Still,
    /// When the last reading was taken.
    pub(super) seen: Time,
}

/// How long the readings of a stream have been the same, and what they should have shown meanwhile.
#[derive(Clone, Copy, Debug)]
pub(super) struct Still {
    /// Since when they are equal bit for bit, as the history tells it.
    pub(super) since: Time,
    /// How far the set-points have moved since, rad: the way of the motor that was sent farthest.
    pub(super) moved: f64,
}

/// One motor's set-points: of position, rad, or of velocity, rad/s.
#[derive(Clone, Copy, Debug)]
struct Slot {
    /// Which of the two.
    mode: ControlMode,
    /// What its agent asked for last.
    asked: f64,
    /// What was written last, on the way there.
    written: f64,
    /// When it was asked.
    heard: Time,
}

/// What is to be written of one kind of set-points.
#[derive(Clone, Copy, Debug)]
struct Writing {
    /// When it was done last, by the clock.
    wrote: Time,
    /// Whether something was asked for that has not been written, or not to its end.
    pending: bool,
}

impl Streaming {
    /// One that has named no motor. As if it had written a period ago: its first set-point need not wait.
    pub(super) fn new(rules: &Rules, now: Time) -> Streaming {
        let writing = Writing { wrote: now - rules.period, pending: false };
        Streaming {
            slots: vec![None; rules.axes.len()],
            positions: writing,
            velocities: writing,
            heard: now,
            braking: None,
            still: Still { since: now, moved: 0.0 },
            seen: now,
        }
    }

    /// The motors it has named.
    pub(super) fn named(&self) -> Vec<usize> {
        self.each().map(|(m, _)| m).collect()
    }

    /// Those that are driven in this mode.
    pub(super) fn named_in(&self, mode: ControlMode) -> Vec<usize> {
        self.each().filter(|(_, slot)| slot.mode == mode).map(|(m, _)| m).collect()
    }

    /// The motors that it has named, by index.
    fn each(&self) -> impl Iterator<Item = (usize, &Slot)> {
        self.slots.iter().enumerate().filter_map(|(m, slot)| Some((m, slot.as_ref()?)))
    }

    /// What this motor is asked for, if it was named.
    fn slot(&self, motor: usize) -> Option<&Slot> {
        self.slots.get(motor)?.as_ref()
    }

    /// Whether it has named this motor.
    pub(super) fn names(&self, motor: usize) -> bool {
        self.slot(motor).is_some()
    }

    /// Whether it drives this motor in this mode.
    pub(super) fn drives(&self, motor: usize, mode: ControlMode) -> bool {
        self.slot(motor).is_some_and(|slot| slot.mode == mode)
    }

    /// Whether positions wait to be written.
    pub(super) fn goes_on(&self) -> bool {
        self.positions.pending
    }

    /// The fastest velocity that was written, rad/s; zero without one.
    pub(super) fn fastest(&self) -> f64 {
        self.each()
            .filter(|(_, slot)| slot.is_velocity())
            .fold(0.0, |most: f64, (_, slot)| most.max(slot.written.abs()))
    }

    /// A whole pose with the positions that were asked for, rad: what the open transaction shows as its target. `rest`
    /// has the other motors.
    pub(super) fn asked(&self, rest: &[f64]) -> Pose {
        let asked = |(m, q): (usize, &f64)| self.slot(m).filter(|s| !s.is_velocity()).map_or(*q, |s| s.asked);
        rest.iter().enumerate().map(asked).collect()
    }

    /// A whole pose with these values for the motors that it has named.
    pub(super) fn with(&self, rest: &[f64], values: &[f64]) -> Pose {
        let named = |(m, q): (usize, &f64)| values.get(m).filter(|_| self.names(m)).copied().unwrap_or(*q);
        rest.iter().enumerate().map(named).collect()
    }

    /// Where a motor was sent last, if it was to a position.
    pub(super) fn sent(&self, motor: usize) -> Option<f64> {
        self.slot(motor).filter(|slot| !slot.is_velocity()).map(|slot| slot.written)
    }

    /// These motors are no longer its own.
    pub(super) fn leave(&mut self, motors: &[usize]) {
        for m in motors {
            if let Some(slot) = self.slots.get_mut(*m) {
                *slot = None;
            }
        }
    }

    /// Nothing more is asked: velocities end, positions at the last of them, where their board holds. The motors that
    /// are to be stopped: a velocity goes on until somebody says otherwise.
    pub(super) fn brake(&mut self, now: Time) -> Vec<usize> {
        self.braking.get_or_insert(now);
        self.velocities.pending = false;
        for slot in self.slots.iter_mut().flatten().filter(|slot| slot.is_velocity()) {
            (slot.asked, slot.written) = (0.0, 0.0);
        }
        self.named_in(ControlMode::Velocity)
    }

    /// Takes in set-points of the controller's own for these motors, of one value for each of the robot's.
    pub(super) fn ask(
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

    /// Takes in one set-point, whatever it asks for: what of it is written is limited later.
    fn put(&mut self, motor: usize, mode: ControlMode, asked: f64, (here, now): (&[f64], Time), rules: &Rules) {
        let Some(slot) = self.slots.get_mut(motor) else { return };
        // from where it is: whatever it was doing before is taken over
        let written = match slot.filter(|slot| slot.mode == mode) {
            Some(slot) => slot.written,
            None => start(motor, mode, here, rules),
        };
        let new = Slot { mode, asked, written, heard: now };
        *slot = Some(new);
        self.heard = now;
        let writing = if new.is_velocity() { &mut self.velocities } else { &mut self.positions };
        writing.pending = true;
    }

    /// Takes in what was checked, of a robot that is at `here`, rad. Positions are measured against what was written
    /// last, not against readings, which lag behind.
    ///
    /// # Errors
    /// A position too far ahead; nothing is changed then.
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
        // all are judged before any is taken: half of a pose would be another pose
        for (m, q, axis) in each().filter(|_| !velocity) {
            let written = self.sent(m).unwrap_or_else(|| start(m, mode, here, rules));
            let (by, most) = ((q - written).abs(), axis.max_speed * AHEAD.as_secs_f64() + rules.tolerance);
            if by > most {
                let (by_deg, most_deg) = (by.to_degrees(), most.to_degrees());
                return Err(Refusal::Jump { motor: axis.name.clone(), by_deg, most_deg, motion: axis.motion });
            }
        }
        for (m, value, axis) in each() {
            let asked = if velocity { value.clamp(-axis.max_speed, axis.max_speed) } else { value };
            self.put(m, mode, asked, (here, now), rules);
        }
        Ok(())
    }

    /// The next commands, if there are any and it is time for them. At each reading and each set-point: a stream that
    /// goes quiet is still gone after to its last position, and lowered before a limit.
    pub(super) fn write(&mut self, here: &[f64], rules: &Rules, now: Time) -> Vec<Command> {
        [self.write_velocities(here, rules, now), self.write_positions(rules, now)].into_iter().flatten().collect()
    }

    /// Velocities are written when there are new ones, and at once when one must be lower: braking does not wait for
    /// its turn.
    fn write_velocities(&mut self, here: &[f64], rules: &Rules, now: Time) -> Option<Command> {
        let due = self.velocities.is_due(rules, now);
        let (mut motors, mut speed, mut brakes) = (Vec::new(), Vec::new(), false);
        for (m, slot) in self.slots.iter_mut().enumerate() {
            let (Some(slot), Some(axis), Some(q)) = (slot, rules.axes.get(m), here.get(m)) else { continue };
            if !slot.is_velocity() {
                continue;
            }
            // one that went quiet stops, whoever else goes on
            if now >= slot.heard + rules.stream_quiet {
                slot.asked = 0.0;
            }
            let allowed = before_limit(axis, *q, slot.asked, rules);
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

    /// Positions are gone to in steps, one a period, until the last one is written as it was asked for.
    fn write_positions(&mut self, rules: &Rules, now: Time) -> Option<Command> {
        let Writing { wrote, pending } = self.positions;
        if !(pending && self.positions.is_due(rules, now)) {
            return None;
        }
        // after a pause no more than a little is made up for: a step for all of it would be the jump that is to be
        // avoided
        let step = now.since(wrote).as_secs_f64().min(1.5 * rules.period.as_secs_f64());
        let (mut motors, mut q, mut way, mut pending) = (Vec::new(), Vec::new(), 0.0, false);
        for (m, (slot, axis)) in self.slots.iter_mut().zip(rules.axes.iter()).enumerate() {
            let Some(slot) = slot.as_mut().filter(|slot| !slot.is_velocity()) else { continue };
            let most = SHARE * axis.max_speed * step;
            let by = (slot.asked - slot.written).clamp(-most, most);
            way = f64::max(way, by.abs());
            // bit for bit what was asked, not what rounding leaves of it: equality tells that it is done
            slot.written = if by == slot.asked - slot.written { slot.asked } else { slot.written + by };
            pending |= slot.written != slot.asked;
            motors.push(m);
            q.push(slot.written);
        }
        self.still.moved += way;
        self.positions = Writing { wrote: now, pending };
        (!motors.is_empty()).then_some(Command::Direct { motors, q })
    }
}

impl Slot {
    /// Whether it is one of velocity.
    fn is_velocity(self) -> bool {
        self.mode == ControlMode::Velocity
    }
}

/// The mode in which motors take such set-points.
pub(super) fn mode_of(values: &Values) -> ControlMode {
    match values {
        Values::Position(_) => ControlMode::PositionDirect,
        Values::Velocity(_) => ControlMode::Velocity,
    }
}

impl Writing {
    /// Half a sample early rather than a whole one late.
    fn is_due(self, rules: &Rules, now: Time) -> bool {
        now.since(self.wrote).as_secs_f64() >= 0.75 * rules.period.as_secs_f64()
    }
}

/// What a motor's first set-point is measured against, and gone on from: where it is, or standing still.
fn start(motor: usize, mode: ControlMode, here: &[f64], rules: &Rules) -> f64 {
    match (here.get(motor), rules.axes.get(motor)) {
        (Some(q), Some(axis)) if mode == ControlMode::PositionDirect => within(*q, axis),
        _ => 0.0,
    }
}

/// The velocity towards which a motor at `q` may be driven: if nothing is heard from now on, the driver brakes it when
/// the lease is over, and it must still come to rest before its limit.
fn before_limit(axis: &Axis, q: f64, v: f64, rules: &Rules) -> f64 {
    // half of the tolerance, so that a target at the limit is reached
    let room = if v > 0.0 { axis.max - q } else { q - axis.min } - 0.5 * rules.tolerance;
    let (a, late) = (axis.max_acceleration, (rules.fresh + rules.latency).as_secs_f64());
    if room <= 0.0 || a <= 0.0 {
        return 0.0;
    }
    // it goes on for `late`, until lease and latency are over, and then brakes: v late + v^2 / (2 a) = room
    let most = a * ((late * late + 2.0 * room / a).sqrt() - late);
    v.clamp(-most, most)
}

#[cfg(test)]
mod tests;
