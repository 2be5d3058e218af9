//! Poses in which a hand is where it should be, or eyes look where they should: damped least squares from a pose that is near.
//!
//! Levenberg-Marquardt, J numerically, the step of least norm:  step = J^T (J J^T + damping I)^-1 off. A motor that is at its limit and is
//! to go beyond takes no part in the step.

use crate::table_map::HandChain;
use nalgebra::{DMatrix, DVector, Point3, Unit, Vector3};

/// Steps at most, the step of the numeric derivative and the longest step of a motor, rad.
const ROUNDS: usize = 60;
const PROBE: f64 = 1e-6;
const LONGEST: f64 = 0.3;
/// Sum of squares that is as good as nothing.
const DONE: f64 = 1e-9;
/// Eyes that are so near to what they are to look at, rad, look at it (3 degrees).
const AIMED: f64 = std::f64::consts::PI / 60.0;
/// What is so near to where it rests is there, rad: maps are kept to a billionth, and encoders are noisy.
const AT_REST: f64 = std::f64::consts::PI / 180.0;
/// What a meter counts, beside a radian: a millimeter is as bad as 0.6 degrees.
const PER_METER: f64 = 10.0;

/// The motors that are free to move, and within which limits.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Group {
    /// Indices into `Robot::motors`.
    pub motors: Vec<usize>,
    /// Least and greatest position of each, rad of encoder.
    pub limits: Vec<(f64, f64)>,
}

impl Group {
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
    fn beginnings(&self) -> Vec<Vec<f64>> {
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
    fn solve(&self, rest: &[f64], off: impl Fn(&[f64]) -> Vec<f64>) -> Vec<f64> {
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

/// A hand, and the motors that bring it somewhere.
#[derive(Clone, Debug)]
pub(super) struct Hand {
    pub chain: HandChain,
    /// The map's motors, but for those that move other hands alone.
    pub group: Group,
    /// These, and where they rest, rad.
    pub others: Vec<(usize, f64)>,
    /// Where the palm is to point, in the world.
    pub palm: Unit<Vector3<f64>>,
}

impl Hand {
    /// Whether all other hands are where they rest.
    pub fn is_alone(&self, pose: &[f64]) -> bool {
        self.others.iter().all(|(m, rest)| pose.get(*m).is_some_and(|q| (q - rest).abs() < AT_REST))
    }

    /// The group's positions, near those of a whole pose, with the hand there and its palm as it should be.
    pub fn bring(&self, pose: &[f64], to: Vector3<f64>) -> Vec<f64> {
        self.group.solve(pose, |q| {
            let hand = self.chain.at(q);
            let place = (hand.at.coords - to) * PER_METER;
            place.iter().copied().chain((hand.palm - *self.palm).iter().copied()).collect()
        })
    }

    /// How far the hand is from there, meters, and how far its palm points elsewhere, rad.
    pub fn off(&self, pose: &[f64], to: Vector3<f64>) -> (f64, f64) {
        let hand = self.chain.at(pose);
        ((hand.at.coords - to).norm(), hand.palm.angle(&self.palm))
    }
}

/// What looks, and the motors that turn it.
#[derive(Clone, Debug)]
pub(super) struct Eyes {
    /// To each eye; its palm is the direction in which it looks.
    pub chains: Vec<HandChain>,
    pub group: Group,
}

impl Eyes {
    /// The group's positions, near those of a whole pose, with all eyes on a point as far as that goes. A neck that goes up to its limit
    /// while the eyes go down to theirs is a dead end of the search: it then begins elsewhere as well.
    pub fn turn(&self, pose: &[f64], to: Vector3<f64>) -> Vec<f64> {
        let solve = |from: &[f64]| {
            let q = self.group.solve(from, |q| {
                let off = |eye: &HandChain| {
                    let eye = eye.at(q);
                    (eye.palm - direction(eye.at, to)).iter().copied().collect::<Vec<_>>()
                };
                self.chains.iter().flat_map(off).collect()
            });
            (self.off(&self.group.whole(pose, &q), to), q)
        };
        let first = solve(pose);
        if first.0 <= AIMED {
            return first.1;
        }
        let others = self.group.beginnings().into_iter().map(|q| solve(&self.group.whole(pose, &q)));
        let best = [first].into_iter().chain(others).min_by(|a, b| a.0.total_cmp(&b.0));
        best.map_or_else(|| self.group.share(pose), |(_, q)| q)
    }

    /// How far from the middle of its picture the eye that sees it worst has a point, rad.
    pub fn off(&self, pose: &[f64], to: Vector3<f64>) -> f64 {
        let off = |eye: &HandChain| {
            let eye = eye.at(pose);
            eye.palm.angle(&direction(eye.at, to))
        };
        self.chains.iter().map(off).fold(0.0, f64::max)
    }

    /// A point that the eyes look at, so far away, meters; none without eyes.
    pub fn ahead(&self, pose: &[f64], far: f64) -> Option<Vector3<f64>> {
        let points = self.chains.iter().map(|eye| eye.at(pose)).map(|eye| eye.at.coords + eye.palm * far);
        let sum: Vector3<f64> = points.sum();
        (!self.chains.is_empty()).then(|| sum / self.chains.len() as f64)
    }
}

fn direction(from: Point3<f64>, to: Vector3<f64>) -> Vector3<f64> {
    (to - from.coords).try_normalize(1e-9).unwrap_or_default()
}
