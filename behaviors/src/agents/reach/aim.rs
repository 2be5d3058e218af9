//! Poses in which a hand is where it should be, or eyes look where they should: inverse kinematics from a pose that is near.

use crate::inverse_kinematics::{MotorGroup, PER_METER};
use crate::table_map::HandChain;
use nalgebra::{Point3, Unit, Vector3};

/// Eyes that are so near to what they are to look at, rad, look at it (3 degrees).
const AIMED: f64 = std::f64::consts::PI / 60.0;
/// What is so near to where it rests is there, rad: maps are kept to a billionth, and encoders are noisy.
const AT_REST: f64 = std::f64::consts::PI / 180.0;

/// A hand, and the motors that bring it somewhere.
#[derive(Clone, Debug)]
pub(super) struct Hand {
    pub chain: HandChain,
    /// The map's motors, but for those that move other hands alone.
    pub group: MotorGroup,
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
    pub group: MotorGroup,
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
