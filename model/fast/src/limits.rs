//! Limits and constraints: linear, so on a line they are solved for.

use crate::fast::FastScene;
use crate::program::{FlatClause, Program};
use mobee_model::Scene;

/// How far beyond a limit, rad of encoder, counts as at it: rounding of units.
const AT_LIMIT: f64 = 1e-9;

/// Writes the limits and constraints of all robots of a scene.
pub(crate) fn constraints(program: &mut Program, scene: &Scene) {
    for robot in scene.robots() {
        let first = program.limits.len();
        program.limits.extend(robot.motors.iter().map(|m| (m.min, m.max)));
        for clause in robot.parts.iter().flat_map(|part| &part.clauses) {
            let degrees = 1f64.to_degrees();
            let flat =
                |h: &mobee_model::HalfSpace| (h.terms.iter().map(|(m, a)| (first + m, a * degrees)).collect(), h.b);
            let members: Vec<(Vec<(usize, f64)>, f64)> = clause.0.iter().map(flat).collect();
            let size = |(terms, b): &(Vec<(usize, f64)>, f64)| {
                let most = |m: usize| program.limits.get(m).map_or(0.0, |(low, high)| low.abs().max(high.abs()));
                terms.iter().map(|(m, a)| a.abs() * most(*m)).sum::<f64>() + b.abs()
            };
            let doubt = 1e-12 * members.iter().map(size).fold(1.0, f64::max);
            program.clauses.push(FlatClause { members, doubt });
        }
    }
}

/// Whether a motor is within its limits, rad of encoder.
pub(crate) fn is_within(q: f64, (low, high): (f64, f64)) -> bool {
    q >= low - AT_LIMIT && q <= high + AT_LIMIT
}

/// A motor's position, or the nearer limit if it is beyond.
#[inline]
pub(crate) fn within_limits(q: f64, (low, high): (f64, f64)) -> f64 {
    let q = if q > low { q } else { low };
    if q < high { q } else { high }
}

impl FastScene {
    /// Where a line first is beyond a limit of these motors.
    pub(crate) fn first_beyond_limits(&self, from: &[f64], to: &[f64], moving: &[usize]) -> Option<(f64, bool)> {
        let mut first: Option<f64> = None;
        for (a, b, (low, high)) in moving.iter().map(|m| (&from[*m], &to[*m], self.program.limits[*m])) {
            let inside = |q: &f64| is_within(*q, (low, high));
            let at = match (inside(a), inside(b)) {
                (true, true) => continue,
                (false, _) => 0.0,
                // Not before the place where it is beyond: rounding may not turn it back.
                (true, false) => {
                    let limit = if *b > high { high + AT_LIMIT } else { low - AT_LIMIT };
                    (((limit - a) / (b - a)) + 1e-12).clamp(0.0, 1.0)
                }
            };
            let at = if at.is_nan() { 0.0 } else { at };
            first = Some(first.map_or(at, |f| f.min(at)));
        }
        first.map(|at| (at, true))
    }

    /// Where a line first violates a constraint, and whether it surely does there. Half-spaces are linear, so each
    /// clause is violated on one interval.
    pub(crate) fn first_violation(&self, from: &[f64], to: &[f64]) -> Option<(f64, bool)> {
        let mut first: Option<(f64, bool)> = None;
        for clause in &self.program.clauses {
            let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
            for (terms, constant) in &clause.members {
                let value = |q: &[f64]| terms.iter().map(|(m, a)| a * q[*m]).sum::<f64>() + constant - clause.doubt;
                let (v0, v1) = (value(from), value(to));
                match (v0 > 0.0, v1 > 0.0) {
                    (true, true) => leave = -1.0,
                    (true, false) => enter = enter.max(v0 / (v0 - v1)),
                    (false, true) => leave = leave.min(v0 / (v0 - v1)),
                    (false, false) => {}
                }
            }
            if enter > leave || first.is_some_and(|(at, sure)| sure && at <= enter) {
                continue;
            }
            let violated = |at: &f64| {
                let pose: Vec<f64> = from.iter().zip(to).map(|(a, b)| a + (b - a) * at).collect();
                !self.reference.satisfies_constraints(&pose)
            };
            let candidates = [enter, (enter + 1e-9).min(leave), (enter + leave) / 2.0, leave];
            let found = candidates.iter().find(|at| violated(at));
            first = match (found, first) {
                (Some(at), Some((other, true))) => Some((at.min(other), true)),
                (Some(at), _) => Some((*at, true)),
                (None, None) => Some((enter, false)),
                (None, known) => known,
            };
        }
        first
    }
}
