//! A connection under test, which renews the lease, fetches every reading, and checks for jumps.

use super::Bench;
use mobee_contract::{Board, Command, ControlMode, Driver, DriverFault, Move, Sample, Time};
use std::f64::consts::PI;
use std::time::Duration;

/// One degree, rad.
pub const DEG: f64 = PI / 180.0;
/// Tolerance of readings at rest, rad: 0.1 deg.
pub const TOLERANCE_RAD: f64 = 0.1 * DEG;
/// Distance of the suite's motions, rad.
pub const DISTANCE_RAD: f64 = 8.0 * DEG;
/// Speed of the suite's motions, rad/s, unless the motor is slower.
const SPEED: f64 = 10.0 * DEG;
/// Time limit of a motion.
const MOTION_TIMEOUT: Duration = Duration::from_secs(30);

/// A driver under test.
pub struct DriverTrial<'a> {
    /// Bench of the trial.
    pub bench: &'a mut dyn Bench,
    /// The driver.
    pub driver: Box<dyn Driver>,
    /// Description of the board.
    pub board: Board,
    /// The newest reading.
    pub last: Sample,
    /// True if every step renews the lease.
    pub keeps_lease: bool,
}

impl<'a> DriverTrial<'a> {
    /// Connects, takes a lease and waits for the first reading.
    pub fn begin(bench: &'a mut dyn Bench) -> Result<DriverTrial<'a>, String> {
        DriverTrial::connect(bench, true)
    }

    /// Same as [`DriverTrial::begin`], with or without a lease.
    pub fn connect(bench: &'a mut dyn Bench, keeps_lease: bool) -> Result<DriverTrial<'a>, String> {
        let driver = bench.connect()?;
        let board = driver.board().clone();
        let none = Sample { seq: 0, at: Time::ZERO, q: Vec::new().into(), done: Vec::new(), ..Sample::default() };
        let mut trial = DriverTrial { bench, driver, board, last: none, keeps_lease };
        trial.first_reading()?;
        Ok(trial)
    }

    /// Replaces the driver, as after a crash of its actor.
    pub fn reconnect(&mut self) -> Result<(), String> {
        self.driver = self.bench.connect()?;
        self.first_reading()
    }

    fn first_reading(&mut self) -> Result<(), String> {
        for _ in 0..100 {
            self.renew();
            if let Some(s) = self.fetch()? {
                self.last = s;
                return Ok(());
            }
            self.pass();
        }
        Err("no reading within 100 periods".into())
    }

    /// Present time.
    pub fn now(&self) -> Time {
        self.bench.now()
    }

    /// Renews the lease if this trial maintains one.
    pub fn renew(&mut self) {
        let now = self.now();
        if self.keeps_lease {
            self.driver.lease(now, now + 20 * self.board.period);
        }
    }

    /// Waits until the next reading is due.
    pub fn pass(&mut self) {
        let now = self.now();
        let next = self.driver.next_sample(now).max(now + self.board.period / 100);
        self.bench.wait_until(next);
    }

    /// Fetches a reading.
    pub fn fetch(&mut self) -> Result<Option<Sample>, String> {
        let now = self.now();
        self.driver.sample(now).map_err(|e| format!("no reading: {e}"))
    }

    /// Advances by one period. Returns the reading, if there was one.
    pub fn step(&mut self) -> Result<Option<Sample>, String> {
        self.pass();
        self.renew();
        let Some(sample) = self.fetch()? else { return Ok(None) };
        let dt = sample.at.since(self.last.at).as_secs_f64();
        for ((axis, before), now) in self.board.axes.iter().zip(self.last.q.iter()).zip(sample.q.iter()) {
            if (now - before).abs() > axis.max_speed * dt + TOLERANCE_RAD {
                let way = axis.motion.told(now - before, 3);
                let name = &axis.name;
                return Err(format!("motor {name} jumped by {way} within {dt:.4} s"));
            }
        }
        self.last = sample.clone();
        Ok(Some(sample))
    }

    /// Waits for the next reading.
    pub fn next(&mut self) -> Result<(), String> {
        for _ in 0..100 {
            if self.step()?.is_some() {
                return Ok(());
            }
        }
        Err("no reading within 100 periods".into())
    }

    /// Advances by a time. Returns the readings.
    pub fn run(&mut self, time: Duration) -> Result<Vec<Sample>, String> {
        let end = self.now() + time;
        let mut all = Vec::new();
        while self.now() < end {
            all.extend(self.step()?);
        }
        Ok(all)
    }

    /// Advances by a number of periods, after commands in transit have arrived.
    pub fn settle(&mut self, periods: u32) -> Result<Vec<Sample>, String> {
        self.run(self.board.latency + periods * self.board.period)
    }

    /// Waits until all motors are done. Returns the readings.
    pub fn until_done(&mut self) -> Result<Vec<Sample>, String> {
        let end = self.now() + MOTION_TIMEOUT;
        let mut all = Vec::new();
        while self.now() < end {
            all.extend(self.step()?);
            if all.last().is_some_and(|s| s.done.iter().all(|d| *d)) {
                return Ok(all);
            }
        }
        Err(format!("not done within {MOTION_TIMEOUT:?}"))
    }

    /// Waits until all motors report this mode.
    pub fn until_mode(&mut self, mode: ControlMode) -> Result<(), String> {
        for _ in 0..200 {
            if self.driver.modes().iter().all(|m| *m == mode) {
                return Ok(());
            }
            self.step()?;
        }
        Err(format!("the motors don't report mode {mode:?}: {:?}", self.driver.modes()))
    }

    /// Sends a command that must be accepted.
    pub fn give(&mut self, command: Command) -> Result<(), String> {
        let now = self.now();
        self.renew();
        self.driver.command(now, &command).map_err(|e| format!("{command:?} was not accepted: {e}"))
    }

    /// Sends a command that must be refused without any effect, with a message that contains `naming`.
    pub fn refused(&mut self, command: Command, naming: &str) -> Result<(), String> {
        let now = self.now();
        let before = self.last.q.clone();
        self.renew();
        match self.driver.command(now, &command) {
            Err(DriverFault::Refused(text)) if text.contains(naming) => {}
            Err(DriverFault::Refused(text)) => return Err(format!("the refusal `{text}` does not name {naming}")),
            other => return Err(format!("{command:?} was not refused but gave {other:?}")),
        }
        self.settle(8)?;
        if !self.last.done.iter().all(|d| *d) {
            return Err(format!("after the refused {command:?} motors move"));
        }
        self.rests_at(&before).map_err(|e| format!("the refused {command:?} had an effect: {e}"))
    }

    /// Checks that the newest reading is near these positions.
    pub fn rests_at(&self, q: &[f64]) -> Result<(), String> {
        for ((axis, want), got) in self.board.axes.iter().zip(q).zip(self.last.q.iter()) {
            if (want - got).abs() > TOLERANCE_RAD || !got.is_finite() {
                let got = axis.motion.told(*got, 3);
                return Err(format!("motor {} is at {got}, not {:.3}", axis.name, want / DEG));
            }
        }
        Ok(())
    }

    /// Distance or position of a motor, formatted with its unit.
    pub fn in_units(&self, motor: usize, q: f64) -> String {
        self.board.units().of(motor).told(q, 2)
    }

    /// All motors.
    pub fn all(&self) -> Vec<usize> {
        (0..self.board.axes.len()).collect()
    }

    /// Up to three motors with room to move.
    pub fn motors(&self) -> Result<Vec<usize>, String> {
        let roomy = |a: &mobee_contract::Axis| a.max - a.min > 4.0 * DEG;
        let some: Vec<usize> =
            self.board.axes.iter().enumerate().filter(|(_, a)| roomy(a)).map(|(m, _)| m).take(3).collect();
        if some.len() < 2 { Err("the suite needs two motors with 4 deg (or mm) of room".into()) } else { Ok(some) }
    }

    /// Configuration with these motors moved by [`DISTANCE_RAD`] (or most of their room) towards the farther limit.
    pub fn away(&self, motors: &[usize]) -> Vec<f64> {
        let mut q = self.last.q.to_vec();
        for m in motors {
            if let (Some(slot), Some(axis)) = (q.get_mut(*m), self.board.axes.get(*m)) {
                let up = axis.max - *slot;
                let down = *slot - axis.min;
                *slot += if up >= down { DISTANCE_RAD.min(0.7 * up) } else { -DISTANCE_RAD.min(0.7 * down) };
            }
        }
        q
    }

    /// Speed of the suite's motions for this motor, and its greatest acceleration.
    pub fn reference(&self, motor: usize) -> (f64, f64) {
        self.board.axes.get(motor).map_or((SPEED, SPEED), |a| (SPEED.min(a.max_speed), a.max_acceleration))
    }

    /// Move of these motors to their positions in `pose` at the suite's speed.
    pub fn to(&self, motors: &[usize], pose: &[f64]) -> Move {
        let (speed, acceleration) = motors.iter().map(|m| self.reference(*m)).unzip();
        Move {
            motors: motors.to_vec(),
            q: motors.iter().map(|m| at(pose, *m)).collect(),
            relative: false,
            speed: Some(speed),
            acceleration: Some(acceleration),
        }
    }
}

/// Position of a motor in a configuration; NaN if it has none.
pub fn at(pose: &[f64], motor: usize) -> f64 {
    pose.get(motor).copied().unwrap_or(f64::NAN)
}

/// Fails with the message of `seen` unless the condition holds.
pub fn see(holds: bool, seen: impl FnOnce() -> String) -> Result<(), String> {
    if holds { Ok(()) } else { Err(seen()) }
}

/// Greatest speed of a motor over windows of about a tenth of a second, rad/s, and the error of this speed by
/// noise.
pub fn top_speed(samples: &[Sample], motor: usize) -> (f64, f64) {
    let mut top = (0.0, f64::INFINITY);
    for (i, s) in samples.iter().enumerate() {
        let later = samples.iter().skip(i).find(|l| l.at.since(s.at) >= Duration::from_millis(100));
        if let Some(l) = later {
            let dt = l.at.since(s.at).as_secs_f64();
            let v = (at(&l.q, motor) - at(&s.q, motor)).abs() / dt;
            if v > top.0 {
                top = (v, TOLERANCE_RAD / dt);
            }
        }
    }
    top
}
