//! The bus thread: it alone uses the port, and goes on whatever happens to drivers.
//!
//! ```text
//! every 10 ms: goals ──sync write──> servos      states <──sync read── servos
//! ```
//! A port that is gone is opened again, the servos are identified again, and get torque again where they are.

use crate::bus::{BusError, SerialLine, ServoBus, monotonic, open_port};
use crate::core::{ArmCore, ConnectionStage, SILENCE};
use crate::identity::StoredSettings;
use crate::joint::ServoJoint;
use crate::registers::{ACCELERATION, FASTEST_RAMP, GOAL, ServoState, TORQUE, sign_magnitude};
use crate::settings::{FeetechSettings, PERIOD};
use mobee_contract::{AnswerTime, Time};
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Time before the port is opened again.
const REOPEN: Duration = Duration::from_millis(200);
/// Time after a loss of torque or connection before the servos get torque again.
const REARM: Duration = Duration::from_secs(1);
/// Time between two requests while servos are silent.
const SILENT_PERIOD: Duration = Duration::from_millis(50);
/// Longest time in which the arm brakes at the end.
const MAX_ENDING: Duration = Duration::from_secs(2);
/// Cycles whose duration is stored.
const CYCLES: usize = 1000;
/// Of so many cycles...
const WATCHED_CYCLES: u32 = 100;
/// ... so many with bytes that belong to no answer are worth a warning.
const DISTURBED_CYCLES: u32 = 5;

/// Duration of the bus cycles: states read, goals written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BusCycles {
    /// Cycles so far.
    pub cycles: u64,
    /// Cycles without a complete reading.
    pub lost: u64,
    /// Half of the last thousand took no longer.
    pub median: Duration,
    /// Of 100 of the last thousand, 99 took no longer.
    pub p99: Duration,
    /// The longest of the last thousand.
    pub most: Duration,
}

/// The state that drivers and bus thread share, with its clock.
pub struct SharedArm {
    inner: Mutex<SharedState>,
    bell: Condvar,
    begun: Instant,
}

/// The shared state.
pub struct SharedState {
    /// The arm.
    pub core: ArmCore,
    /// True once a driver has connected: servos may be written.
    pub taken: bool,
    /// True once the arm has been driven.
    pub was_driven: bool,
    /// True if nothing may be written any more.
    pub let_go: bool,
    /// A finding that users should know.
    pub news: Option<String>,
    ended: bool,
    cycles: u64,
    lost: u64,
    took: VecDeque<Duration>,
}

impl SharedArm {
    /// An arm that has not been read yet.
    pub fn new(core: ArmCore) -> SharedArm {
        let inner = SharedState {
            core,
            taken: false,
            was_driven: false,
            let_go: false,
            news: None,
            ended: false,
            cycles: 0,
            lost: 0,
            took: VecDeque::with_capacity(CYCLES),
        };
        SharedArm { inner: Mutex::new(inner), bell: Condvar::new(), begun: monotonic() }
    }

    /// The shared state. It is held for computing only, never for I/O.
    pub fn lock(&self) -> MutexGuard<'_, SharedState> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The time by the arm's own clock.
    pub fn now(&self) -> Time {
        Time(u64::try_from(self.begun.elapsed().as_nanos()).unwrap_or(u64::MAX))
    }

    /// Waits until this holds, or the time is up; whether it holds.
    pub fn wait_for(&self, patience: Duration, mut holds: impl FnMut(&SharedState) -> bool) -> bool {
        let waiting = self.bell.wait_timeout_while(self.lock(), patience, |state| !holds(state));
        !waiting.unwrap_or_else(PoisonError::into_inner).1.timed_out()
    }

    /// Makes the thread brake the arm and end.
    pub fn end(&self) {
        self.lock().ended = true;
        self.bell.notify_all();
    }

    /// Duration of the cycles.
    pub fn cycles(&self) -> BusCycles {
        let state = self.lock();
        let mut took: Vec<Duration> = state.took.iter().copied().collect();
        took.sort();
        let at = |share: f64| took.get((share * took.len() as f64) as usize).or(took.last()).copied();
        BusCycles {
            cycles: state.cycles,
            lost: state.lost,
            median: at(0.5).unwrap_or_default(),
            p99: at(0.99).unwrap_or_default(),
            most: took.last().copied().unwrap_or_default(),
        }
    }
}

impl SharedState {
    /// Duration of the last hundred cycles.
    pub fn answer_time(&self) -> Option<AnswerTime> {
        let mut took: Vec<Duration> = self.took.iter().rev().take(100).copied().collect();
        took.sort();
        let (median, most) = (*took.get(took.len() / 2)?, *took.get(took.len() * 9 / 10)?);
        Some(AnswerTime { median, most, greatest: *took.last()? })
    }
}

/// The bus thread.
pub struct BusWorker {
    shared: Arc<SharedArm>,
    settings: FeetechSettings,
    joints: Vec<ServoJoint>,
    ids: Vec<u8>,
    bus: Option<ServoBus>,
    due: Instant,
    /// Time of each servo's last answer.
    answered: Vec<Instant>,
    /// Not before this do servos get torque again.
    rearm: Instant,
    /// Cycles watched, and those of them with bytes of no answer.
    disturbed: (u32, u32),
    warned: bool,
}

impl BusWorker {
    /// A thread's work at this port.
    pub fn new(shared: Arc<SharedArm>, settings: FeetechSettings) -> BusWorker {
        let joints = shared.lock().core.joints().to_vec();
        let now = monotonic();
        BusWorker {
            shared,
            settings,
            ids: joints.iter().map(|j| j.id).collect(),
            answered: vec![now; joints.len()],
            joints,
            bus: None,
            due: now,
            rearm: now,
            disturbed: (0, 0),
            warned: false,
        }
    }

    /// Works until the end.
    pub fn run(mut self) {
        let _guard = EndGuard(self.shared.clone());
        while self.wait() {
            self.cycle();
        }
        self.finish();
    }

    /// Waits until the next cycle is due; false at the end.
    fn wait(&mut self) -> bool {
        loop {
            let state = self.shared.lock();
            if state.ended {
                return false;
            }
            let left = self.due.saturating_duration_since(monotonic());
            if left.is_zero() {
                break;
            }
            // the bell rings for waiting drivers, too: look again
            drop(self.shared.bell.wait_timeout(state, left));
        }
        let now = monotonic();
        // periods that were missed are not made up for
        self.due = if now < self.due + PERIOD { self.due + PERIOD } else { now + PERIOD };
        true
    }

    fn cycle(&mut self) {
        let done = match self.bus.take() {
            None => self.open(),
            Some(mut bus) => self.exchange(&mut bus).map(|()| self.bus = Some(bus)).map_err(|e| {
                let mut state = self.shared.lock();
                state.core.look_again();
                let port = &self.settings.port;
                format!("{e}: plug the USB cable of {port} in again, then recover")
            }),
        };
        if let Err(what) = done {
            self.fail(what);
            self.due = monotonic() + REOPEN;
            self.rearm = monotonic() + REARM;
        }
        self.shared.bell.notify_all();
    }

    fn fail(&self, what: String) {
        let now = self.shared.now();
        self.shared.lock().core.set_fault(now, what);
    }

    /// Opens the port and identifies the servos.
    fn open(&mut self) -> Result<(), String> {
        let line: Box<dyn SerialLine> = open_port(&self.settings.port, self.settings.baud)?;
        let mut bus = ServoBus::new(line, self.settings.timeout());
        self.identify(&mut bus)?;
        self.answered.fill(monotonic());
        self.bus = Some(bus);
        Ok(())
    }

    fn identify(&self, bus: &mut ServoBus) -> Result<(), String> {
        let mut silent = Vec::new();
        for joint in &self.joints {
            match StoredSettings::read(bus, joint.id).map_err(|e| e.to_string())? {
                Some(stored) => stored.check(joint)?,
                None => silent.push(joint),
            }
        }
        if silent.is_empty() { Ok(()) } else { Err(self.silence(&silent, 0)) }
    }

    /// Names the silent servos, with a remedy.
    fn silence(&self, silent: &[&ServoJoint], disturbed: u32) -> String {
        let port = &self.settings.port;
        if disturbed > 0 {
            return format!(
                "the bus at {port} is disturbed: it carries bytes that belong to no answer; end any other program that uses the port, and \
                 check the cables, then recover"
            );
        }
        if silent.len() == self.joints.len() {
            return format!(
                "no servo answers at {port}: switch the arm's power supply on, and check the cable and `baud`; then recover"
            );
        }
        let names: Vec<String> = silent.iter().map(|j| format!("{} (id {})", j.name, j.id)).collect();
        let answering = self.joints.len() - silent.len();
        format!(
            "motor {} does not answer, {answering} others do: check its cable and its id, then recover",
            names.join(", ")
        )
    }

    /// One cycle.
    fn exchange(&mut self, bus: &mut ServoBus) -> Result<(), BusError> {
        let (begun, foreign) = (monotonic(), bus.foreign());
        // read before writing: goals of another program show, which the driver's own would replace
        let at = self.shared.now();
        let states = self.read(bus)?;
        self.watch(bus.foreign() > foreign);
        self.take(at, states);
        self.write(bus)?;
        self.note(begun.elapsed());
        self.arm(bus)
    }

    /// The states of the servos that answer.
    fn read(&mut self, bus: &mut ServoBus) -> Result<Vec<ServoState>, BusError> {
        let answers = bus.read_states(&self.ids)?;
        let now = monotonic();
        let mut states = Vec::with_capacity(self.ids.len());
        for (id, answered) in self.ids.iter().zip(&mut self.answered) {
            let answer = answers.iter().find(|a| a.id == *id);
            if let Some(state) = answer.and_then(|a| ServoState::decode(&a.data)) {
                *answered = now;
                states.push(state);
            }
        }
        Ok(states)
    }

    fn write(&self, bus: &mut ServoBus) -> Result<(), BusError> {
        let goals = {
            let mut state = self.shared.lock();
            let now = self.shared.now();
            let goals = state.core.tick(now);
            goals.filter(|_| !state.let_go)
        };
        let Some(goals) = goals else { return Ok(()) };
        let bytes = |goal: i32| sign_magnitude(goal, 15).to_le_bytes().to_vec();
        bus.sync_write(GOAL, goals.into_iter().map(|(id, goal)| (id, bytes(goal))).collect())
    }

    /// Stores the duration of a cycle.
    fn note(&self, took: Duration) {
        let mut state = self.shared.lock();
        state.cycles += 1;
        if state.took.len() == CYCLES {
            state.took.pop_front();
        }
        state.took.push_back(took);
    }

    fn take(&mut self, at: Time, states: Vec<ServoState>) {
        let now = monotonic();
        let late = |(joint, answered): (&ServoJoint, &Instant)| {
            (now.saturating_duration_since(*answered) > SILENCE).then(|| joint.clone())
        };
        let silent: Vec<ServoJoint> = self.joints.iter().zip(&self.answered).filter_map(late).collect();
        let is_whole = states.len() == self.joints.len();
        let mut state = self.shared.lock();
        if is_whole {
            let driven = state.core.stage() == ConnectionStage::Driving;
            state.core.take_states(at, states);
            if driven && state.core.stage() == ConnectionStage::Looking {
                self.rearm = now + REARM;
            }
        } else {
            state.lost += 1;
            state.core.lose_reading();
        }
        drop(state);
        if !silent.is_empty() {
            // answers that are very late have time to arrive
            self.due = now + SILENT_PERIOD;
            // where every servo falls silent while foreign bytes come, these are the cause
            let disturbed = if silent.len() == self.joints.len() { self.disturbed.1 } else { 0 };
            self.fail(self.silence(&silent.iter().collect::<Vec<_>>(), disturbed));
        }
    }

    /// Counts cycles with bytes that belong to no answer, and warns once.
    fn watch(&mut self, foreign: bool) {
        self.disturbed.0 += 1;
        self.disturbed.1 += u32::from(foreign);
        if self.disturbed.1 >= DISTURBED_CYCLES && !self.warned {
            self.warned = true;
            let text = "the servo bus carries bytes that belong to no answer: end any other program that uses the port, and check the cables";
            self.shared.lock().news = Some(text.into());
        }
        if self.disturbed.0 >= WATCHED_CYCLES {
            self.disturbed = (0, 0);
        }
    }

    /// Gives the servos torque where they are, once a driver has connected.
    fn arm(&mut self, bus: &mut ServoBus) -> Result<(), BusError> {
        let arming = {
            let state = self.shared.lock();
            let core = &state.core;
            let waits = !state.taken || state.let_go || monotonic() < self.rearm;
            let is_fresh = core.read_at().is_some_and(|at| self.shared.now().since(at) < SILENCE);
            if core.stage() == ConnectionStage::Driving || waits || !is_fresh {
                return Ok(());
            }
            // an overloaded servo recovers with a new goal; other faults must end first
            if core.states().iter().any(|s| s.status & !0x20 != 0) {
                return Ok(());
            }
            core.arming()
        };
        let arming = match arming {
            Ok(arming) => arming,
            Err(what) => {
                self.fail(what);
                return Ok(());
            }
        };
        let registers = |goal: i32| {
            let [low, high] = sign_magnitude(goal, 15).to_le_bytes();
            vec![FASTEST_RAMP, low, high, 0, 0, 0, 0]
        };
        bus.sync_write(ACCELERATION, arming.iter().map(|a| (a.id, registers(a.goal))).collect())?;
        let off: Vec<(u8, Vec<u8>)> = arming.iter().filter(|a| a.torque_off).map(|a| (a.id, vec![1])).collect();
        if !off.is_empty() {
            bus.sync_write(TORQUE, off)?;
        }
        // without torque by now, a servo is written again in the next cycle
        let states = self.read(bus)?;
        if states.len() < self.ids.len() || states.iter().any(|s| !s.torque) {
            return Ok(());
        }
        let mut state = self.shared.lock();
        let now = self.shared.now();
        state.core.armed(now, &arming);
        state.was_driven = true;
        Ok(())
    }

    /// Brakes the arm; releases its torque if the settings say so and it rests where it does not fall.
    fn finish(&mut self) {
        let Some(mut bus) = self.bus.take() else { return };
        let begun = monotonic();
        self.shared.lock().core.lease(self.shared.now(), Time::ZERO);
        while begun.elapsed() < MAX_ENDING {
            {
                let state = self.shared.lock();
                if state.let_go || state.core.stage() == ConnectionStage::Looking || state.core.is_at_rest() {
                    break;
                }
            }
            if self.exchange(&mut bus).is_err() {
                return;
            }
            let due = monotonic() + PERIOD;
            let state = self.shared.lock();
            drop(self.shared.bell.wait_timeout(state, due.saturating_duration_since(monotonic())));
        }
        let state = self.shared.lock();
        let core = &state.core;
        let releases = self.settings.release_torque && !state.let_go && core.stage() == ConnectionStage::Driving;
        let is_safe = releases && core.is_at_rest() && core.is_at(&self.settings.rest_deg);
        drop(state);
        if is_safe {
            let off = self.ids.iter().map(|id| (*id, vec![0])).collect();
            if let Err(e) = bus.sync_write(TORQUE, off) {
                tracing::warn!("the torque of the servos could not be released: {e}");
            }
        } else if releases {
            tracing::warn!("the arm is not at `rest_deg`: its servos hold it with torque");
        }
    }
}

/// Reports a thread that ends unasked.
struct EndGuard(Arc<SharedArm>);

impl Drop for EndGuard {
    fn drop(&mut self) {
        let now = self.0.now();
        let mut state = self.0.lock();
        if !state.ended {
            state.core.look_again();
            state.core.set_fault(now, "the bus thread has ended: the servos hold their last goals".into());
        }
        drop(state);
        self.0.bell.notify_all();
    }
}
