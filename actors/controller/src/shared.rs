//! Values shared by the cores of one robot's controller. Every step receives them, so that a core has no hidden inputs:
//! its output follows from its own value, its input, the time, and these.

use crate::Rules;
use crate::gate::Gate;
use crate::joint_retreat::JointRetreat;
use crate::ledger::TransactionState;

/// Values that a step may read and write in addition to the core's own state.
#[derive(Debug)]
pub struct Shared<'a> {
    /// Controller parameters: the settings applied to this board.
    pub rules: &'a Rules,
    /// Fencing token of the robot's filter.
    pub gate: &'a Gate,
    /// Transactions, safe pose and history.
    pub book: &'a mut TransactionState,
    /// Retreat that the robot may share with other robots.
    pub joint_retreat: &'a JointRetreat,
}
