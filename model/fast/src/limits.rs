//! Limits and constraints: both are linear, so on a line they are solved for exactly.

use crate::fast::FastScene;
use crate::program::{FlatClause, Program};
use mobee_model::Scene;

/// Tolerance at a limit, rad of encoder: rounding of units.
const LIMIT_TOLERANCE_RAD: f64 = 1e-9;

/// Adds the limits and constraints of all robots of a scene.
pub(crate) fn constraints(program: &mut Program, scene: &Scene) {
    let mut clauses = Vec::new();
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
            clauses.push(FlatClause { members, doubt });
        }
    }
    program.clauses = clauses.into();
}

/// True if a motor is within its limits, rad of encoder.
pub(crate) fn is_within(q: f64, (low, high): (f64, f64)) -> bool {
    q >= low - LIMIT_TOLERANCE_RAD && q <= high + LIMIT_TOLERANCE_RAD
}

/// A motor's position clamped to its limits; `low` for NaN.
#[inline]
pub(crate) fn within_limits(q: f64, (low, high): (f64, f64)) -> f64 {
    let q = if q > low { q } else { low };
    if q < high { q } else { high }
}

impl FastScene {
    /// First position on a line beyond a limit of these motors, with `true`: it is certain.
    pub(crate) fn first_beyond_limits(&self, from: &[f64], to: &[f64], moving: &[usize]) -> Option<(f64, bool)> {
        let mut first: Option<f64> = None;
        for (a, b, (low, high)) in moving.iter().map(|m| (&from[*m], &to[*m], self.program.limits[*m])) {
            let inside = |q: &f64| is_within(*q, (low, high));
            let at = match (inside(a), inside(b)) {
                (true, true) => continue,
                (false, _) => 0.0,
                // Slightly behind the crossing, so that rounding can't place it before it.
                (true, false) => {
                    let limit = if *b > high { high + LIMIT_TOLERANCE_RAD } else { low - LIMIT_TOLERANCE_RAD };
                    (((limit - a) / (b - a)) + 1e-12).clamp(0.0, 1.0)
                }
            };
            let at = if at.is_nan() { 0.0 } else { at };
            first = Some(first.map_or(at, |f| f.min(at)));
        }
        first.map(|at| (at, true))
    }

    /// First position on a line that violates a constraint, with `true` if the violation is certain. Half-spaces are
    /// linear, so each clause is violated on one interval.
    pub(crate) fn first_violation(&self, from: &[f64], to: &[f64]) -> Option<(f64, bool)> {
        let mut first: Option<(f64, bool)> = None;
        for clause in self.program.clauses.iter() {
            let mut enter = 0.0_f64;
            let mut leave = 1.0_f64;
            for (terms, constant) in &clause.members {
                let value = |q: &[f64]| terms.iter().map(|(m, a)| a * q[*m]).sum::<f64>() + constant - clause.doubt;
                let v0 = value(from);
                let v1 = value(to);
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
