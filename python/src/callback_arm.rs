//! The state of an arm whose motors Python code moves and reads: trajectory, lease and readings. Pure: time comes in with each call. No Python
//! here.
//!
//! ```text
//! command ──checked──> Plant (the trajectory) ──each cycle──> positions for the motors
//! lease   ──ends─────> the trajectory brakes to a rest; then the motors are stopped, once
//! reading ──in time──> sample                     late: a lost reading, and the trajectory brakes
//! ```
//! The trajectory's time advances with the cycles alone, and by no more than two periods at once: a late cycle makes no step.

use mobee_contract::{Axis, Command, ControlMode, Sample, Time};
use mobee_sim::{Plant, path::Profile};
use std::collections::VecDeque;
use std::time::Duration;

/// Time over which a joint must rest.
const REST_TIME: Duration = Duration::from_millis(100);
/// A joint whose readings differ by no more rests, rad of encoder, unless its resolution is coarser: 0.05 degrees.
const REST_NOISE: f64 = 0.05 * std::f64::consts::PI / 180.0;
/// A motion is done no later than this after its trajectory has ended.
const MAX_SETTLING: Duration = Duration::from_secs(1);
/// The trajectory advances by no more periods at once.
const MAX_PERIODS: f64 = 2.0;
/// Greatest distance of a joint outside its limits at which it is driven, rad of encoder: 0.5 degrees.
const MAX_OUTSIDE: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// A joint this near to its last commanded position resumes there, rad of encoder, unless it may rest farther beside it: 3 degrees.
const RESUME_WITHIN: f64 = 3.0 * std::f64::consts::PI / 180.0;
/// The lease of the trajectory itself: the arm's lease is checked by its own time.
const UNBOUNDED: Duration = Duration::from_secs(1 << 30);

/// Positions for the motors in one cycle.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct CycleTargets {
    /// Positions, rad of encoder; `None` while the arm is only read.
    pub q: Option<Vec<f64>>,
    /// True if the motors are to be stopped afterwards: the arm rests, and its lease has ended.
    pub stop: bool,
}

/// The arm.
pub(crate) struct CallbackArm {
    axes: Vec<Axis>,
    period: Duration,
    plant: Plant,
    path_time: Time,
    ticked: Option<Time>,
    lease: Option<Time>,
    is_driven: bool,
    /// True from the first cycle with a lease on, until the motors are stopped.
    engaged: bool,
    recent: VecDeque<(Time, Vec<f64>)>,
    /// Time at which the trajectory of each motor had ended.
    ended: Vec<Option<Time>>,
    seq: u64,
    read_at: Option<Time>,
    unread: Option<Sample>,
}

impl CallbackArm {
    /// An arm that has not been read yet.
    pub fn new(axes: Vec<Axis>, period: Duration) -> Self {
        let ended = vec![None; axes.len()];
        Self {
            plant: Plant::new(axes.clone(), &[], Profile::MinimumJerk),
            axes,
            period,
            path_time: Time::ZERO,
            ticked: None,
            lease: None,
            is_driven: false,
            engaged: false,
            recent: VecDeque::new(),
            ended,
            seq: 0,
            read_at: None,
            unread: None,
        }
    }

    /// Tests that its motors follow the trajectory.
    pub fn is_driven(&self) -> bool {
        self.is_driven
    }

    /// Time of the last reading.
    pub fn read_at(&self) -> Option<Time> {
        self.read_at
    }

    /// Tests that the trajectory rests and has no lease.
    pub fn is_at_rest(&self) -> bool {
        !self.is_driven || (self.lease.is_none() && !self.plant.moves() && !self.engaged)
    }

    /// Control modes.
    pub fn modes(&self) -> Vec<ControlMode> {
        self.plant.modes()
    }

    /// The newest sample, unless it was taken before.
    pub fn take_sample(&mut self) -> Option<Sample> {
        self.unread.take()
    }

    /// Tests for a sample that was not taken.
    pub fn has_sample(&self) -> bool {
        self.unread.is_some()
    }

    /// Lets the arm move until then.
    pub fn lease(&mut self, now: Time, until: Time) {
        self.expire(now);
        if until > now && self.is_driven {
            self.lease = Some(until);
            self.plant.lease(self.path_time, self.path_time + UNBOUNDED);
        } else {
            self.lease = None;
            self.brake();
        }
    }

    /// Gives a command.
    ///
    /// # Errors
    /// The reason of a refusal; nothing is changed then.
    pub fn command(&mut self, now: Time, command: &Command) -> Result<(), String> {
        self.expire(now);
        if !self.is_driven {
            return Err("the arm is only read so far".into());
        }
        self.plant.command(self.path_time, command, Duration::ZERO)?;
        self.ended.fill(None);
        Ok(())
    }

    /// Brakes all motors.
    pub fn brake(&mut self) {
        self.plant.brake_all();
        if self.lease.is_none() {
            self.plant.lease(self.path_time, Time::ZERO);
        }
    }

    fn expire(&mut self, now: Time) {
        if self.lease.is_some_and(|until| until <= now) {
            self.lease = None;
            self.brake();
        }
    }

    /// One cycle.
    pub fn tick(&mut self, now: Time) -> CycleTargets {
        self.expire(now);
        let since = self.ticked.replace(now).map_or(self.period, |before| now.since(before));
        if !self.is_driven {
            return CycleTargets::default();
        }
        let step = since.as_secs_f64().min(MAX_PERIODS * self.period.as_secs_f64());
        self.path_time = self.path_time + Duration::from_secs_f64(step);
        self.plant.advance(self.path_time);
        for (slot, moves) in self.ended.iter_mut().zip(self.plant.done().iter().map(|done| !done)) {
            *slot = if moves { None } else { slot.or(Some(now)) };
        }
        let active = self.lease.is_some() || self.plant.moves();
        let stop = self.engaged && !active;
        let q = (self.engaged || active).then(|| self.plant.positions().collect());
        self.engaged = active;
        CycleTargets { q, stop }
    }

    /// Positions (rad of encoder) and external torques of all motors, as they were no earlier than `at`.
    pub fn take_reading(&mut self, at: Time, q: Vec<f64>, external: Vec<f64>) {
        if q.len() != self.axes.len() || self.read_at.is_some_and(|before| at <= before) {
            return;
        }
        self.read_at = Some(at);
        self.recent.push_back((at, q.clone()));
        while self.recent.front().is_some_and(|(before, _)| at.since(*before) > REST_TIME) {
            self.recent.pop_front();
        }
        self.seq += 1;
        let done = self.done(at);
        self.unread = Some(Sample { seq: self.seq, at, q: q.into(), done, external, ..Sample::default() });
    }

    /// A cycle was late, and its reading is lost: the trajectory brakes.
    pub fn lose_reading(&mut self) {
        self.seq += 1;
        self.brake();
    }

    /// A reading was lost in time: the motors continue.
    pub fn miss_reading(&mut self) {
        self.seq += 1;
    }

    fn rests(&self, motor: usize) -> bool {
        let readings = self.recent.iter().filter_map(|(_, q)| q.get(motor));
        let ends = readings.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), q| (low.min(*q), high.max(*q)));
        let noise = self.axes.get(motor).map_or(0.0, |axis| 2.0 * axis.resolution).max(REST_NOISE);
        ends.1 - ends.0 <= noise
    }

    fn done(&self, at: Time) -> Vec<bool> {
        let rests = (0..self.axes.len()).map(|motor| self.rests(motor));
        if !self.is_driven {
            return rests.collect();
        }
        let settled = |ended: &Option<Time>| ended.is_some_and(|ended| at.since(ended) > MAX_SETTLING);
        let each = self.plant.done().into_iter().zip(rests).zip(&self.ended);
        each.map(|((done, rests), ended)| done && (rests || settled(ended))).collect()
    }

    /// From now on its motors follow the trajectory, which rests where they are.
    ///
    /// # Arguments
    /// * `held`: the positions that the motors hold, rad of encoder; empty if unknown to the driver.
    ///
    /// # Errors
    /// A joint that is outside its limits: to drive it would move it.
    pub fn take_over(&mut self, held: &[f64]) -> Result<(), String> {
        let Some((_, measured)) = self.recent.back() else { return Err("it has not been read".into()) };
        let before: Vec<Option<f64>> = match (held.len() == self.axes.len(), self.engaged) {
            (true, _) => held.iter().copied().map(Some).collect(),
            (false, true) => self.plant.positions().map(Some).collect(),
            (false, false) => vec![None; self.axes.len()],
        };
        let mut start = Vec::with_capacity(self.axes.len());
        for ((axis, q), before) in self.axes.iter().zip(measured).zip(before) {
            if *q < axis.min - MAX_OUTSIDE || *q > axis.max + MAX_OUTSIDE {
                let told = |q: f64| axis.motion.told(q, 2);
                return Err(format!(
                    "joint {} is at {}, outside its limits {} to {}: move it there by hand, or correct what `read` returns or the limits",
                    axis.name,
                    told(*q),
                    told(axis.min),
                    told(axis.max)
                ));
            }
            // a loaded motor rests beside its target: with its position as the target it would sag
            let holds = |target: &f64| (target - q).abs() <= axis.hold_error.max(RESUME_WITHIN);
            start.push(before.filter(holds).unwrap_or(*q));
        }
        let modes = self.plant.modes();
        self.plant = Plant::new(self.axes.clone(), &start, Profile::MinimumJerk);
        self.path_time = Time::ZERO;
        // a board outlives the loss of its readings, and a retreat continues in the modes that it set
        for (motor, mode) in modes.into_iter().enumerate() {
            self.plant.command(self.path_time, &Command::Mode { motors: vec![motor], mode }, Duration::ZERO)?;
        }
        self.ticked = None;
        self.lease = None;
        self.ended.fill(None);
        self.is_driven = true;
        Ok(())
    }

    /// Drives it no longer: its readings have ended. Its motors hold by themselves.
    pub fn release(&mut self) {
        self.lease = None;
        self.brake();
        self.is_driven = false;
        self.recent.clear();
        self.unread = None;
    }
}
