//! What the cores of one robot's controller share. Each step is handed it, so that nothing hides in a core: what a core
//! will do follows from its own value, its input, the time, and this.

use crate::Rules;
use crate::gate::Gate;
use crate::joint_retreat::JointRetreat;
use crate::ledger::TransactionState;

/// What a step may read and write beside the core's own state.
#[derive(Debug)]
pub struct Shared<'a> {
    /// What the robot's settings mean for its board.
    pub rules: &'a Rules,
    /// The fencing token of its filter.
    pub gate: &'a Gate,
    /// Its transactions, safe pose and history.
    pub book: &'a mut TransactionState,
    /// The retreat that it may share with other robots.
    pub joint_retreat: &'a JointRetreat,
}
