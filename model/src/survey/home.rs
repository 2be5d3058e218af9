//! A pose to begin at.

use crate::{Motor, Robot, Scene, SceneError, random_poses};
use nalgebra::Isometry3;
use std::sync::Arc;

/// How many poses are tried at each distance from the wanted one.
const TRIES: usize = 400;
/// Shares of the way to a random pose at which the search looks, nearest first.
const STEPS: [f64; 6] = [0.05, 0.1, 0.2, 0.4, 0.7, 1.0];
/// So many free poses are brought near the wanted one; the nearest counts.
const CANDIDATES: usize = 5;
/// A pose that is nearly as free as the freest will do, if it is nearer to the wanted one.
const NEARLY: f64 = 0.9;
/// How often all motors are led back.
const ROUNDS: usize = 3;
/// How often a motor's way back is halved.
const HALVINGS: usize = 8;

/// A pose to begin at, and how free it is.
#[derive(Clone, Debug, PartialEq)]
pub struct HomePose {
    /// The pose, rad of encoder.
    pub q: Vec<f64>,
    /// Distance of the nearest pair there, meters, and no more than was asked for.
    pub clearance: f64,
    /// The motors that are not where they are wanted to be, and how far they are from there, rad of encoder; the farthest first.
    pub moved: Vec<(usize, f64)>,
}

/// The wanted pose if it is free by `clearance` meters, else one near it that is; if there is none, the freest that was found.
///
/// # Method
/// Random poses are approached from the wanted one, first a little of the way and then more, until some are free. In each of them
/// one motor after the other is led back to where it is wanted, all the way if the pose stays free, or as far as it does: what remains is a
/// pose of which few motors differ, as a person would choose it. Of these the one counts that is the smallest sum of ways from the
/// wanted one.
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
    let mut freest = (within.clone(), free_by(&within));
    let mut free = Vec::new();
    let mut random = random_poses(robot, seed);
    for step in STEPS {
        if freest.1 >= clearance {
            break;
        }
        for to in random.by_ref().take(TRIES) {
            let part: Vec<f64> =
                robot.motors.iter().zip(&within).zip(&to).map(|((m, a), b)| a + step * m.way(*a, *b)).collect();
            // Cheaper than how free it is, which in contact is a depth: whether it is freer than the best so far.
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
    let ways = |q: &[f64]| -> Vec<f64> {
        robot.motors.iter().zip(&within).zip(q).map(|((m, from), to)| m.way(*from, *to)).collect()
    };
    let far = |q: &[f64]| ways(q).iter().map(|way| way.abs()).sum::<f64>();
    // Where no pose is as free as it should be, the freest that was found says how free one can be.
    let enough = if freest.1 >= clearance { clearance } else { freest.1 - (1.0 - NEARLY) * freest.1.abs() };
    free.push(freest.0);
    let clear = |q: &[f64]| scene.free(&[q], enough);
    let led = free.into_iter().map(|q| led_back(q, &within, &robot.motors, clear));
    let q = led.min_by(|a, b| far(a).total_cmp(&far(b))).unwrap_or_else(|| within.clone());
    let mut moved: Vec<(usize, f64)> = ways(&q).into_iter().enumerate().filter(|(_, way)| *way != 0.0).collect();
    moved.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    Ok(HomePose { clearance: free_by(&q), q, moved })
}

/// A free pose with each motor as near to where it is wanted as the others let it, the farthest first.
fn led_back(mut q: Vec<f64>, wanted: &[f64], motors: &[Motor], free: impl Fn(&[f64]) -> bool) -> Vec<f64> {
    for _ in 0..ROUNDS {
        let before = q.clone();
        let way = |q: &[f64], m: usize| motors[m].way(q[m], wanted[m]);
        let mut order: Vec<usize> = (0..motors.len()).filter(|m| way(&q, *m) != 0.0).collect();
        order.sort_by(|a, b| way(&q, *b).abs().total_cmp(&way(&q, *a).abs()));
        for m in order {
            let (from, way) = (q[m], way(&q, m));
            q[m] = wanted[m];
            if free(&q) {
                continue;
            }
            let (mut good, mut bad) = (0.0, 1.0);
            for _ in 0..HALVINGS {
                let middle = (good + bad) / 2.0;
                q[m] = from + middle * way;
                if free(&q) { good = middle } else { bad = middle }
            }
            q[m] = from + good * way;
        }
        if q == before {
            break;
        }
    }
    q
}
