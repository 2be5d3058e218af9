//! Faults of the simulated hardware, injected by tests and whole-system simulation.

use super::shared::{SharedPlant, lock};
use mobee_contract::Time;
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// What can go wrong with hardware.
#[derive(Clone, Debug, PartialEq)]
pub enum Fault {
    /// Readings go on, and one motor's encoder (or all) says what it said when the fault began.
    Frozen {
        /// The motor; `None` for all.
        motor: Option<usize>,
    },
    /// Readings go on, and once the motors have moved for a while all encoders keep saying what they said then.
    FrozenInMotion {
        /// For how long they must have moved without a rest.
        after: Duration,
    },
    /// Commands, leases and readings don't get through.
    Lost,
    /// Readings stop; commands and leases get through.
    Silent,
    /// Commands take longer to take effect.
    Slow {
        /// By how much.
        extra: Duration,
    },
    /// One motor's encoder is off.
    Offset {
        /// The motor.
        motor: usize,
        /// By how much, rad.
        by: f64,
    },
    /// One motor gives way while the robot rests: to its weight, to a hand, to another program.
    Sag {
        /// The motor.
        motor: usize,
        /// How fast, rad/s.
        speed: f64,
    },
    /// Something that no model knows holds one motor: where it is once it has moved for a while it goes no farther in that direction,
    /// whatever its board wants.
    Blocked {
        /// The motor.
        motor: usize,
        /// For how long it must have moved without a rest.
        after: Duration,
    },
    /// A burst of noise on all encoders.
    Noise {
        /// Standard deviation, rad.
        sigma: f64,
    },
    /// Only each so-manyth reading gets through (0 and 1: all of them).
    Gappy {
        /// Of how many one does.
        of: u64,
    },
    /// Each reading is given a second time.
    Repeated,
    /// Readings are damaged on their way.
    Garbage(Garbage),
    /// The board reports a fault, brakes, and takes no command.
    Hardware {
        /// What it reports.
        report: String,
    },
}

/// How a reading is damaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Garbage {
    /// A position is not a number.
    NotANumber,
    /// A position is infinite.
    Infinite,
    /// A position is missing.
    Short,
    /// There is one too many.
    Long,
}

/// Names a fault that was started.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct FaultId(u64);

#[derive(Debug)]
pub struct Active {
    id: FaultId,
    pub fault: Fault,
    from: Time,
    until: Time,
    /// What frozen encoders keep saying.
    pub held: Option<Arc<[f64]>>,
    /// Since when the motors have moved, for those that freeze, and are held, in motion.
    pub moving: Option<Time>,
}

impl Active {
    pub fn is_on(&self, now: Time) -> bool {
        self.from <= now && now < self.until
    }

    /// Whether it lasts until somebody stops it.
    pub fn is_open(&self) -> bool {
        self.until == Time(u64::MAX)
    }

    /// Whether it keeps readings from being fetched.
    pub fn withholds(&self) -> bool {
        matches!(self.fault, Fault::Lost | Fault::Silent | Fault::Hardware { .. })
    }
}

/// A handle that gives a simulated robot faults and takes them away, while it runs. Cheap to clone.
#[derive(Clone, Debug)]
pub struct SimFaults {
    pub(crate) board: Arc<Mutex<SharedPlant>>,
}

impl SimFaults {
    /// Starts a fault that lasts until [`SimFaults::stop`].
    pub fn start(&self, fault: Fault) -> FaultId {
        self.plan(fault, Time::ZERO, Time(u64::MAX))
    }

    /// Plans a fault for a span of time, known beforehand.
    pub fn plan(&self, fault: Fault, from: Time, until: Time) -> FaultId {
        let mut board = lock(&self.board);
        board.faults_made += 1;
        let id = FaultId(board.faults_made);
        board.faults.push(Active { id, fault, from, until, held: None, moving: None });
        id
    }

    /// Ends a fault; one that has ended already is none of its business.
    pub fn stop(&self, id: FaultId) {
        lock(&self.board).faults.retain(|f| f.id != id);
    }

    /// Ends all faults.
    pub fn clear(&self) {
        lock(&self.board).faults.clear();
    }
}
