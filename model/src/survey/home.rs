//! A pose to begin at.

use crate::{Robot, Scene, SceneError, random_poses};
use nalgebra::Isometry3;
use std::sync::Arc;

/// How many poses are tried at each distance from the wanted one.
const TRIES: usize = 400;
/// Shares of the way to a random pose at which the search looks, nearest first.
const STEPS: [f64; 6] = [0.05, 0.1, 0.2, 0.4, 0.7, 1.0];
/// How often the way back to the wanted pose is halved.
const HALVINGS: usize = 12;

/// A pose to begin at, and how free it is.
#[derive(Clone, Debug, PartialEq)]
pub struct HomePose {
    /// The pose, rad of encoder.
    pub q: Vec<f64>,
    /// Distance of the nearest pair there, meters, and no more than was asked for.
    pub clearance: f64,
    /// Whether it is the wanted one.
    pub as_wanted: bool,
}

/// The wanted pose if it is free by `clearance` meters, else one near it that is; if there is none, the freest that was found.
///
/// # Method
/// Random poses are approached from the wanted one, first a little of the way and then more. From the first that is free the way
/// back is halved as long as it stays free.
///
/// # Errors
/// If the robot can't stand in a scene.
pub fn find_home(robot: &Robot, wanted: &[f64], clearance: f64, seed: u64) -> Result<HomePose, SceneError> {
    let scene = Scene::new(vec![(Arc::new(robot.clone()), Isometry3::identity())], Vec::new())?;
    let free_by = |q: &[f64]| {
        let lawful = scene.satisfies_constraints(0, q);
        let nearest = scene.clearance(&[q], clearance).map_or(clearance, |c| c.distance.min(clearance));
        if lawful { nearest } else { f64::NEG_INFINITY }
    };
    let within: Vec<f64> = robot.motors.iter().zip(wanted).map(|(m, q)| q.max(m.min).min(m.max)).collect();
    let at_wanted = free_by(&within);
    let mut best = HomePose { q: within.clone(), clearance: at_wanted, as_wanted: true };
    if at_wanted >= clearance {
        return Ok(best);
    }
    let mut random = random_poses(robot, seed);
    for step in STEPS {
        for to in random.by_ref().take(TRIES) {
            let part = |share: f64| -> Vec<f64> {
                let toward = |((m, a), b): ((&crate::Motor, &f64), &f64)| a + share * m.way(*a, *b);
                robot.motors.iter().zip(&within).zip(&to).map(toward).collect()
            };
            let there = free_by(&part(step));
            if there > best.clearance {
                best = HomePose { q: part(step), clearance: there, as_wanted: false };
            }
            if there >= clearance {
                let (mut blocked, mut free) = (0.0, step);
                for _ in 0..HALVINGS {
                    let middle = (blocked + free) / 2.0;
                    if free_by(&part(middle)) >= clearance { free = middle } else { blocked = middle }
                }
                return Ok(HomePose { q: part(free), clearance, as_wanted: false });
            }
        }
    }
    Ok(best)
}
