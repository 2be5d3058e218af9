//! Faults of the simulated hardware, injected by tests and whole-system simulation.

use super::shared::{SharedPlant, lock};
use mobee_contract::Time;
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// A fault of the hardware.
#[derive(Clone, Debug, PartialEq)]
pub enum Fault {
    /// Readings continue, but the encoder of one motor (or all) is stuck at its value when the fault began.
    Frozen {
        /// The motor; `None` for all.
        motor: Option<usize>,
    },
    /// Readings continue, but once the motors have moved for a while all encoders are stuck.
    FrozenInMotion {
        /// Duration of uninterrupted motion after which they are stuck.
        after: Duration,
    },
    /// Commands, leases and readings don't get through.
    Lost,
    /// Readings stop; commands and leases get through.
    Silent,
    /// Commands take effect later.
    Slow {
        /// Additional latency.
        extra: Duration,
    },
    /// The encoder of one motor has an offset.
    Offset {
        /// The motor.
        motor: usize,
        /// Offset, rad.
        by: f64,
    },
    /// One motor gives way while the robot rests: to its weight, to a person, or to another program.
    Sag {
        /// The motor.
        motor: usize,
        /// Speed, rad/s.
        speed: f64,
    },
    /// An unmodelled obstacle blocks one motor: once it has moved for a while, it goes no farther in that
    /// direction, whatever its board commands.
    Blocked {
        /// The motor.
        motor: usize,
        /// Duration of uninterrupted motion after which it is blocked.
        after: Duration,
    },
    /// A burst of noise on all encoders.
    Noise {
        /// Standard deviation, rad.
        sigma: f64,
    },
    /// Only each `of`-th reading gets through (0 and 1: all of them).
    Gappy {
        /// Number of readings of which one gets through.
        of: u64,
    },
    /// Each reading is returned twice.
    Repeated,
    /// Readings are corrupted in transit.
    Garbage(Garbage),
    /// The board reports a fault, brakes, and accepts no command.
    Hardware {
        /// Text of the report.
        report: String,
    },
}

/// Corruption of a reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Garbage {
    /// A position is NaN.
    NotANumber,
    /// A position is infinite.
    Infinite,
    /// A position is missing.
    Short,
    /// There is one position too many.
    Long,
}

/// Identifier of a fault that was started.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct FaultId(u64);

#[derive(Debug)]
pub struct Active {
    id: FaultId,
    pub fault: Fault,
    from: Time,
    until: Time,
    /// Values at which frozen encoders are stuck.
    pub held: Option<Arc<[f64]>>,
    /// Time since which the motors have moved, for faults that begin in motion.
    pub moving: Option<Time>,
}

impl Active {
    pub fn is_on(&self, now: Time) -> bool {
        self.from <= now && now < self.until
    }

    /// True if it lasts until it is stopped.
    pub fn is_open(&self) -> bool {
        self.until == Time(u64::MAX)
    }

    /// True if it prevents readings from being fetched.
    pub fn withholds(&self) -> bool {
        matches!(self.fault, Fault::Lost | Fault::Silent | Fault::Hardware { .. })
    }
}

/// Handle that starts and stops faults of a simulated robot while it runs. Cheap to clone.
#[derive(Clone, Debug)]
pub struct SimFaults {
    pub(crate) board: Arc<Mutex<SharedPlant>>,
}

impl SimFaults {
    /// Starts a fault that lasts until [`SimFaults::stop`].
    pub fn start(&self, fault: Fault) -> FaultId {
        self.plan(fault, Time::ZERO, Time(u64::MAX))
    }

    /// Plans a fault for an interval.
    pub fn plan(&self, fault: Fault, from: Time, until: Time) -> FaultId {
        let mut board = lock(&self.board);
        board.faults_made += 1;
        let id = FaultId(board.faults_made);
        board.faults.push(Active { id, fault, from, until, held: None, moving: None });
        id
    }

    /// Ends a fault. No-op if it has already ended.
    pub fn stop(&self, id: FaultId) {
        lock(&self.board).faults.retain(|f| f.id != id);
    }

    /// Ends all faults.
    pub fn clear(&self) {
        lock(&self.board).faults.clear();
    }
}
