//! Search for a collision-free home configuration.

use mobee_model::{Motor, Robot, Scene, SceneError, random_poses};
use nalgebra::Isometry3;
use std::sync::Arc;

/// Number of configurations tried at each distance from the desired one.
const TRIES_PER_STEP: usize = 400;
/// Fractions of the line to a random configuration that are tried, nearest first.
const LINE_FRACTIONS: [f64; 6] = [0.05, 0.1, 0.2, 0.4, 0.7, 1.0];
/// Number of free configurations that are moved back toward the desired one; the nearest result counts.
const CANDIDATES: usize = 5;
/// Fraction of the largest clearance found that suffices if the configuration is nearer to the desired one.
const SUFFICIENT_FRACTION: f64 = 0.9;
/// Maximum number of rounds in which all motors are moved back.
const MAX_ROUNDS: usize = 3;
/// Number of bisection steps per motor.
const BISECTIONS: usize = 8;

/// A home configuration and its clearance.
#[derive(Clone, Debug, PartialEq)]
pub struct HomePose {
    /// The configuration, rad of encoder.
    pub q: Vec<f64>,
    /// Distance of the nearest pair, meters, at most the requested clearance.
    pub clearance: f64,
    /// The motors that differ from the desired configuration, with their displacement, rad of encoder; largest first.
    pub moved: Vec<(usize, f64)>,
}

/// The desired configuration if it is free by `clearance` meters, else one near it that is. If none is found, the one
/// with the largest clearance.
///
/// # Method
/// Random configurations are approached from the desired one, first by a small fraction and then farther, until some
/// are free. In each of them one motor after the other is moved back to its desired position, completely if the
/// configuration stays free, else as far as possible. So few motors differ in the result, as a person would choose it.
/// Of these the one with the smallest sum of displacements from the desired configuration is returned.
///
/// # Errors
/// If the robot can't be placed in a scene.
pub fn find_home(robot: &Robot, wanted: &[f64], clearance: f64, seed: u64) -> Result<HomePose, SceneError> {
    let scene = Scene::new(vec![(Arc::new(robot.clone()), Isometry3::identity())], Vec::new())?;
    let free_by = |q: &[f64]| {
        let satisfies = scene.satisfies_constraints(0, q);
        let nearest = scene.clearance(&[q], clearance).map_or(clearance, |c| c.distance.min(clearance));
        if satisfies { nearest } else { f64::NEG_INFINITY }
    };
    let within: Vec<f64> = robot.motors.iter().zip(wanted).map(|(m, q)| q.max(m.min).min(m.max)).collect();
    let mut freest = (within.clone(), free_by(&within));
    let mut free = Vec::new();
    let mut random = random_poses(robot, seed);
    for step in LINE_FRACTIONS {
        if freest.1 >= clearance {
            break;
        }
        for to in random.by_ref().take(TRIES_PER_STEP) {
            let part: Vec<f64> =
                robot.motors.iter().zip(&within).zip(&to).map(|((m, a), b)| a + step * m.way(*a, *b)).collect();
            // The cheap test whether it beats the best clearance so far; the exact clearance in contact would be a
            // depth.
            if !scene.free(&[&part], freest.1.min(clearance)) {
                continue;
            }
            let there = free_by(&part);
            if there > freest.1 {
                freest = (part.clone(), there);
            }
            if there >= clearance {
                free.push(part);
            }
            if free.len() == CANDIDATES {
                break;
            }
        }
    }
    let displacements = |q: &[f64]| -> Vec<f64> {
        robot.motors.iter().zip(&within).zip(q).map(|((m, from), to)| m.way(*from, *to)).collect()
    };
    let far = |q: &[f64]| displacements(q).iter().map(|by| by.abs()).sum::<f64>();
    // If no configuration has the requested clearance, the best one found sets the goal.
    let enough =
        if freest.1 >= clearance { clearance } else { freest.1 - (1.0 - SUFFICIENT_FRACTION) * freest.1.abs() };
    free.push(freest.0);
    let clear = |q: &[f64]| scene.free(&[q], enough);
    let moved_back = free.into_iter().map(|q| move_back(q, &within, &robot.motors, clear));
    let q = moved_back.min_by(|a, b| far(a).total_cmp(&far(b))).unwrap_or_else(|| within.clone());
    let mut moved: Vec<(usize, f64)> = displacements(&q).into_iter().enumerate().filter(|(_, by)| *by != 0.0).collect();
    moved.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    Ok(HomePose { clearance: free_by(&q), q, moved })
}

/// Moves each motor of a free configuration as near to its desired position as the others permit, the farthest first.
fn move_back(mut q: Vec<f64>, wanted: &[f64], motors: &[Motor], free: impl Fn(&[f64]) -> bool) -> Vec<f64> {
    for _ in 0..MAX_ROUNDS {
        let before = q.clone();
        let displacement = |q: &[f64], m: usize| motors[m].way(q[m], wanted[m]);
        let mut order: Vec<usize> = (0..motors.len()).filter(|m| displacement(&q, *m) != 0.0).collect();
        order.sort_by(|a, b| displacement(&q, *b).abs().total_cmp(&displacement(&q, *a).abs()));
        for m in order {
            let from = q[m];
            let by = displacement(&q, m);
            q[m] = wanted[m];
            if free(&q) {
                continue;
            }
            let mut good = 0.0;
            let mut bad = 1.0;
            for _ in 0..BISECTIONS {
                let middle = (good + bad) / 2.0;
                q[m] = from + middle * by;
                if free(&q) { good = middle } else { bad = middle }
            }
            q[m] = from + good * by;
        }
        if q == before {
            break;
        }
    }
    q
}
