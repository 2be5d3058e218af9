//! Configurations that bring a hand to a position or point the eyes at one: inverse kinematics from
//! a nearby configuration.

use mobee_planning::inverse_kinematics::{MotorGroup, PER_METER};
use mobee_planning::table_map::HandChain;
use nalgebra::{Point3, Unit, Vector3};

/// Maximum angle between an eye's axis and a point that it looks at, rad (3 degrees).
const MAX_AIM_ERROR_RAD: f64 = std::f64::consts::PI / 60.0;
/// Maximum distance of a motor from its rest position, rad (1 degree): maps are rounded to 1e-9,
/// and encoders are noisy.
const REST_TOLERANCE_RAD: f64 = std::f64::consts::PI / 180.0;

/// A hand, and the motors that move it.
#[derive(Clone, Debug)]
pub(super) struct ReachHand {
    pub chain: HandChain,
    /// The map's motors, except those that move only other hands.
    pub group: MotorGroup,
    /// Motors that move only other hands, and their rest positions, rad.
    pub others: Vec<(usize, f64)>,
    /// Direction that the palm should have, world frame.
    pub palm: Unit<Vector3<f64>>,
}

impl ReachHand {
    /// Returns whether all other hands are at rest.
    pub fn is_alone(&self, pose: &[f64]) -> bool {
        self.others.iter().all(|(m, rest)| pose.get(*m).is_some_and(|q| (q - rest).abs() < REST_TOLERANCE_RAD))
    }

    /// Solves for the group's positions, rad, near those of a whole configuration, that bring the
    /// hand to `to` with its palm as required.
    pub fn bring(&self, pose: &[f64], to: Vector3<f64>) -> Vec<f64> {
        self.group.solve(pose, |q| {
            let hand = self.chain.at(q);
            let place = (hand.at.coords - to) * PER_METER;
            place.iter().copied().chain((hand.palm - *self.palm).iter().copied()).collect()
        })
    }

    /// Returns the distance of the hand from `to`, meters, and the angle of its palm from the
    /// required direction, rad.
    pub fn off(&self, pose: &[f64], to: Vector3<f64>) -> (f64, f64) {
        let hand = self.chain.at(pose);
        ((hand.at.coords - to).norm(), hand.palm.angle(&self.palm))
    }
}

/// The eyes, and the motors that turn them.
#[derive(Clone, Debug)]
pub(super) struct Eyes {
    /// Chain to each eye; its palm is the viewing direction.
    pub chains: Vec<HandChain>,
    pub group: MotorGroup,
}

impl Eyes {
    /// Solves for the group's positions, rad, near those of a whole configuration, that point all
    /// eyes at `to` as well as possible. The search can end in a local minimum (the neck at its
    /// upper limit, the eyes at their lower one), so it is repeated from other start
    /// configurations.
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
        if first.0 <= MAX_AIM_ERROR_RAD {
            return first.1;
        }
        let others = self.group.beginnings().into_iter().map(|q| solve(&self.group.whole(pose, &q)));
        let best = [first].into_iter().chain(others).min_by(|a, b| a.0.total_cmp(&b.0));
        best.map_or_else(|| self.group.share(pose), |(_, q)| q)
    }

    /// Returns the largest angle of a point from the optical axis of an eye, rad.
    pub fn off(&self, pose: &[f64], to: Vector3<f64>) -> f64 {
        let off = |eye: &HandChain| {
            let eye = eye.at(pose);
            eye.palm.angle(&direction(eye.at, to))
        };
        self.chains.iter().map(off).fold(0.0, f64::max)
    }

    /// Returns a point at distance `far`, meters, that the eyes look at; `None` without eyes.
    pub fn ahead(&self, pose: &[f64], far: f64) -> Option<Vector3<f64>> {
        let points = self.chains.iter().map(|eye| eye.at(pose)).map(|eye| eye.at.coords + eye.palm * far);
        let sum: Vector3<f64> = points.sum();
        (!self.chains.is_empty()).then(|| sum / self.chains.len() as f64)
    }
}

fn direction(from: Point3<f64>, to: Vector3<f64>) -> Vector3<f64> {
    (to - from.coords).try_normalize(1e-9).unwrap_or_default()
}
