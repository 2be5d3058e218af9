//! A robot behind YARP without a network: the unmodified driver, in virtual time, against simulated boards
//! behind a wire that may be slow, lossy and corrupting.
//!
//! ```text
//! YarpDriver ── Reach ── hands, brakes, readers, lease watch ──> Client, Stops ──> Far: faults ──> SimBoard ──> plant
//!     └────────── commands received ───────> Judge <────────── commands sent, true motion of the motors ────┘
//! ```
//! All tasks run on the runtime of the first caller that connects. With equal seeds and faults two runs are
//! equal.

pub mod board;
mod client;
mod far;
mod faults;
mod judge;
mod watched;

pub use faults::{Who, WireFault};

use super::cell::describe;
use super::layout::{Layout, Patch};
use super::remote::{Remote, StopLine, Wire};
use super::settings::Moves;
use super::{Questions, YarpDriverSettings, YarpHardware};
use board::{SimBoard, SimClock};
use client::{SimClient, Stops};
use far::{Far, KeptConnection, lock};
use faults::Faults;
use judge::Judge;
use mobee_contract::{
    AnswerTime, AsFound, Board, Command, Context, ControlMode, Driver, DriverFault, Hardware, KindError, Known, Sample,
    Time,
};
use mobee_sim::{Fault, Garbage, Imitated, SimHardware, SimSettings};
use mobee_yarp::board::RemoteOptions;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use std::sync::{Arc, Mutex, OnceLock};
use std::time::Duration;

/// Period of the judge's checks.
const CHECK_PERIOD: Duration = Duration::from_millis(20);

/// A simulated robot behind a simulated wire, driven like one behind YARP.
pub struct YarpSim {
    hardware: YarpHardware,
    wire: Arc<SimWire>,
    board: Board,
}

/// The boards, and the simulated connections to them.
struct SimWire {
    parts: Vec<SimPart>,
    judge: Arc<Mutex<Judge>>,
    /// Set by the first connection, at which all clocks start.
    far: OnceLock<Vec<Arc<Far>>>,
}

struct SimPart {
    patch: Patch,
    hardware: SimHardware,
    faults: Arc<Mutex<Faults>>,
    /// Intervals in which its readings are corrupted.
    lies: Mutex<Vec<(Time, Time)>>,
}

impl YarpSim {
    /// Builds the robot that these settings of the kind `yarp` describe, at rest at home; equal seeds give
    /// equal boards and wires.
    ///
    /// # Errors
    /// The first setting that can't be used.
    pub fn new(settings: &YarpDriverSettings, context: &Context) -> Result<YarpSim, KindError> {
        // setpoint moves are for boards like iCub_SIM's
        let imitates = (settings.moves == Moves::SetPoints).then_some(Imitated::ICubSim);
        YarpSim::with_boards(settings, context, imitates)
    }

    /// Same as [`YarpSim::new`], with boards that behave like those of a real robot that was measured.
    ///
    /// # Errors
    /// The first setting that can't be used.
    pub fn with_boards(
        settings: &YarpDriverSettings,
        context: &Context,
        imitates: Option<Imitated>,
    ) -> Result<YarpSim, KindError> {
        // in virtual time nothing may wait for boards: a caller that comes too early retries
        let settings = YarpDriverSettings { connect_s: 0.0, ..settings.clone() };
        let layout = Layout::new(&settings, &context.robot)?;
        let sim = SimSettings {
            imitates,
            // boards are read almost when they publish, because reading on a common beat would hide
            // differences between them
            rate_hz: if imitates.is_some() { 500.0 } else { SimSettings::default().rate_hz },
            max_speed_deg_per_s: settings.max_speed_deg_per_s,
            max_acceleration_deg_per_s2: Some(settings.max_acceleration_deg_per_s2),
            ..SimSettings::ideal()
        };
        let axes = sim.axes(&context.robot);
        let start = sim.start(&context.robot)?;
        let part = |(seed, patch): (u64, &Patch)| {
            let seed = context.seed.wrapping_add(seed);
            let of = |all: &[f64]| all.get(patch.motors.clone()).unwrap_or_default().to_vec();
            let axes = axes.get(patch.motors.clone()).unwrap_or_default().to_vec();
            SimPart {
                patch: patch.clone(),
                hardware: SimHardware::with_axes(axes, &of(&start), &sim, seed),
                faults: Arc::new(Mutex::new(Faults::new(ChaCha8Rng::seed_from_u64(seed)))),
                lies: Mutex::default(),
            }
        };
        let parts: Vec<SimPart> = (0..).zip(&layout.patches).map(part).collect();
        let boards = layout.patches.iter().map(|p| (p.port.clone(), p.motors.clone()));
        let judge = Arc::new(Mutex::new(Judge::new(boards, layout.units(), layout.motors(), imitates.is_some())));
        let board = described(&layout, &parts, &settings)?;
        let wire = Arc::new(SimWire { parts, judge, far: OnceLock::new() });
        let hardware = YarpHardware::behind(wire.clone(), &settings, &context.robot)?;
        Ok(YarpSim { hardware, wire, board })
    }

    /// Number of boards in the settings.
    pub fn boards(&self) -> usize {
        self.wire.parts.len()
    }

    /// Plans a fault of the wire to a board, by the board's index in the settings.
    pub fn plan(&self, board: usize, fault: WireFault, from: Time, until: Time) {
        if let Some(part) = self.wire.parts.get(board) {
            lock(&part.faults).plan(fault, from, until);
        }
    }

    /// Plans a fault of simulated robots on all boards. Faults that falsify encoders are ignored.
    pub fn plan_hardware(&self, fault: &Fault, from: Time, until: Time) {
        for (board, part) in self.wire.parts.iter().enumerate() {
            let fault = match fault {
                Fault::Lost => {
                    self.plan(board, WireFault::Cut, from, until);
                    continue;
                }
                Fault::Silent => {
                    self.plan(board, WireFault::Silent, from, until);
                    continue;
                }
                // where a wire delays readings, a jumping encoder can't be distinguished from a motor that
                // moved
                Fault::Frozen { .. } | Fault::Offset { .. } | Fault::Noise { .. } => continue,
                // a state with too many or too few positions is not a valid state of a board
                Fault::Garbage(Garbage::Short | Garbage::Long) => Fault::Garbage(Garbage::NotANumber),
                Fault::Garbage(Garbage::NotANumber | Garbage::Infinite)
                | Fault::Slow { .. }
                | Fault::Repeated
                | Fault::Gappy { .. }
                | Fault::FrozenInMotion { .. }
                | Fault::Sag { .. }
                | Fault::Blocked { .. }
                | Fault::Hardware { .. } => fault.clone(),
            };
            lock(&part.lies).push((from, until));
            part.hardware.faults().plan(fault, from, until);
        }
    }

    /// True speeds of the motors that a stop could reach, rad/s.
    pub fn speeds(&self, now: Time) -> Vec<f64> {
        let judge = lock(&self.wire.judge);
        let of = |(board, part): (usize, &SimPart)| {
            let in_reach = judge.is_in_reach(board, now);
            part.hardware.speeds(now).into_iter().filter(move |_| in_reach).collect::<Vec<f64>>()
        };
        self.wire.parts.iter().enumerate().flat_map(of).collect()
    }

    /// Obligations towards the boards that the driver has violated, as sentences. Clears the list.
    pub fn found(&self) -> Vec<String> {
        std::mem::take(&mut lock(&self.wire.judge).found)
    }
}

impl Hardware for YarpSim {
    fn connect(&self) -> Result<Box<dyn Driver>, DriverFault> {
        if tokio::runtime::Handle::try_current().is_err() {
            return Ok(Box::new(Unreached(self.board.clone())));
        }
        self.wire.begin()?;
        Ok(Box::new(JudgedDriver { driver: self.hardware.connect()?, wire: self.wire.clone() }))
    }

    fn let_go(&self) {
        self.hardware.let_go();
    }

    fn known(&self) -> Known {
        self.hardware.known()
    }
}

/// Description of the robot as the driver will find it.
fn described(layout: &Layout, parts: &[SimPart], settings: &YarpDriverSettings) -> Result<Board, KindError> {
    let cell = super::cell::SharedBoards::new(layout);
    let mut inner = cell.lock();
    for (known, part) in inner.boards.iter_mut().zip(parts) {
        known.facts = Some(far::facts(&part.hardware, &part.patch.units));
    }
    let board = describe(layout, &inner.boards, settings).map_err(|why| KindError::new("parts", why, ""))?;
    board.ok_or_else(|| KindError::new("parts", "there is no board", "name at least one"))
}

impl SimWire {
    /// Starts all clocks, unless they run.
    fn begin(&self) -> Result<(), DriverFault> {
        if self.far.get().is_some() {
            return Ok(());
        }
        let clock = SimClock::start(1.0, 1.79e9);
        let far = |(index, part): (usize, &SimPart)| {
            Ok(Arc::new(Far {
                index,
                port: part.patch.port.clone(),
                board: SimBoard::new(&part.patch.part, part.hardware.clone(), clock)?.counting(&part.patch.units),
                hardware: part.hardware.clone(),
                units: part.patch.units.clone(),
                clock,
                faults: part.faults.clone(),
                judge: self.judge.clone(),
            }))
        };
        let all: Vec<Arc<Far>> = self.parts.iter().enumerate().map(far).collect::<Result<_, DriverFault>>()?;
        let seen = all.clone();
        if self.far.set(all).is_ok() {
            tokio::spawn(watch(self.judge.clone(), seen));
        }
        Ok(())
    }

    fn far(&self, patch: &Patch) -> Option<Arc<Far>> {
        self.far.get()?.iter().find(|far| far.port == patch.port).cloned()
    }
}

/// Checks all boards periodically, without end.
async fn watch(judge: Arc<Mutex<Judge>>, all: Vec<Arc<Far>>) {
    let mut looks = tokio::time::interval(CHECK_PERIOD);
    looks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    loop {
        looks.tick().await;
        if let Some(far) = all.first() {
            lock(&judge).look(far.now());
        }
        all.iter().for_each(|far| far.look());
    }
}

impl Wire for SimWire {
    fn board(&self, patch: &Patch, options: RemoteOptions) -> Option<Arc<dyn Remote>> {
        Some(Arc::new(SimClient::new(self.far(patch)?, options.timeout)))
    }

    fn stop_line(&self, patch: &Patch, _own: &str, patience: Duration) -> Option<Box<dyn StopLine>> {
        Some(Box::new(Stops { far: self.far(patch)?, connection: KeptConnection::new(), patience }))
    }

    fn questions(&self, _patch: &Patch, _local: &str, _timeout: Duration) -> Option<Questions> {
        None
    }
}

/// The driver, observed by the judge.
struct JudgedDriver {
    driver: Box<dyn Driver>,
    wire: Arc<SimWire>,
}

impl SimWire {
    fn lies(&self, board: usize, now: Time) -> bool {
        let lingers = Duration::from_secs(4);
        let on = |(from, until): &(Time, Time)| *from <= now && now <= *until + lingers;
        let part = self.parts.get(board);
        let states = |f: &WireFault| matches!(f, WireFault::Stamps(_) | WireFault::Late(_));
        let since = Time(now.0.saturating_sub(6_000_000_000));
        part.is_some_and(|p| lock(&p.lies).iter().any(on) || lock(&p.faults).any_since(since, now, states))
    }
}

impl Driver for JudgedDriver {
    fn board(&self) -> &Board {
        self.driver.board()
    }

    fn command(&mut self, now: Time, command: &Command) -> Result<(), DriverFault> {
        self.driver.command(now, command)?;
        lock(&self.wire.judge).commanded(now, command);
        Ok(())
    }

    fn sample(&mut self, now: Time) -> Result<Option<Sample>, DriverFault> {
        let sample = self.driver.sample(now)?;
        if let Some(sample) = &sample {
            let answers = self.driver.answer_time();
            lock(&self.wire.judge).read(now, sample, answers, |board| self.wire.lies(board, now));
        }
        Ok(sample)
    }

    fn next_sample(&self, now: Time) -> Time {
        self.driver.next_sample(now)
    }

    fn lease(&mut self, now: Time, until: Time) {
        self.driver.lease(now, until);
        lock(&self.wire.judge).leased(now, until);
    }

    fn answer_time(&self) -> Option<AnswerTime> {
        self.driver.answer_time()
    }

    fn leads(&self) -> bool {
        self.driver.leads()
    }

    fn news(&mut self) -> Option<String> {
        self.driver.news()
    }

    fn found(&self) -> Vec<AsFound> {
        self.driver.found()
    }

    fn modes(&self) -> Vec<ControlMode> {
        self.driver.modes()
    }
}

/// A robot before any clock runs: its description is available, but it can't be used.
struct Unreached(Board);

impl Driver for Unreached {
    fn board(&self) -> &Board {
        &self.0
    }
    fn command(&mut self, _now: Time, _command: &Command) -> Result<(), DriverFault> {
        Err(DriverFault::Lost)
    }
    fn sample(&mut self, _now: Time) -> Result<Option<Sample>, DriverFault> {
        Err(DriverFault::Lost)
    }
    fn next_sample(&self, now: Time) -> Time {
        now + self.0.period
    }
    fn lease(&mut self, _now: Time, _until: Time) {}
    fn modes(&self) -> Vec<ControlMode> {
        Vec::new()
    }
}
