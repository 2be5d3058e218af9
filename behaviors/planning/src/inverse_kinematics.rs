//! Inverse kinematics by damped least squares: motor positions that minimize the norm of a function
//! of the configuration.
//!
//! Levenberg-Marquardt with a numeric Jacobian J and the step of least norm: step = J^T (J J^T +
//! damping I)^-1 off. A motor at its limit that would move beyond it is excluded from the step.

use nalgebra::{DMatrix, DVector};

/// Maximum number of steps.
const MAX_STEPS: usize = 60;
/// Step of the numeric derivative, rad.
const PROBE_RAD: f64 = 1e-6;
/// Maximum step of a motor, rad.
const MAX_STEP_RAD: f64 = 0.3;
/// Sum of squared residuals at which the search ends.
const CONVERGED: f64 = 1e-9;
/// Weight of a meter relative to a radian: a millimeter counts like 0.6 degrees.
pub const PER_METER: f64 = 10.0;

/// Motors that may move, and their limits.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MotorGroup {
    /// Indices into `Robot::motors`.
    pub motors: Vec<usize>,
    /// Minimum and maximum position of each, rad at the encoder.
    pub limits: Vec<(f64, f64)>,
}

impl MotorGroup {
    /// Returns a whole configuration with the group at `q`.
    pub fn whole(&self, rest: &[f64], q: &[f64]) -> Vec<f64> {
        crate::group::whole(&self.motors, rest, q)
    }

    /// Returns the group's part of a whole configuration, clamped to its limits.
    pub fn share(&self, pose: &[f64]) -> Vec<f64> {
        let at = |(m, (min, max)): (&usize, &(f64, f64))| pose.get(*m).copied().unwrap_or(0.0).max(*min).min(*max);
        self.motors.iter().zip(&self.limits).map(at).collect()
    }

    /// Returns start configurations for further searches: the middle of all limits, and each motor
    /// a quarter of its range above and below it.
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

    /// Returns positions near those at `rest` that minimize the norm of `off`, a function of the
    /// whole configuration.
    pub fn solve(&self, rest: &[f64], off: impl Fn(&[f64]) -> Vec<f64>) -> Vec<f64> {
        let off = |q: &[f64]| DVector::from_vec(off(&self.whole(rest, q)));
        let mut q = self.share(rest);
        let mut now = off(&q);
        let mut damping = 1e-3;
        for _ in 0..MAX_STEPS {
            if now.norm_squared() < CONVERGED || damping > 1e4 {
                break;
            }
            let Some(step) = self.step(&q, &now, &off, damping) else { break };
            let longest = step.amax().max(MAX_STEP_RAD) / MAX_STEP_RAD;
            let moved = q.iter().zip(step.iter()).zip(&self.limits);
            let next: Vec<f64> = moved.map(|((q, s), (min, max))| (q - s / longest).max(*min).min(*max)).collect();
            let then = off(&next);
            if then.norm_squared() < now.norm_squared() {
                q = next;
                now = then;
                damping = f64::max(damping * 0.3, 1e-6);
            } else {
                damping *= 5.0;
            }
        }
        q
    }

    /// Returns the step to subtract from `q`; `None` if the equations can't be solved.
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
                *slot += PROBE_RAD;
            }
            columns.push((off(&probe) - now) / PROBE_RAD);
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
