//! Escape from a contact: an object was placed onto a resting robot, which may only move so that no
//! contact gets worse.
//!
//! The controller accepts such a motion under the retreat's rule (contacts only shrink, none
//! begins). Escapes are searched for under the same rule: short straight lines in joint space,
//! evaluated in steps of about a millimeter.

use crate::group::{contacts_at, involves, with_pose};
use mobee_contract::{Target, View};
use mobee_model::{Contact, Pair, Watch};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Joint-space length (sum over motors, rad) of one step: a millimeter for a point a meter away from every axis.
const STEP_RAD: f64 = 0.001;
/// Maximum length of an escape, steps.
const MAX_STEPS: usize = 500;
/// Maximum apparent decrease of a distance that counts as rounding, meters.
const ROUNDING_M: f64 = 1e-4;
/// Minimum increase of the distance, meters, for an escape that does not end free.
const MIN_GAIN_M: f64 = 5e-4;
/// Number of random directions tried after all single motors.
const RANDOM_DIRECTIONS: usize = 60;
/// Maximum number of configurations evaluated, over all directions.
const MAX_CONFIGURATIONS: usize = 20_000;

/// Distance below the plans' clearance at which the robot counts as in contact, meters: the
/// difference between the reflex's margin and a plan's clearance.
pub const SLACK: f64 = 0.002;

/// Returns whether the robot rests closer to something than its reflex allows.
pub fn caught(view: &View) -> bool {
    !contacts_at(view, view.pose(), view.clearance - SLACK).is_empty()
}

/// Returns a short motion of these motors along which every present contact only widens and none
/// begins, up to the first configuration that is free at the view's clearance. If no direction
/// leads there, it returns the one that gains most distance.
///
/// `toward`: whole configurations to try first (recent rest positions). `None` if every direction
/// makes a contact worse.
pub fn escape(view: &View, motors: &[usize], toward: &[Vec<f64>], speed: f64, seed: u64) -> Option<Target> {
    let start = view.pose();
    // Steps are small, so most distances of a configuration still hold at the next one.
    let mut here = Watch::new(view.scene.clone(), view.clearance);
    let present = distances(view, here.update(&with_pose(view, start)));
    let mut budget = MAX_CONFIGURATIONS;
    let mut best: Option<Way> = None;
    for direction in directions(start, motors, toward, seed) {
        let limit = best.as_ref().filter(|b| b.free).map_or(MAX_STEPS, |b| b.steps.saturating_sub(1));
        let Some(way) = walk(view, here.clone(), motors, &direction, &present, limit, &mut budget) else { continue };
        let better = best.as_ref().is_none_or(|b| match (way.free, b.free) {
            (true, true) => way.steps < b.steps,
            (false, false) => way.gain > b.gain,
            (free, _) => free,
        });
        if better {
            best = Some(way);
        }
    }
    let way = best?;
    let q = motors.iter().map(|m| way.q.get(*m).copied().unwrap_or(0.0)).collect();
    Some(Target { motors: motors.to_vec(), q, speed })
}

/// Result of following one direction.
struct Way {
    q: Vec<f64>,
    steps: usize,
    free: bool,
    gain: f64,
}

fn walk(
    view: &View,
    mut watch: Watch,
    motors: &[usize],
    direction: &[f64],
    present: &[(Pair, f64)],
    limit: usize,
    budget: &mut usize,
) -> Option<Way> {
    let start = view.pose();
    let satisfied_constraints = view.scene.satisfies_constraints(view.robot, start);
    let narrowest = |d: &[(Pair, f64)]| d.iter().map(|(_, d)| *d).fold(view.clearance, f64::min);
    let at_first = narrowest(present);
    let mut widest = present.to_vec();
    let mut way: Option<Way> = None;
    let mut q = start.to_vec();
    for steps in 1..=limit {
        q.copy_from_slice(start);
        for (m, d) in motors.iter().zip(direction) {
            let slot = q.get_mut(*m)?;
            let axis = view.axes.get(*m)?;
            *slot += d * STEP_RAD * steps as f64;
            if *slot < axis.min || *slot > axis.max {
                return way;
            }
        }
        if *budget == 0 || (satisfied_constraints && !view.scene.satisfies_constraints(view.robot, &q)) {
            return way;
        }
        *budget -= 1;
        let now = distances(view, watch.update(&with_pose(view, &q)));
        let before = |pair: &Pair| widest.binary_search_by_key(&pair, |(p, _)| p).ok().and_then(|i| widest.get(i));
        let worse = now.iter().any(|(pair, d)| before(pair).is_none_or(|(_, w)| *d < w - ROUNDING_M));
        if worse {
            return way;
        }
        // A pair that has left the clearance may not return, so only the pairs still within it are
        // stored.
        widest = now.iter().map(|(p, d)| (*p, before(p).map_or(*d, |(_, w)| w.max(*d)))).collect();
        let free = now.is_empty();
        let gain = narrowest(&now) - at_first;
        if free || way.as_ref().map_or(MIN_GAIN_M, |w| w.gain) < gain {
            way = Some(Way { q: q.clone(), steps, free, gain });
        }
        if free {
            return way;
        }
    }
    way
}

/// Returns the contacts of the agent's robot, sorted by pair.
fn distances(view: &View, contacts: &[Contact]) -> Vec<(Pair, f64)> {
    contacts.iter().filter(|c| involves(view.robot, c)).map(|c| (c.pair, c.distance)).collect()
}

/// Returns directions, scaled so that their absolute values sum to 1: toward the recent positions,
/// every motor alone, random mixtures.
fn directions(start: &[f64], motors: &[usize], toward: &[Vec<f64>], seed: u64) -> Vec<Vec<f64>> {
    let at = |q: &[f64], m: usize| q.get(m).copied().unwrap_or(0.0);
    let mut all: Vec<Vec<f64>> =
        toward.iter().map(|q| motors.iter().map(|m| at(q, *m) - at(start, *m)).collect()).collect();
    for i in 0..motors.len() {
        for sign in [1.0, -1.0] {
            all.push((0..motors.len()).map(|j| if i == j { sign } else { 0.0 }).collect());
        }
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    all.extend((0..RANDOM_DIRECTIONS).map(|_| motors.iter().map(|_| rng.random_range(-1.0..1.0)).collect()));
    for direction in &mut all {
        let sum: f64 = direction.iter().map(|d: &f64| d.abs()).sum();
        direction.iter_mut().for_each(|d| *d /= sum);
    }
    all.retain(|d| d.iter().all(|c| c.is_finite()));
    all
}

/// Returns whether the straight line from the robot's configuration to another whole configuration
/// is free at the view's clearance, sampled in steps of a millimeter.
pub fn line_free(view: &View, to: &[f64]) -> bool {
    view.scene.line_free(view.robot, &with_pose(view, view.pose()), view.pose(), to, 0.001, view.clearance)
}
