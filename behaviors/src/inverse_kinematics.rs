//! Inverse kinematics by damped least squares: motor positions for which a function of the pose is as near to zero as it gets.
//!
//! Levenberg-Marquardt, J numerically, the step of least norm:  step = J^T (J J^T + damping I)^-1 off. A motor that is at its limit and is
//! to go beyond takes no part in the step.

use nalgebra::{DMatrix, DVector};

/// Steps at most, the step of the numeric derivative and the longest step of a motor, rad.
const ROUNDS: usize = 60;
const PROBE: f64 = 1e-6;
const LONGEST: f64 = 0.3;
/// Sum of squares that is as good as nothing.
const DONE: f64 = 1e-9;
/// What a meter counts, beside a radian: a millimeter is as bad as 0.6 degrees.
pub const PER_METER: f64 = 10.0;

/// The motors that are free to move, and within which limits.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MotorGroup {
    /// Indices into `Robot::motors`.
    pub motors: Vec<usize>,
    /// Least and greatest position of each, rad of encoder.
    pub limits: Vec<(f64, f64)>,
}

impl MotorGroup {
    /// A whole pose with the group at `q`.
    pub fn whole(&self, rest: &[f64], q: &[f64]) -> Vec<f64> {
        crate::group::whole(&self.motors, rest, q)
    }

    /// The group's share of a whole pose, put within its limits.
    pub fn share(&self, pose: &[f64]) -> Vec<f64> {
        let at = |(m, (min, max)): (&usize, &(f64, f64))| pose.get(*m).copied().unwrap_or(0.0).max(*min).min(*max);
        self.motors.iter().zip(&self.limits).map(at).collect()
    }

    /// Where a search may begin anew: the middle of all limits, and from there each motor a quarter of its way up and down.
    pub fn beginnings(&self) -> Vec<Vec<f64>> {
        let middle: Vec<f64> = self.limits.iter().map(|(min, max)| (min + max) / 2.0).collect();
        let beside = |(i, share): (usize, f64)| {
            let at =
                |(j, (q, (min, max))): (usize, (&f64, &(f64, f64)))| if i == j { q + share * (max - min) } else { *q };
            middle.iter().zip(&self.limits).enumerate().map(at).collect::<Vec<f64>>()
        };
        let besides = (0..middle.len()).flat_map(|i| [(i, -0.25), (i, 0.25)]).map(beside);
        [middle.clone()].into_iter().chain(besides).collect()
    }

    /// Positions near those at `rest` for which `off`, of the whole pose, is as near to zero as it gets.
    pub fn solve(&self, rest: &[f64], off: impl Fn(&[f64]) -> Vec<f64>) -> Vec<f64> {
        let off = |q: &[f64]| DVector::from_vec(off(&self.whole(rest, q)));
        let mut q = self.share(rest);
        let mut now = off(&q);
        let mut damping = 1e-3;
        for _ in 0..ROUNDS {
            if now.norm_squared() < DONE || damping > 1e4 {
                break;
            }
            let Some(step) = self.step(&q, &now, &off, damping) else { break };
            let longest = step.amax().max(LONGEST) / LONGEST;
            let moved = q.iter().zip(step.iter()).zip(&self.limits);
            let next: Vec<f64> = moved.map(|((q, s), (min, max))| (q - s / longest).max(*min).min(*max)).collect();
            let then = off(&next);
            if then.norm_squared() < now.norm_squared() {
                (q, now, damping) = (next, then, f64::max(damping * 0.3, 1e-6));
            } else {
                damping *= 5.0;
            }
        }
        q
    }

    /// What to subtract from `q`.
    fn step(
        &self,
        q: &[f64],
        now: &DVector<f64>,
        off: &impl Fn(&[f64]) -> DVector<f64>,
        damping: f64,
    ) -> Option<DVector<f64>> {
        let mut columns = Vec::new();
        for i in 0..q.len() {
            let mut probe = q.to_vec();
            if let Some(slot) = probe.get_mut(i) {
                *slot += PROBE;
            }
            columns.push((off(&probe) - now) / PROBE);
        }
        if columns.is_empty() {
            return None;
        }
        let mut jacobian = DMatrix::from_columns(&columns);
        let least_norm = |j: &DMatrix<f64>| {
            let square = j * j.transpose() + DMatrix::identity(now.len(), now.len()) * damping;
            Some(j.transpose() * square.cholesky()?.solve(now))
        };
        let step = least_norm(&jacobian)?;
        let mut stuck = false;
        for (i, ((q, s), (min, max))) in q.iter().zip(step.iter()).zip(&self.limits).enumerate() {
            if (*q <= *min && *s > 0.0) || (*q >= *max && *s < 0.0) {
                jacobian.column_mut(i).fill(0.0);
                stuck = true;
            }
        }
        if stuck { least_norm(&jacobian) } else { Some(step) }
    }
}
