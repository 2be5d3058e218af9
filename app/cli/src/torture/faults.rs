//! The list of faults, and the subset that a simulation can inject.

use super::sight::SensorFault;
use super::swaps::Swap;
use mobee_contract::{SwapPart, Target};
use mobee_driver_yarp::WireFault;
use mobee_runtime::system::{Blow, Spot};
use mobee_sim::Fault;
use std::fmt;
use std::time::Duration;

/// A line of the fault list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultKind {
    /// `F1`, `F2`, ...
    pub name: &'static str,
    /// Description.
    pub what: &'static str,
    /// The reason why a simulation can't inject it; `None` if it can.
    pub elsewhere: Option<&'static str>,
}

const PROCESS: Option<&str> = Some("needs a process of its own: see the tests of the program");
const YARP: Option<&str> =
    Some("needs YARP's ports: see tests/it/real_time/yarp_cycles.rs and drivers/tests/it/real_time/yarp_faults.rs");
const FUZZ: Option<&str> = Some("is about files and bytes: see tests/it/wrong_input.rs and drivers/yarp/fuzz");

/// Faults of wires, only for robots whose driver is `yarp`.
pub const WIRES: &str = "F30";

const fn kind(name: &'static str, what: &'static str, elsewhere: Option<&'static str>) -> FaultKind {
    FaultKind { name, what, elsewhere }
}

/// The whole list.
pub const KINDS: &[FaultKind] = &[
    kind("F1", "a panic in an actor, at any message", None),
    kind("F2", "an actor is killed", None),
    kind("F3", "an actor's handler stalls", None),
    kind("F4", "slow flapping below the restart limit", Some("shows in hours only: run `--faults mild` for long")),
    kind("F5", "a restart storm", None),
    kind("F6", "pulses or readings are lost on one link", None),
    kind("F7", "commands are delayed, readings are given twice", None),
    kind("F8", "readings and commits that make no sense", None),
    kind("F9", "malformed bottles", YARP),
    kind("F10", "malformed files", FUZZ),
    kind("F11", "the board disconnects, falls silent or reports a fault", None),
    kind("F12", "encoders lie: frozen, stuck, off, noisy", None),
    kind("F13", "the name server restarts, a port steals our name", YARP),
    kind("F14", "the process is suspended", None),
    kind("F15", "the disk is full, read-only or slow", PROCESS),
    kind("F16", "the process is killed", PROCESS),
    kind("F17", "a frozen viewer", PROCESS),
    kind("F18", "floods of commits and of edits of the world", None),
    kind("F19", "objects appear on the robot, its path, its safe pose, and go again", None),
    kind("F20", "another agent or robot moves into the way", None),
    kind("F21", "an agent is swapped at any moment, by a sound one or not", None),
    kind("F22", "a controller or a driver is swapped at any moment, by a sound one or not", None),
    kind("F23", "a motion outlasts the history", None),
    kind(
        "F24",
        "a detector sees nothing, everything twice or garbage, a locator is far off; a sensor's actor fails",
        None,
    ),
    kind("F25", "a worse value is edited into the configuration", FUZZ),
    kind("F26", "memory, file descriptors or ports run out", PROCESS),
    kind("F27", "signals", PROCESS),
    kind("F28", "a machine under load", PROCESS),
    kind("F29", "all encoders freeze in mid-motion", None),
    kind(WIRES, "the wire to a board behind YARP is slow, lossy or lying; a task of its driver dies", None),
    kind("F31", "a motor gives way while the robot rests", None),
    kind("F32", "something that no model knows holds a motor in mid-motion", None),
];

/// Swaps are injected on request only, so that the plan of a seed stays the same.
const SWAPS: [&str; 2] = ["F21", "F22"];
/// Later kinds, which are injected by name only, for the same reason.
const LATER: [&str; 4] = ["F24", "F29", "F31", "F32"];

/// A fault of a plan.
#[derive(Clone, Debug, PartialEq)]
pub enum FaultAction {
    /// F1 and F3.
    Strike {
        /// The actor.
        actor: String,
        /// Number of messages before the fault.
        after: u64,
        /// The fault of the actor.
        blow: Blow,
    },
    /// F2.
    Kill(String),
    /// F5: repeated kills, 0.3 s apart.
    Storm {
        /// The actor.
        actor: String,
        /// Number of kills.
        kills: u32,
    },
    /// F6 between actors.
    Lose {
        /// The link.
        link: String,
        /// Number of lost pulses.
        count: u64,
    },
    /// F6, F7, F8, F11, F12, F29, F31, F32: the board of a robot.
    Board {
        /// The kind it belongs to.
        kind: &'static str,
        /// The robot.
        robot: usize,
        /// The fault of the board.
        fault: Fault,
        /// Duration.
        lasts: Duration,
    },
    /// F30: the wire to a board behind YARP.
    Wire {
        /// The robot.
        robot: usize,
        /// The board, by its number in the driver's settings.
        board: usize,
        /// The fault of the wire.
        fault: WireFault,
        /// Duration.
        lasts: Duration,
    },
    /// F8, F18, F20: another client commits.
    Commit {
        /// The kind it belongs to.
        kind: &'static str,
        /// The robot's name.
        robot: String,
        /// The target.
        target: Target,
        /// Number of simultaneous commits.
        times: u64,
    },
    /// F14.
    Suspend(Duration),
    /// F18: this number of simultaneous moves of a distant object.
    Edits(u64),
    /// F19.
    Obstruct {
        /// The obstacle's name.
        object: String,
        /// The robot's name.
        robot: String,
        /// The place on the robot or its path.
        spot: Spot,
        /// Duration.
        lasts: Duration,
    },
    /// F21, F22: a part is swapped.
    Swap(Swap),
    /// F23: the history has only this number of poses from the start.
    ShortHistory(usize),
    /// F24: a sensor is wrong.
    Sight {
        /// The sensor, by its number.
        sensor: usize,
        /// The fault of the sensor.
        fault: SensorFault,
        /// Duration.
        lasts: Duration,
    },
    /// F24: an actor of a sensor fails at its next message, or is killed.
    Blind {
        /// The actor.
        actor: String,
        /// The fault of the actor; `None`: it is killed.
        blow: Option<Blow>,
    },
}

impl FaultAction {
    /// The name of its fault kind.
    pub fn kind(&self) -> &'static str {
        match self {
            FaultAction::Strike { blow: Blow::Panic, .. } => "F1",
            FaultAction::Strike { .. } => "F3",
            FaultAction::Kill(_) => "F2",
            FaultAction::Storm { .. } => "F5",
            FaultAction::Lose { .. } => "F6",
            FaultAction::Board { kind, .. } | FaultAction::Commit { kind, .. } => kind,
            FaultAction::Wire { .. } => WIRES,
            FaultAction::Suspend(_) => "F14",
            FaultAction::Edits(_) => "F18",
            FaultAction::Obstruct { .. } => "F19",
            FaultAction::Swap(Swap { part: SwapPart::Agent, .. }) => "F21",
            FaultAction::Swap(_) => "F22",
            FaultAction::ShortHistory(_) => "F23",
            FaultAction::Sight { .. } | FaultAction::Blind { .. } => "F24",
        }
    }
}

impl fmt::Display for FaultAction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: ", self.kind())?;
        match self {
            FaultAction::Strike { actor, after, blow } => write!(f, "{blow} in {actor} after {after} messages"),
            FaultAction::Kill(actor) => write!(f, "{actor} is killed"),
            FaultAction::Storm { actor, kills } => write!(f, "{actor} is killed {kills} times"),
            FaultAction::Lose { link, count } => write!(f, "{count} pulses are lost on {link}"),
            FaultAction::Board { robot, fault, lasts, .. } => {
                write!(f, "the board of robot {robot} for {:.3} s: {fault:?}", lasts.as_secs_f64())
            }
            FaultAction::Wire { robot, board, fault, lasts } => {
                write!(f, "board {board} of robot {robot} for {:.3} s: {fault}", lasts.as_secs_f64())
            }
            FaultAction::Commit { robot, target, times, .. } => write!(f, "{times} commits to {robot}: {target:?}"),
            FaultAction::Suspend(time) => write!(f, "suspended for {:.3} s", time.as_secs_f64()),
            FaultAction::Edits(n) => write!(f, "{n} edits of the world at once"),
            FaultAction::Obstruct { object, robot, spot, lasts } => {
                write!(f, "{object} is on the way of {robot} for {:.3} s: {spot:?}", lasts.as_secs_f64())
            }
            FaultAction::Swap(swap) => write!(f, "{swap}"),
            FaultAction::ShortHistory(poses) => write!(f, "a history of {poses} poses"),
            FaultAction::Sight { sensor, fault, lasts } => {
                write!(f, "sensor {sensor} for {:.3} s: {fault}", lasts.as_secs_f64())
            }
            FaultAction::Blind { actor, blow: Some(blow) } => write!(f, "{blow} in {actor}"),
            FaultAction::Blind { actor, blow: None } => write!(f, "{actor} is killed"),
        }
    }
}

/// The kinds in a list such as `F1,F8`. `mild`: those that a robot meets any day. `usual` (and an empty list): all that
/// can be simulated except swaps, F24, F29, F31 and F32. `all`: these and the swaps.
///
/// # Errors
/// A sentence for the first name that is unknown or can't be simulated.
pub fn chosen(names: &str) -> Result<Vec<&'static str>, String> {
    let named: Vec<Vec<&'static str>> = names.split(',').map(|name| kinds(name.trim())).collect::<Result<_, _>>()?;
    Ok(named.concat())
}

/// The kinds for one word of a list.
fn kinds(name: &str) -> Result<Vec<&'static str>, String> {
    let mild = ["F1", "F2", "F6", "F7", "F11", "F19", "F20", WIRES];
    let all = KINDS.iter().filter(|k| k.elsewhere.is_none()).map(|k| k.name).filter(|n| !LATER.contains(n));
    match name {
        "" | "usual" => return Ok(all.filter(|n| !SWAPS.contains(n)).collect()),
        "all" => return Ok(all.collect()),
        "none" => return Ok(Vec::new()),
        "mild" => return Ok(all.filter(|n| mild.contains(n)).collect()),
        _ => {}
    }
    let kind = KINDS.iter().find(|k| k.name.eq_ignore_ascii_case(name));
    match kind {
        None => Err(format!(
            "there is no fault `{name}`; they are F1 to F{}, `usual`, `mild`, `all` and `none`",
            KINDS.len()
        )),
        Some(FaultKind { name, what, elsewhere: Some(why) }) => Err(format!("{name} ({what}) {why}")),
        Some(kind) => Ok(vec![kind.name]),
    }
}
