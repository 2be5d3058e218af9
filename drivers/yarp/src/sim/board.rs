//! YARP control board of one part of a simulated robot: the device behind the ports of `mobee sim`.
//!
//! ```text
//! rpc:i, command:i ──> SimBoard ──Command──> the motors of one part (SimHardware)
//! state:o, stateExt:o <── Shadow <── their readings
//! ```
//! The model uses millimeters for prismatic joints; boards, and so this one, use meters
//! ([`SimBoard::counting`]). It behaves as real boards do: it moves on command without a lease, in its
//! present mode, at the reference speeds it was given.

use crate::joint_kind;
use mobee_contract::{Command, Context, ControlMode, Driver, DriverFault, Hardware, KindError, Move, Sample, Time};
use mobee_model::Scene;
use mobee_sim::{Imitated, SimHardware, SimSettings};
use mobee_yarp::board::{
    Ask, Device, Get, JointKind, Joints, Quantity, Reply, Set, Shadow, ShadowAxis, Streamed, Units, mode, reply,
};
use mobee_yarp::{Bottle, Dialect, JointData, Message, Stamp, Vocab};
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::time::Instant;

/// Lease of a simulated board towards its own driver: unlimited.
const FOR_EVER: Duration = Duration::from_secs(1 << 30);

/// Period at which boards publish their states, unless they imitate boards that differ.
const PUBLISHES: Duration = Duration::from_millis(20);

/// One part of a simulated robot as a control board.
pub struct SimBoard {
    part: String,
    state: Mutex<SimBoardState>,
    clock: SimClock,
}

/// Clock of a simulation in real time.
#[derive(Clone, Copy, Debug)]
pub struct SimClock {
    begun: Instant,
    speed: f64,
    wall: f64,
}

impl SimClock {
    /// Creates a clock that starts now, runs `speed` times as fast as the wall clock, and maps now to `wall`
    /// (seconds since 1970).
    #[expect(clippy::disallowed_methods, reason = "a simulation for other processes runs in real time")]
    pub fn start(speed: f64, wall: f64) -> SimClock {
        SimClock { begun: Instant::now(), speed, wall }
    }

    /// Time of the simulation.
    pub fn now(&self) -> Time {
        Time::from_secs(self.begun.elapsed().as_secs_f64() * self.speed)
    }

    /// Time of day at a time of the simulation, s since 1970.
    pub fn wall(&self, at: Time) -> f64 {
        self.wall + at.secs() / self.speed
    }
}

/// The hardware behind one board, or behind all boards of an arm with servos.
struct BoardArm {
    hardware: SimHardware,
    driver: Box<dyn Driver>,
    /// Newest reading, which all its boards share.
    last: Option<Sample>,
}

struct SimBoardState {
    arm: Arc<Mutex<BoardArm>>,
    /// Motors of the arm that this board moves.
    motors: Range<usize>,
    shadow: Shadow,
    answers: Stamp,
    states: Stamp,
}

impl SimBoard {
    /// Creates the boards of all parts of a robot, under the settings of the driver kind `sim`. The joints of an arm
    /// with servos push each other across parts, so all its boards share one arm; it has neither weight nor contacts
    /// until [`SimBoard::place`].
    ///
    /// # Errors
    /// The first setting that can't be used.
    pub fn all(settings: &SimSettings, context: &Context, clock: SimClock) -> Result<Vec<SimBoard>, KindError> {
        settings.validate()?;
        let settings = &settings.for_robot(&context.robot);
        let lost = |e: DriverFault| KindError::new("", e.to_string(), "");
        let whole = match settings.arm() {
            Some(_) => Some(BoardArm::connect(SimHardware::new(settings, context)?).map_err(lost)?),
            None => None,
        };
        let axes = settings.axes(&context.robot);
        let start = settings.start(&context.robot)?;
        let mut boards = Vec::new();
        for (i, part) in context.robot.parts.iter().enumerate() {
            let motors = part.motors.clone();
            let (Some(axes), Some(start)) = (axes.get(motors.clone()), start.get(motors.clone())) else {
                continue;
            };
            if axes.is_empty() {
                continue;
            }
            let units = context.robot.motors.get(motors.clone()).unwrap_or_default();
            let units = Units::new(units.iter().map(|m| joint_kind(m.motion)));
            let board = match &whole {
                Some(arm) => SimBoard::of(&part.name, arm.clone(), motors, clock),
                None => {
                    let seed = context.seed.wrapping_add(i as u64);
                    let hardware = SimHardware::with_axes(axes.to_vec(), start, settings, seed);
                    SimBoard::new(&part.name, hardware, clock).map_err(lost)?
                }
            };
            boards.push(board.counting(&units));
        }
        Ok(boards)
    }

    /// Places its arm, with the joints of all its boards, among the objects of a scene, in which it is robot `robot`;
    /// kinematic joints touch nothing.
    ///
    /// # Errors
    /// A scene that the physics can't simulate.
    pub fn place(&self, scene: &Scene, robot: usize) -> Result<(), KindError> {
        lock(&self.lock().arm).hardware.place(scene, robot)
    }

    /// Creates a simulated board for a part.
    ///
    /// # Errors
    /// A board that already has a fault.
    pub fn new(part: &str, hardware: SimHardware, clock: SimClock) -> Result<SimBoard, DriverFault> {
        let motors = 0..hardware.axes().len();
        Ok(SimBoard::of(part, BoardArm::connect(hardware)?, motors, clock))
    }

    /// Creates the board of some motors of an arm.
    fn of(part: &str, arm: Arc<Mutex<BoardArm>>, motors: Range<usize>, clock: SimClock) -> SimBoard {
        let axis = |(a, q): (&mobee_contract::Axis, &f64)| {
            let [min, max, speed, q] = [a.min, a.max, a.max_speed, *q].map(f64::to_degrees);
            ShadowAxis { ref_acc: a.max_acceleration.to_degrees(), ..ShadowAxis::at_rest(&a.name, min, max, speed, q) }
        };
        let whole = lock(&arm);
        let q = whole.hardware.positions(clock.now());
        let axes = whole.hardware.axes().iter().zip(&q).map(axis);
        let mut shadow = Shadow { axes: axes.skip(motors.start).take(motors.len()).collect() };
        if let Some(robot) = whole.hardware.imitates() {
            shadow.axes.iter_mut().enumerate().for_each(|(j, axis)| axis.name = robot.joint(j));
        }
        drop(whole);
        let state = SimBoardState { arm, motors, shadow, answers: Stamp::default(), states: Stamp::default() };
        SimBoard { part: part.to_owned(), state: Mutex::new(state), clock }
    }

    /// Sets the joint kinds, which the board then reports; prismatic joints use meters.
    pub fn counting(self, units: &Units) -> SimBoard {
        for (j, axis) in self.lock().shadow.axes.iter_mut().enumerate() {
            axis.count_as(units.kind(j));
        }
        self
    }

    /// Name of the part.
    pub fn part(&self) -> &str {
        &self.part
    }

    /// True positions of its motors, rad (prismatic ones in the model's unit).
    pub fn positions(&self) -> Vec<f64> {
        let state = self.lock();
        let mut q = lock(&state.arm).hardware.positions(self.clock.now());
        state.own(&mut q);
        q
    }

    /// Period at which it publishes its state.
    pub fn publishes(&self) -> Duration {
        lock(&self.lock().arm).hardware.imitates().map_or(PUBLISHES, Imitated::publishes)
    }

    fn lock(&self) -> MutexGuard<'_, SimBoardState> {
        lock(&self.state)
    }

    /// Answers a request.
    pub(crate) fn answer(&self, request: &Bottle) -> Bottle {
        let now = self.clock.now();
        let mut state = self.lock();
        state.look(now);
        // as on real boards, an answer is stamped when it is made
        let stamp = state.answers.next(self.clock.wall(now));
        let parsed = Ask::parse(request);
        // iCub_SIM can neither read nor set accelerations
        if lock(&state.arm).hardware.imitates().is_some()
            && matches!(
                parsed,
                Some(Ask::Get(Get::Values(Quantity::ReferenceAcceleration, _)) | Ask::Set(Set::Acceleration(..)))
            )
        {
            return reply::fail();
        }
        if let Some(answer) = state.shadow.answer(request, stamp) {
            if answer.len() > 1 {
                state.answers = stamp;
            }
            return answer;
        }
        let axes = state.shadow.axes.len();
        match parsed {
            Some(ask @ Ask::Set(_)) if !ask.fits(axes) => reply::fail(),
            Some(Ask::Set(set)) => match state.set(now, &set) {
                Some(()) => reply::ok(),
                None => reply::fail(),
            },
            _ => reply::unknown(request),
        }
    }
}

/// Settings of a joint that outlive the program that set them, in degrees, or meters for prismatic joints.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointSettings {
    /// Reference speed.
    pub speed: f64,
    /// Reference acceleration.
    pub acceleration: f64,
    /// Control mode.
    pub mode: Vocab,
    /// Interaction mode.
    pub interaction: Vocab,
}

impl SimBoard {
    /// Present settings, joint by joint.
    pub fn joint_settings(&self) -> Vec<JointSettings> {
        let mut state = self.lock();
        state.look(self.clock.now());
        let axes = state.shadow.axes.iter();
        axes.map(|a| JointSettings {
            speed: a.ref_speed,
            acceleration: a.ref_acc,
            mode: a.mode,
            interaction: a.interaction,
        })
        .collect()
    }
}

impl Device for SimBoard {
    fn rpc(&self, request: Message) -> Reply {
        let answer = match request.payload.bottle(Dialect::V3) {
            Ok(bottle) => self.answer(&bottle),
            Err(_) => reply::fail(),
        };
        Box::pin(std::future::ready(answer.into()))
    }

    fn command(&self, from: &str, _connection: u64, head: Bottle, body: Vec<f64>) {
        let now = self.clock.now();
        let mut state = self.lock();
        state.look(now);
        let done = Streamed::parse(&head, &body, state.shadow.axes.len()).and_then(|s| state.stream(now, &s));
        if done.is_none() {
            tracing::debug!(part = self.part, from, head = %head, "a streamed command was refused");
        }
    }

    fn state(&self) -> Option<(Stamp, JointData)> {
        let now = self.clock.now();
        let mut state = self.lock();
        state.look(now);
        // the stamp is the time at which the encoders were read, not published
        let read = lock(&state.arm).last.as_ref().map_or(now, |s| s.at);
        let stamp = state.states.next(self.clock.wall(read));
        state.states = stamp;
        Some((stamp, state.shadow.joint_data()))
    }
}

fn lock<T>(of: &Mutex<T>) -> MutexGuard<'_, T> {
    of.lock().unwrap_or_else(PoisonError::into_inner)
}

impl BoardArm {
    /// Connects to the hardware.
    fn connect(hardware: SimHardware) -> Result<Arc<Mutex<BoardArm>>, DriverFault> {
        let driver = hardware.connect()?;
        Ok(Arc::new(Mutex::new(BoardArm { hardware, driver, last: None })))
    }

    /// Renews the lease and fetches the newest reading. True if the hardware has a fault.
    fn look(&mut self, now: Time) -> bool {
        self.driver.lease(now, now + FOR_EVER);
        let sample = self.driver.sample(now);
        let faulty = matches!(sample, Err(DriverFault::Hardware(_)));
        if let Ok(Some(sample)) = sample {
            self.last = Some(sample);
        }
        faulty
    }
}

impl SimBoardState {
    /// Reduces a list of values per motor of the arm to those of this board.
    fn own<T>(&self, all: &mut Vec<T>) {
        all.truncate(self.motors.end);
        all.drain(..self.motors.start.min(all.len()));
    }

    /// Indices of some of its joints in the arm.
    fn in_arm(&self, joints: &[usize]) -> Vec<usize> {
        joints.iter().map(|j| j + self.motors.start).collect()
    }

    /// Updates the shadow from the simulated hardware.
    fn look(&mut self, now: Time) {
        let mut arm = lock(&self.arm);
        let faulty = arm.look(now);
        let mut speeds = arm.hardware.speeds(now);
        let mut done = arm.hardware.done(now);
        let mut modes = arm.driver.modes();
        let mut q = arm.last.as_ref().map(|s| s.q.to_vec()).unwrap_or_default();
        let mut external = arm.last.as_ref().map(|s| s.external.clone()).unwrap_or_default();
        drop(arm);
        [&mut speeds, &mut q, &mut external].into_iter().for_each(|all| self.own(all));
        self.own(&mut done);
        self.own(&mut modes);
        for (i, axis) in self.shadow.axes.iter_mut().enumerate() {
            if let Some(q) = q.get(i) {
                axis.q = axis.kind.to_wire(q.to_degrees());
            }
            axis.speed = axis.kind.to_wire(speeds.get(i).copied().unwrap_or_default().to_degrees());
            axis.done = done.get(i).copied().unwrap_or_default();
            // the board reports the effort of the joint, which is opposite to the external one
            axis.torque = external.get(i).map(|pushed| 0.0 - pushed);
            let known = modes.get(i).map_or(mode::UNKNOWN, |m| word(*m));
            axis.mode = if faulty { mode::HARDWARE_FAULT } else { known };
        }
    }

    fn give(&mut self, now: Time, command: &Command) -> Option<()> {
        lock(&self.arm).driver.command(now, command).ok()
    }

    /// True if all these joints are in this mode.
    fn are_in(&self, joints: &[usize], mode: Vocab) -> bool {
        joints.iter().all(|j| self.shadow.axes.get(*j).is_some_and(|a| a.mode == mode))
    }

    /// Converts values of some joints from the wire's units to the plant's.
    fn radians(&self, joints: &[usize], values: &[f64]) -> Vec<f64> {
        let kind = |j: &usize| self.shadow.axes.get(*j).map_or(JointKind::Unknown, |axis| axis.kind);
        joints.iter().zip(values).map(|(j, v)| kind(j).from_wire(*v).to_radians()).collect()
    }

    fn note(&mut self, joints: &[usize], values: &[f64], slot: fn(&mut ShadowAxis) -> &mut f64) {
        for (j, v) in joints.iter().zip(values) {
            if let Some(axis) = self.shadow.axes.get_mut(*j) {
                *slot(axis) = *v;
            }
        }
    }

    /// Executes an order that fits the board; `None` if it fails.
    fn set(&mut self, now: Time, set: &Set) -> Option<()> {
        let axes = self.shadow.axes.len();
        match set {
            Set::Move { joints, values, relative } => self.go(now, &joints.on(axes)?, values, *relative),
            Set::Velocity(values) => self.velocity(now, &Joints::All.on(axes)?, values),
            Set::Stop(joints) => {
                let joints = joints.on(axes)?;
                // a stop without motors is one of the whole arm
                if !joints.is_empty() {
                    self.give(now, &Command::Stop { motors: self.in_arm(&joints) })?;
                }
                let q: Vec<f64> = joints.iter().filter_map(|j| self.shadow.axes.get(*j)).map(|a| a.q).collect();
                self.note(&joints, &q, |a| &mut a.target);
                self.note(&joints, &vec![0.0; joints.len()], |a| &mut a.vel_ref);
                Some(())
            }
            Set::Speed(joints, values) => self.refer(now, &joints.on(axes)?, values, |a| &mut a.ref_speed),
            Set::Acceleration(joints, values) => self.refer(now, &joints.on(axes)?, values, |a| &mut a.ref_acc),
            Set::Mode(joints, modes) => {
                let known: Vec<ControlMode> = modes.iter().map(|m| control(*m)).collect::<Option<_>>()?;
                for (j, mode) in joints.on(axes)?.into_iter().zip(known) {
                    self.give(now, &Command::Mode { motors: self.in_arm(&[j]), mode })?;
                    // setpoints begin at the present position
                    let axis = self.shadow.axes.get_mut(j)?;
                    axis.direct_ref = axis.q;
                }
                Some(())
            }
            Set::Interaction(joints, modes) => {
                if !modes.iter().all(|m| [mode::STIFF, mode::COMPLIANT].contains(m)) {
                    return None;
                }
                for (j, mode) in joints.on(axes)?.into_iter().zip(modes) {
                    self.shadow.axes.get_mut(j)?.interaction = *mode;
                }
                Some(())
            }
            // encoders and limits of a simulation are fixed
            Set::Limits(..) | Set::SpeedLimits(..) | Set::ResetEncoders(_) | Set::Encoders(..) => None,
        }
    }

    fn stream(&mut self, now: Time, command: &Streamed) -> Option<()> {
        let axes = self.shadow.axes.len();
        match command {
            Streamed::Move(values) => self.go(now, &Joints::All.on(axes)?, values, false),
            Streamed::Velocity(joints, values) => self.velocity(now, &joints.on(axes)?, values),
            Streamed::Direct(joints, values) => {
                let motors = joints.on(axes)?;
                if !self.are_in(&motors, mode::DIRECT) {
                    return None;
                }
                let q = self.radians(&motors, values);
                self.give(now, &Command::Direct { motors: self.in_arm(&motors), q })?;
                self.note(&motors, values, |a| &mut a.direct_ref);
                Some(())
            }
        }
    }

    fn go(&mut self, now: Time, joints: &[usize], values: &[f64], relative: bool) -> Option<()> {
        if !self.are_in(joints, mode::POSITION) {
            return None;
        }
        let q = self.radians(joints, values);
        let command = Move { motors: self.in_arm(joints), q, relative, speed: None, acceleration: None };
        self.give(now, &Command::Move(command))?;
        let base = |j: &usize| self.shadow.axes.get(*j).filter(|_| relative).map_or(0.0, |a| a.q);
        let targets: Vec<f64> = joints.iter().zip(values).map(|(j, v)| base(j) + v).collect();
        self.note(joints, &targets, |a| &mut a.target);
        Some(())
    }

    fn velocity(&mut self, now: Time, joints: &[usize], values: &[f64]) -> Option<()> {
        if !self.are_in(joints, mode::VELOCITY) {
            return None;
        }
        let speed = self.radians(joints, values);
        self.give(now, &Command::Velocity { motors: self.in_arm(joints), speed })?;
        self.note(joints, values, |a| &mut a.vel_ref);
        Some(())
    }

    fn refer(
        &mut self,
        now: Time,
        joints: &[usize],
        values: &[f64],
        slot: fn(&mut ShadowAxis) -> &mut f64,
    ) -> Option<()> {
        let before = self.shadow.clone();
        // boards use the absolute value
        self.note(joints, &values.iter().map(|v| v.abs()).collect::<Vec<f64>>(), slot);
        let of = |get: fn(&ShadowAxis) -> f64| {
            let axes = joints.iter().filter_map(|j| self.shadow.axes.get(*j));
            axes.map(|a| a.kind.from_wire(get(a)).to_radians()).collect()
        };
        let speed = of(|a| a.ref_speed);
        let acceleration = of(|a| a.ref_acc);
        let given = self.give(now, &Command::Reference { motors: self.in_arm(joints), speed, acceleration });
        if given.is_none() {
            self.shadow = before;
        }
        given
    }
}

fn word(of: ControlMode) -> Vocab {
    match of {
        ControlMode::Idle => mode::IDLE,
        ControlMode::Position => mode::POSITION,
        ControlMode::PositionDirect => mode::DIRECT,
        ControlMode::Velocity => mode::VELOCITY,
    }
}

fn control(word: Vocab) -> Option<ControlMode> {
    match word {
        mode::IDLE | mode::FORCE_IDLE => Some(ControlMode::Idle),
        mode::POSITION => Some(ControlMode::Position),
        mode::DIRECT => Some(ControlMode::PositionDirect),
        mode::VELOCITY => Some(ControlMode::Velocity),
        _ => None,
    }
}
