//! Hardware under observation: records the commands for one motor, and its readings.

use super::measures::{Order, Reading, Record};
use mobee_contract::{
    Answer, AnswerTime, AsFound, Board, Command, ControlMode, Driver, DriverFault, Hardware, KindError, Known,
    NativeMessage, NativeState, Paces, Sample, Time,
};
use mobee_driver_yarp::Encoder;
use mobee_model::Scene;
use mobee_runtime::system::Control;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::mpsc;

/// Time after which a halted robot is released, s.
const HALT_S: f64 = 3.0;

/// The observations so far, shared by the agent, the driver and the evaluation.
#[derive(Debug)]
pub(super) struct Observed {
    pub record: Record,
    /// The board, once connected.
    pub board: Option<Board>,
    /// The stop during a motion.
    pub trial: StopTrial,
    /// The encoders of all motors.
    encoders: Vec<Encoder>,
    robot: String,
    motor: usize,
    controls: mpsc::Sender<Control>,
}

/// State of the stop trial. Times are seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum StopTrial {
    Off,
    /// The robot will be halted when the motor is halfway from here to its target.
    Armed(f64),
    /// Halted, with the time of the halt.
    Halted(f64),
}

pub(super) type Shared = Arc<Mutex<Observed>>;

/// Locks the observations; an agent or driver that panicked leaves a usable record.
pub(super) fn lock(shared: &Mutex<Observed>) -> MutexGuard<'_, Observed> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Observed {
    /// Empty observations of this motor, of a robot that can be halted through these controls.
    pub fn new(robot: &str, motor: usize, controls: mpsc::Sender<Control>) -> Shared {
        let record = Record::default();
        let trial = StopTrial::Off;
        let robot = robot.to_owned();
        Arc::new(Mutex::new(Observed { record, board: None, trial, encoders: Vec::new(), robot, motor, controls }))
    }

    /// Of the motors whose encoders are coarser than the driver's setting: the one with the greatest count, and that
    /// count, deg.
    pub fn coarse(&self) -> Option<(String, f64)> {
        let axes = self.board.iter().flat_map(|board| &board.axes).zip(&self.encoders);
        let counts = axes.filter(|(axis, encoder)| axis.resolution.to_degrees() < 0.7 * encoder.count());
        let counts = counts.map(|(axis, encoder)| (axis.name.clone(), encoder.count()));
        counts.max_by(|a, b| a.1.total_cmp(&b.1))
    }

    fn sent(&mut self, now: Time, command: &Command) {
        let nth = |motors: &[usize]| motors.iter().position(|m| *m == self.motor);
        let of = |motors: &[usize], values: &[f64]| Some(values.get(nth(motors)?)?.to_degrees());
        let order = match command {
            Command::Move(to) if !to.relative => of(&to.motors, &to.q).map(|q| Order::Move {
                to: q,
                speed: to.speed.as_ref().and_then(|speed| of(&to.motors, speed)).unwrap_or_default(),
            }),
            Command::Direct { motors, q } => of(motors, q).map(Order::Point),
            Command::Stop { motors } => (motors.is_empty() || nth(motors).is_some()).then_some(Order::Stop),
            Command::Move(_) | Command::Velocity { .. } | Command::Reference { .. } | Command::Mode { .. } => None,
        };
        self.record.orders.extend(order.map(|order| (now.secs(), order)));
    }

    fn read(&mut self, now: Time, sample: &Sample) {
        let (Some(q), Some(done)) = (sample.q.get(self.motor), sample.done.get(self.motor)) else { return };
        if !q.is_finite() {
            return;
        }
        self.encoders.resize_with(sample.q.len(), Encoder::default);
        self.encoders.iter_mut().zip(sample.q.iter()).for_each(|(encoder, q)| encoder.read(q.to_degrees(), false));
        let q = q.to_degrees();
        let torque = sample.external.get(self.motor).copied().filter(|nm| nm.is_finite());
        self.record.readings.push(Reading { at: sample.at.secs(), q, done: *done, torque });
        let target = match self.record.orders.last() {
            Some((_, Order::Move { to, .. })) => Some(*to),
            _ => None,
        };
        match (self.trial, target) {
            // the previous order led to the present position
            (StopTrial::Armed(from), Some(to)) if (to - from).abs() > 1.0 && (q - from) / (to - from) >= 0.5 => {
                self.control(Control::Halt(self.robot.clone()));
                self.trial = StopTrial::Halted(now.secs());
            }
            (StopTrial::Halted(since), _) if now.secs() - since >= HALT_S => {
                self.control(Control::Release(self.robot.clone()));
                self.trial = StopTrial::Off;
            }
            _ => {}
        }
    }

    fn control(&self, control: Control) {
        // a run that is ending accepts no controls; the stop then counts as not measured
        let _ = self.controls.try_send(control);
    }
}

/// The hardware with its record.
pub(super) struct RecordingHardware {
    pub inner: Arc<dyn Hardware>,
    pub shared: Shared,
}

impl Hardware for RecordingHardware {
    fn connect(&self) -> Result<Box<dyn Driver>, DriverFault> {
        let driver = self.inner.connect()?;
        let mut board = driver.board().clone();
        lock(&self.shared).board = Some(board.clone());
        // The controller would correct the sag, and with it the targets and speeds that the board is measured by.
        for axis in &mut board.axes {
            axis.hold_error = 0.0;
            axis.stop_sinks = false;
        }
        Ok(Box::new(RecordingDriver { inner: driver, board, shared: self.shared.clone() }))
    }

    fn look(&self) -> Option<Result<Box<dyn Driver>, DriverFault>> {
        self.inner.look()
    }

    fn runs_in_virtual_time(&self) -> bool {
        self.inner.runs_in_virtual_time()
    }

    fn place(&self, scene: &Scene, robot: usize) -> Result<(), KindError> {
        self.inner.place(scene, robot)
    }

    fn let_go(&self) {
        self.inner.let_go();
    }

    fn known(&self) -> Known {
        self.inner.known()
    }

    fn was_found(&self, found: &[AsFound]) {
        self.inner.was_found(found);
    }

    fn paces(&self) -> Vec<Paces> {
        self.inner.paces()
    }

    fn passthrough(&self, part: &str, request: NativeMessage) -> Option<Answer<Result<NativeMessage, DriverFault>>> {
        self.inner.passthrough(part, request)
    }

    fn native_state(&self, part: &str) -> Option<NativeState> {
        self.inner.native_state(part)
    }
}

struct RecordingDriver {
    inner: Box<dyn Driver>,
    /// The board as the controller sees it: without hold offsets.
    board: Board,
    shared: Shared,
}

impl Driver for RecordingDriver {
    fn board(&self) -> &Board {
        &self.board
    }

    fn command(&mut self, now: Time, command: &Command) -> Result<(), DriverFault> {
        self.inner.command(now, command)?;
        lock(&self.shared).sent(now, command);
        Ok(())
    }

    fn sample(&mut self, now: Time) -> Result<Option<Sample>, DriverFault> {
        let sample = self.inner.sample(now)?;
        if let Some(sample) = &sample {
            lock(&self.shared).read(now, sample);
        }
        Ok(sample)
    }

    fn next_sample(&self, now: Time) -> Time {
        self.inner.next_sample(now)
    }

    fn lease(&mut self, now: Time, until: Time) {
        self.inner.lease(now, until);
    }

    fn answer_time(&self) -> Option<AnswerTime> {
        self.inner.answer_time()
    }

    fn news(&mut self) -> Option<String> {
        self.inner.news()
    }

    fn found(&self) -> Vec<AsFound> {
        self.inner.found()
    }

    fn leads(&self) -> bool {
        self.inner.leads()
    }

    fn modes(&self) -> Vec<ControlMode> {
        self.inner.modes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mobee_contract::Move;

    /// Moves motor 1 of two, and reads it; returns the control that the run received.
    #[test]
    fn a_robot_is_halted_halfway_to_its_new_target_and_released_later() {
        let (sender, mut controls) = mpsc::channel(4);
        let shared = Observed::new("arm", 1, sender);
        let mut seen = lock(&shared);
        let go = |seen: &mut Observed, to: f64| {
            let q = vec![1.0, to.to_radians()];
            let speed = Some(vec![0.0, 0.5]);
            let to = Move { motors: vec![0, 1], q, relative: false, speed, acceleration: None };
            seen.sent(Time::ZERO, &Command::Move(to));
        };
        let mut read = |seen: &mut Observed, at: f64, deg: f64| {
            let sample = Sample { q: vec![9.0, deg.to_radians()].into(), done: vec![true, false], ..Sample::default() };
            seen.read(Time::from_secs(at), &sample);
            controls.try_recv().ok()
        };
        go(&mut seen, 0.01);
        seen.trial = StopTrial::Armed(0.0);
        assert!(read(&mut seen, 1.0, 0.02).is_none(), "that is where the order before led to");
        go(&mut seen, 12.0);
        assert!(read(&mut seen, 1.5, 5.0).is_none());
        assert!(matches!(read(&mut seen, 2.0, 6.1), Some(Control::Halt(robot)) if robot == "arm"));
        assert!(read(&mut seen, 4.9, 7.0).is_none());
        assert!(matches!(read(&mut seen, 5.1, 7.0), Some(Control::Release(_))));
        assert_eq!((seen.trial, seen.record.readings.len()), (StopTrial::Off, 5));
        let orders: Vec<Order> = seen.record.orders.iter().map(|(_, order)| *order).collect();
        let to = |order: &Order| matches!(order, Order::Move { to, speed } if (to - 12.0).abs() < 1e-9 && (speed - 28.6).abs() < 0.1);
        assert!(orders.len() == 2 && to(&orders[1]), "{orders:?}");
    }

    /// Ignores readings and orders of other motors, and positions that are not numbers.
    #[test]
    fn only_the_motor_is_recorded() {
        let (sender, _controls) = mpsc::channel(1);
        let shared = Observed::new("arm", 1, sender);
        let mut seen = lock(&shared);
        seen.sent(Time::ZERO, &Command::Direct { motors: vec![0], q: vec![1.0] });
        seen.sent(Time::ZERO, &Command::Stop { motors: vec![0] });
        seen.sent(Time::ZERO, &Command::Stop { motors: vec![] });
        let reading = |q: f64, external: Vec<f64>| Sample {
            q: vec![0.0, q].into(),
            done: vec![true; 2],
            external,
            ..Sample::default()
        };
        seen.read(Time::ZERO, &reading(f64::NAN, vec![]));
        seen.read(Time::ZERO, &reading(0.0, vec![1.0, f64::NAN]));
        seen.read(Time::ZERO, &reading(0.0, vec![1.0, -2.5]));
        assert_eq!(seen.record.orders, [(0.0, Order::Stop)]);
        let torques: Vec<Option<f64>> = seen.record.readings.iter().map(|r| r.torque).collect();
        assert_eq!(torques, [None, Some(-2.5)]);
    }
}
