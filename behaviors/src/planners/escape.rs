//! The way out of a contact: something was put onto a resting robot, and it may only move so that this gets no worse.
//!
//! The controller takes such a motion under the retreat's rule (contacts only shrink, none begins), so an escape is
//! looked for under the same rule: short straight lines in joint space, walked in steps of about a millimeter.

use crate::group::{contacts_at, involves, with_pose};
use mobee_contract::{Target, View};
use mobee_model::{Contact, Pair, Watch};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Joint-space length (sum over motors, rad) of one step: a millimeter for a point a meter away from every axis.
const STEP: f64 = 0.001;
/// Longest escape, steps.
const LONGEST: usize = 500;
/// How much nearer a pair may seem to come by rounding, meters.
const NOISE: f64 = 1e-4;
/// A way that frees nothing is still taken if it gains this distance, meters.
const GAIN: f64 = 5e-4;
/// Random directions tried after all single motors.
const RANDOM: usize = 60;
/// Most poses looked at, over all directions.
const POSES: usize = 20_000;

/// How much nearer than the clearance of plans a contact must be for the robot to count as not free, meters: the
/// difference between the reflex's margin and a plan's clearance.
pub const SLACK: f64 = 0.002;

/// Whether the robot rests nearer to something than its reflex allows.
pub fn caught(view: &View) -> bool {
    !contacts_at(view, view.pose(), view.clearance - SLACK).is_empty()
}

/// A short motion of these motors along which every present contact only gets wider and none begins, up to the first pose
/// that is free at the view's clearance; if no direction gets that far, the one that gains most distance.
///
/// `toward`: whole poses to try first (where the robot rested lately). `None` if every direction makes something worse.
pub fn escape(view: &View, motors: &[usize], toward: &[Vec<f64>], speed: f64, seed: u64) -> Option<Target> {
    let start = view.pose();
    // Steps are small: most of what is known at a pose holds at the next one.
    let mut here = Watch::new(view.scene.clone(), view.clearance);
    let present = distances(view, here.update(&with_pose(view, start)));
    let mut budget = POSES;
    let mut best: Option<Way> = None;
    for direction in directions(start, motors, toward, seed) {
        let limit = best.as_ref().filter(|b| b.free).map_or(LONGEST, |b| b.steps.saturating_sub(1));
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

/// How far a direction leads.
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
            let (slot, axis) = (q.get_mut(*m)?, view.axes.get(*m)?);
            *slot += d * STEP * steps as f64;
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
        let worse = now.iter().any(|(pair, d)| before(pair).is_none_or(|(_, w)| *d < w - NOISE));
        if worse {
            return way;
        }
        // A pair that has left the clearance may not come back: only those that are still there are kept.
        widest = now.iter().map(|(p, d)| (*p, before(p).map_or(*d, |(_, w)| w.max(*d)))).collect();
        let (free, gain) = (now.is_empty(), narrowest(&now) - at_first);
        if free || way.as_ref().map_or(GAIN, |w| w.gain) < gain {
            way = Some(Way { q: q.clone(), steps, free, gain });
        }
        if free {
            return way;
        }
    }
    way
}

/// What the agent's robot touches, sorted by pair.
fn distances(view: &View, contacts: &[Contact]) -> Vec<(Pair, f64)> {
    contacts.iter().filter(|c| involves(view.robot, c)).map(|c| (c.pair, c.distance)).collect()
}

/// Directions whose absolute values sum to 1: back to where the robot came from, every motor alone, random mixtures.
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
    all.extend((0..RANDOM).map(|_| motors.iter().map(|_| rng.random_range(-1.0..1.0)).collect()));
    for direction in &mut all {
        let sum: f64 = direction.iter().map(|d: &f64| d.abs()).sum();
        direction.iter_mut().for_each(|d| *d /= sum);
    }
    all.retain(|d| d.iter().all(|c| c.is_finite()));
    all
}

/// Whether the straight line of the robot from where it is to a whole pose is free at the view's clearance, judged in
/// steps of a millimeter.
pub fn line_free(view: &View, to: &[f64]) -> bool {
    view.scene.line_free(view.robot, &with_pose(view, view.pose()), view.pose(), to, 0.001, view.clearance)
}
