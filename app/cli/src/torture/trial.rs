//! One run under planned faults, with all invariants checked while it runs.

use super::boards::{Boards, Driven};
use super::counted;
use super::faults::FaultAction;
use super::memory::Memory;
use super::plan::{Facts, Planned};
use super::sight::{self, ObjectChecker};
use super::witness::{Joint, Witness};
use miette::Report;
use mobee_compose::config::{ClockMode, Config, RobotConfig, Source};
use mobee_compose::{compose, derive_seed};
use mobee_contract::{Cause, Commit, Context, Entry, Event, Hold, Outcome, Sink, Status, SwapStep, Time};
use mobee_journal::check::Checker;
use mobee_journal::journal::{Fingerprint, JournalLine};
use mobee_journal::track::Tracks;
use mobee_model::{Edit, Object, ObjectClass, Primitive, Shape};
use mobee_runtime::system::{Control, Injection, RunCounts, RunEnd, RunProgress, Setup, run_under};
use mobee_runtime::tap::Taps;
use mobee_sim::{Fault, SimHardware};
use nalgebra::Isometry3;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::sync::mpsc;

/// Time for which a run may continue after the faults have healed, a little more than I15 allows.
const RECOVERY_TIME: Duration = Duration::from_secs(122);
/// Maximum growth of the process, megabytes per hour of the run.
const MAX_GROWTH_MB_PER_H: f64 = 1.0;
/// A board's fault that is shorter may remain undetected.
const MIN_FAULT_TIME: Duration = Duration::from_millis(60);
/// Cause of faulted motions whose outcome gives none.
const NO_CAUSE: &str = "no cause given";
/// Cause of faulted escapes: an escape has no retreat, and stops before it makes a contact worse.
pub(super) const ESCAPE: &str = "escape";
/// Cause of commits that the end of the run cut off.
pub(super) const END: &str = "end of run";
/// The object that floods of edits move, far from everything.
const FLOOD_OBJECT: &str = "torture";

/// A behavior under torture.
pub struct TortureTrial {
    config: Config,
    source: Source,
    driven: Vec<Driven>,
    /// The robots whose own driver is replaced by the simulated one, each with that driver's kind.
    pub replaced: Vec<(String, String)>,
    /// The inputs of plans.
    pub facts: Facts,
}

/// The result of a run.
#[derive(Clone, Debug)]
pub struct TrialResult {
    /// Violations: the name of the invariant (or `bug`) and a sentence.
    pub violations: Vec<(String, String)>,
    /// Duration by the run's clock.
    pub simulated: Duration,
    /// The counters.
    pub counts: RunCounts,
    /// Causes of faulted commits, with their numbers.
    pub faulted: BTreeMap<&'static str, u64>,
    /// Causes of closed filters, with their numbers.
    pub closed: BTreeMap<&'static str, u64>,
    /// Swaps that were settled, reverted, refused.
    pub swaps: [u64; 3],
    /// Retreats of several robots at once.
    pub joint: Joint,
    /// The hash of its journal.
    pub hash: String,
    /// Growth of the process, megabytes per hour of the run; `None` if it was too short.
    pub growth: Option<f64>,
}

/// Checks a run from inside.
struct Watch {
    checker: Checker,
    witness: Witness,
    objects: ObjectChecker,
    n: u64,
    hash: Fingerprint,
    /// Causes of faulted commits, with their numbers.
    faulted: BTreeMap<&'static str, u64>,
    /// Causes of closed filters, with their numbers.
    closed: BTreeMap<&'static str, u64>,
    /// Swaps that were settled, reverted, refused.
    swaps: [u64; 3],
    /// The boards with direct access, which have the motors' true positions.
    boards: Vec<Option<SimHardware>>,
    /// Robots whose open commit is an escape.
    escapes: BTreeMap<String, bool>,
    ending: bool,
    /// Unplanned deaths of actors.
    bugs: Vec<String>,
    /// Further sinks, if the run is stored.
    sinks: Vec<Box<dyn Sink>>,
}

impl Watch {
    /// Watches a run whose boards with direct access are these. `sinks` receive all entries as well.
    fn new(objects: ObjectChecker, boards: Vec<Option<SimHardware>>, sinks: Vec<Box<dyn Sink>>) -> Watch {
        Watch {
            checker: Checker::default(),
            witness: Witness::default(),
            objects,
            n: 0,
            hash: Fingerprint::default(),
            faulted: BTreeMap::new(),
            closed: BTreeMap::new(),
            swaps: [0; 3],
            boards,
            escapes: BTreeMap::new(),
            ending: false,
            bugs: Vec::new(),
            sinks,
        }
    }
}

impl Sink for Watch {
    fn write(&mut self, at: Time, entry: &Entry) -> Result<(), String> {
        match entry {
            Entry::Event(event) => {
                self.hash.add(at, event);
                self.witness.event(at, event);
                self.witness.found.extend(self.objects.event(at, event).map(|what| ("I33", what)));
                if let Event::Died { actor, reason } = &**event {
                    let planned = ["planted", "killed", "used up its restarts"].iter().any(|p| reason.contains(p));
                    if !planned {
                        self.bugs.push(format!("{actor} died at {at}: {reason}"));
                    }
                }
                match &**event {
                    Event::Commit { robot, escape, .. } => drop(self.escapes.insert(robot.clone(), *escape)),
                    Event::State { status: Status::Holding(Hold::ShuttingDown), .. } => self.ending = true,
                    Event::Outcome { robot, outcome: Outcome::Faulted, cause, .. } => {
                        let why = match self.escapes.get(robot) {
                            Some(true) => ESCAPE,
                            _ if self.ending && *cause == Some(Cause::Asked) => END,
                            _ => cause.as_ref().map_or(NO_CAUSE, Cause::word),
                        };
                        *self.faulted.entry(why).or_default() += 1;
                    }
                    _ => {}
                }
                if let Event::Disabled { cause, .. } = &**event {
                    *self.closed.entry(cause.word()).or_default() += 1;
                }
                if let Event::Swap { step, .. } = &**event {
                    let [settled, reverted, refused] = &mut self.swaps;
                    match step {
                        SwapStep::Settled => *settled += 1,
                        SwapStep::Reverted { .. } => *reverted += 1,
                        SwapStep::Refused { .. } => *refused += 1,
                        SwapStep::Offered { .. } | SwapStep::TookOver { .. } => {}
                    }
                }
                let event = (**event).clone();
                self.checker.on(&JournalLine { line: self.n + 1, n: self.n, at, event, hash: String::new() });
                self.n += 1;
            }
            Entry::Pose { robot, q, .. } => {
                self.checker.pose(*robot, at, q);
                if let Some(Some(board)) = self.boards.get(*robot) {
                    self.witness.truth(*robot, at, q, &board.positions(at));
                }
                self.witness.pose(*robot, at, q);
                let truth = |board: &Option<SimHardware>| board.as_ref().map(|board| board.positions(at));
                if let Some(truth) = self.boards.iter().map(truth).collect::<Option<Vec<_>>>() {
                    self.witness.true_positions(at, &truth);
                }
            }
            Entry::Picture { .. } => {}
            Entry::Scene(scene) => self.witness.scene(at, scene),
        }
        self.sinks.iter_mut().try_for_each(|sink| sink.write(at, entry))
    }

    fn flush(&mut self) -> Result<(), String> {
        self.sinks.iter_mut().try_for_each(|sink| sink.flush())
    }
}

impl TortureTrial {
    /// The maximum share of commits that may end as faulted, percent, if the behavior bounds it.
    pub fn most_faulted(&self) -> Option<f64> {
        self.config.torture.as_ref().map(|torture| torture.faulted_percent)
    }

    /// Loads a behavior. Its robots are simulated, its clock is virtual and its YARP ports stay closed, whatever its
    /// settings. A robot behind YARP retains its driver, which is connected to simulated boards by simulated wires.
    ///
    /// # Errors
    /// Complaints about the configuration.
    pub fn load(file: &Path, set: &[String], secs: f64, mild: bool) -> Result<TortureTrial, Report> {
        let (mut config, source) = Config::load(file, set)?;
        (config.clock, config.yarp, config.for_s) = (ClockMode::Virtual, None, None);
        config.bridge.clear();
        let replaced = Driven::replaced(&config);
        let driven = Driven::all(&mut config, &source)?;
        let wires = driven.iter().map(Driven::wires).collect();
        let composed = compose(config.clone(), &source)?;
        let scene = composed.scene;
        let sensors = composed.sensors.iter().map(sight::actors).collect();
        let limits = |r: &mobee_model::Robot| r.motors.iter().map(|m| (m.min, m.max)).collect();
        let robots = config.robot.iter().zip(scene.robots()).map(|(c, r)| (c.name.clone(), limits(r))).collect();
        Ok(TortureTrial { config, source, driven, replaced, facts: Facts { robots, wires, sensors, secs, mild } })
    }

    /// The sink that stores the measured poses of a run in this folder.
    ///
    /// # Errors
    /// If a file can't be written.
    pub fn tracks(&self, dir: &Path) -> Result<Box<dyn Sink>, Report> {
        let motors = self.facts.robots.iter().map(|(_, limits)| limits.len());
        let robots = self.config.robot.iter().zip(motors);
        let robots: Vec<_> =
            robots.map(|(r, n)| (r.name.clone(), n, r.controller.tolerance_deg.to_radians())).collect();
        Ok(Tracks::open(dir, &robots).map_err(Report::msg)?.sink())
    }

    /// Runs a seed under these faults. `sinks` receive all entries as well.
    ///
    /// # Errors
    /// If the system can't be built or started.
    pub fn run(&self, seed: u64, planned: &[Planned], sinks: Vec<Box<dyn Sink>>) -> Result<TrialResult, Report> {
        let config = Config { seed, ..self.config.clone() };
        let mut composed = compose(config.clone(), &self.source)?;
        let mut boards = Vec::new();
        for (i, robot) in composed.robots.iter_mut().enumerate() {
            let own = self.boards(i, seed, composed.scene.robots())?;
            planned.iter().for_each(|p| own.plan_fault(i, p));
            robot.hardware = own.hardware();
            robot.hardware.place(&composed.scene, i).map_err(|e| Report::msg(e.to_string()))?;
            boards.push(own);
            for p in planned {
                if let FaultAction::ShortHistory(poses) = p.what {
                    robot.controller.history = robot.controller.history.min(poses);
                }
            }
        }
        let objects = ObjectChecker::new(composed.truth.clone(), &composed.sensors, planned);
        let mut watch = Watch::new(objects, boards.iter().map(|b| b.simulated().cloned()).collect(), sinks);
        sight::install_faults(&mut composed.sensors, planned, seed);
        watch.witness.board_faults(board_faults(planned, &watch.boards));
        watch.witness.late_boards((0..boards.len()).map(|board| late(planned, board)).collect());
        let watch = Arc::new(Mutex::new(watch));
        let sample = || watch.lock().unwrap_or_else(PoisonError::into_inner);
        let taps = Taps::in_place(watch.clone());
        let setup = Setup {
            script: composed.script,
            sensors: composed.sensors,
            truth: Some(composed.truth),
            ..Setup::in_virtual_time(composed.scene, composed.robots, seed, taps.clone())
        };
        let bound = |robot: &RobotConfig| robot.controller.stall_deg.map(f64::to_radians);
        let bounds: Vec<Option<f64>> = self.config.robot.iter().map(bound).collect();
        let (stop, controls) = mpsc::channel(1);
        let mut memory = Memory::default();
        let enough = |p: &RunProgress| {
            memory.sample(p.at);
            let mut watch = sample();
            for (i, board) in boards.iter().enumerate() {
                watch.witness.speed(i, p.at, board.fastest(p.at));
                if let (Some(board), Some(bound)) = (board.simulated(), bounds.get(i).copied().flatten()) {
                    watch.witness.held(i, p.at, &board.held(p.at), bound);
                }
                watch.witness.found.extend(board.found().into_iter().map(|what| ("I30", what)));
            }
            let seen = !watch.witness.found.is_empty() || !watch.bugs.is_empty();
            let broken = watch.checker.violations().iter().any(|v| counted::counts(v, planned)) || seen;
            if broken || (p.at.secs() >= self.facts.secs && !watch.checker.waits()) {
                let _ = stop.try_send(Control::Stop);
            }
        };
        let healed = self.facts.healed();
        let limit = healed.since(Time::ZERO) + RECOVERY_TIME;
        let swaps = planned.iter().filter_map(|Planned { at, what }| match what {
            FaultAction::Swap(swap) => {
                let board = boards.get(swap.robot).and_then(|b| b.simulated());
                Some((*at, swap.control(&config, &self.source, setup.scene.robots(), board)?))
            }
            _ => None,
        });
        let mut faults = controls_of(planned, healed);
        faults.extend(swaps);
        faults.sort_by_key(|(at, _)| *at);
        let end = run_under(setup, faults, controls, Some(limit), enough).map_err(|e| Report::msg(e.to_string()))?;
        taps.finish(end.ended_at, Event::Ended { reason: end.reason.to_string() });
        Ok(result(&mut sample(), end, planned, memory.slope()))
    }

    fn boards(&self, i: usize, seed: u64, robots: &[Arc<mobee_model::Robot>]) -> Result<Boards, Report> {
        let (Some(config), Some(robot), Some(driven)) = (self.config.robot.get(i), robots.get(i), self.driven.get(i))
        else {
            return Err(Report::msg("there are fewer robots than configured"));
        };
        let context = Context { robot: robot.clone(), seed: derive_seed(seed, &format!("{}/driver", config.name)) };
        driven.boards(&context).map_err(|e| Report::msg(e.to_string()))
    }
}

/// Judges a trial that has ended. `growth`: slope of the process's memory, MB/h, if it was measured.
fn result(watch: &mut Watch, end: RunEnd, planned: &[Planned], growth: Option<f64>) -> TrialResult {
    let _ = watch.flush();
    let (_, violations) = std::mem::take(&mut watch.checker).end();
    let counted = violations.into_iter().filter(|v| counted::counts(v, planned));
    let mut violations: Vec<(String, String)> = counted.map(|v| (v.invariant.to_owned(), v.to_string())).collect();
    let seen = watch.witness.found.drain(..).map(|(i, what)| (i.to_owned(), format!("{i} broken: {what}")));
    violations.extend(seen);
    violations.extend(watch.bugs.drain(..).map(|b| ("bug".to_owned(), b)));
    if end.counts.is_given_up && !planned.iter().any(|p| p.what.kind() == "F5") {
        violations.push(("I15".into(), "a group used up its restarts without a storm".into()));
    }
    if let Some(slope) = growth.filter(|slope| *slope > MAX_GROWTH_MB_PER_H) {
        violations.push(("I7".into(), format!("I7 broken: memory grows by {slope:.2} MB per hour")));
    }
    TrialResult {
        violations,
        simulated: end.ended_at.since(Time::ZERO),
        counts: end.counts,
        faulted: std::mem::take(&mut watch.faulted),
        closed: std::mem::take(&mut watch.closed),
        swaps: watch.swaps,
        joint: watch.witness.joint.clone(),
        hash: watch.hash.hex(),
        growth,
    }
}

/// The intervals in which this board's latency exceeds its stated one.
fn late(planned: &[Planned], board: usize) -> Vec<(Time, Time)> {
    let of = |p: &Planned| match &p.what {
        FaultAction::Board { robot, fault: Fault::Slow { extra }, lasts, .. } if *robot == board => {
            Some((p.at, p.at + *lasts + *extra))
        }
        _ => None,
    };
    planned.iter().filter_map(of).collect()
}

/// The times at which each of these boards begins to report a fault.
fn board_faults(planned: &[Planned], boards: &[Option<SimHardware>]) -> Vec<Vec<Time>> {
    let of = |board: usize| {
        let begins = planned.iter().filter_map(move |p| match &p.what {
            FaultAction::Board { robot, fault: Fault::Hardware { .. }, lasts, .. } => {
                let is_own = *robot == board && boards.get(board).is_some_and(Option::is_some);
                (is_own && *lasts >= MIN_FAULT_TIME).then_some(p.at)
            }
            _ => None,
        });
        begins.collect()
    };
    (0..boards.len()).map(of).collect()
}

/// The controls of a plan with their times, without swaps; unordered.
fn controls_of(planned: &[Planned], healed: Time) -> Vec<(Time, Control)> {
    let mut all: Vec<(Time, Control)> = Vec::new();
    for Planned { at, what } in planned {
        match what.clone() {
            FaultAction::Strike { actor, after, blow } => {
                all.push((*at, Control::Inject(Injection::Strike { actor, after, blow })));
            }
            FaultAction::Kill(actor) => all.push((*at, Control::Kill(actor))),
            FaultAction::Storm { actor, kills } => {
                let gap = Duration::from_millis(300);
                all.extend((0..kills).map(|k| (*at + gap * k, Control::Kill(actor.clone()))));
            }
            FaultAction::Lose { link, count } => all.push((*at, Control::Inject(Injection::Lose { link, count }))),
            FaultAction::Commit { robot, target, times, .. } => {
                let commit = Commit { agent: "stranger".into(), target, speeds: None };
                all.push((*at, Control::Inject(Injection::Commit { robot, commit, times })));
            }
            FaultAction::Suspend(time) => all.push((*at, Control::Inject(Injection::Suspend(time)))),
            FaultAction::Edits(n) => {
                let far = |k: u64| Isometry3::translation(100.0, 0.001 * k as f64, 0.0);
                all.push((*at, Control::Edit(Edit::Add(ball(FLOOD_OBJECT, far(0))))));
                let moved = |k| Control::Edit(Edit::Move { name: FLOOD_OBJECT.into(), pose: far(k) });
                all.extend((0..n).map(|k| (*at, moved(k))));
            }
            FaultAction::Obstruct { object, robot, spot, lasts } => {
                let name = object.clone();
                all.push((*at, Control::Inject(Injection::Obstruct { object, robot, spot })));
                all.push((*at + lasts, Control::Edit(Edit::Remove { name: name.clone() })));
                // the first edit may have been lost with the model
                all.push((healed, Control::Edit(Edit::Remove { name })));
            }
            FaultAction::Blind { actor, blow: Some(blow) } => {
                all.push((*at, Control::Inject(Injection::Strike { actor, after: 0, blow })));
            }
            FaultAction::Blind { actor, blow: None } => all.push((*at, Control::Kill(actor))),
            FaultAction::Board { .. }
            | FaultAction::Wire { .. }
            | FaultAction::ShortHistory(_)
            | FaultAction::Swap(_)
            | FaultAction::Sight { .. } => {}
        }
    }
    all.push((healed, Control::Inject(Injection::Heal)));
    all
}

fn ball(name: &str, pose: Isometry3<f64>) -> Object {
    let shapes = vec![Primitive { shape: Shape::Sphere { radius: 0.05 }, pose: Isometry3::identity() }];
    Object { name: name.into(), class: ObjectClass::Obstacle, persistent: false, pose, shapes, color: None }
}
