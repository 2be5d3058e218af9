//! Constraints are tested before anything is placed: this is cheap, and leaves the lanes to other poses.

use crate::kernel::Block;
use crate::lanes::{LaneMask, WIDTH, WideRow};
use crate::program::{FlatClause, Program};

/// The lanes that certainly violate a constraint, and those in which rounding could decide about one.
#[inline(always)]
pub(crate) fn violated(program: &Program, block: &Block) -> (LaneMask, LaneMask) {
    let mut violated = 0;
    let mut doubtful = 0;
    for clause in program.clauses.iter() {
        let value = clause_value(clause, &block.motors);
        for (i, value) in value.0.iter().enumerate() {
            violated |= LaneMask::from(*value < -clause.doubt) << i;
            doubtful |= LaneMask::from(value.abs() <= clause.doubt) << i;
        }
    }
    (violated, doubtful)
}

#[inline(always)]
fn clause_value(clause: &FlatClause, motors: &[WideRow]) -> WideRow {
    let mut greatest = WideRow([f64::NEG_INFINITY; WIDTH]);
    for (terms, constant) in &clause.members {
        let mut sum = [*constant; WIDTH];
        for (motor, factor) in terms {
            for (sum, q) in sum.iter_mut().zip(&motors[*motor].0) {
                *sum += factor * q;
            }
        }
        for (greatest, sum) in greatest.0.iter_mut().zip(sum) {
            *greatest = if sum > *greatest { sum } else { *greatest };
        }
    }
    greatest
}
