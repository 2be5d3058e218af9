//! Random configurations of a robot.

use crate::Robot;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Configurations drawn uniformly within the limits of all motors; equal seeds give equal sequences.
pub fn random_poses(robot: &Robot, seed: u64) -> impl Iterator<Item = Vec<f64>> + '_ {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    std::iter::repeat_with(move || {
        let drawn = |(min, max): (f64, f64), share: f64| min + (max - min) * share;
        robot.motors.iter().map(|m| drawn(m.range(), random.random::<f64>())).collect()
    })
}
