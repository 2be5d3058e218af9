//! Conservative advancement along a sampled motion.
//!
//! A pair that is `d` meters farther apart than matters, and approaches by at most `v` meters per step, is irrelevant
//! for the next `d / v` steps and is checked again only after them. Since `v` bounds the true speed, the skipped
//! samples cannot change the result: it equals that of testing every pair at every step.

use super::{Engine, IndexPair, Near};
use nalgebra::Isometry3;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// A pair and a bound of its approach speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SweptPair {
    /// The two colliders.
    pub pair: IndexPair,
    /// Upper bound of the change of their distance, meters per step.
    pub speed: f64,
    /// Clearance of its own, meters, if it has one: it replaces a larger one of the query, and the pair's distance
    /// matters only below it.
    pub own: Option<f64>,
}

/// A motion in equal steps, and the query about it.
#[derive(Clone, Copy, Debug)]
pub struct LineQuery<'a> {
    /// The pairs to check.
    pub pairs: &'a [SweptPair],
    /// Number of steps; samples are at 0 to `steps`, both ends included.
    pub steps: u32,
    /// A distance of this or less, in meters, is not free.
    pub clearance: f64,
    /// Distances are measured up to this value, meters; not below the clearance.
    pub cap: f64,
    /// If true, the check continues to the end of a motion that is not free, to find the minimum distance over all
    /// samples.
    pub whole: bool,
}

/// Result of checking a motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineResult {
    /// The smallest distance at any checked sample, meters; the query's cap if no distance is smaller.
    pub min_distance: f64,
    /// The pair of `min_distance`; `None` if that is the cap.
    pub pair: Option<IndexPair>,
    /// The first step at which the motion is not free.
    pub hit: Option<u32>,
}

/// Implements [`Engine::line`].
pub(super) fn advance<E: Engine>(
    engine: &E,
    query: &LineQuery<'_>,
    mut frames_at: impl FnMut(u32, &mut Vec<Isometry3<f64>>),
) -> LineResult {
    let mut result = LineResult { min_distance: query.cap, pair: None, hit: None };
    // Min-heap of pairs by the step at which each must be checked next; all start at step 0.
    let mut pending: BinaryHeap<Reverse<(u32, u32)>> = (0..query.pairs.len() as u32).map(|p| Reverse((0, p))).collect();
    let mut frames = Vec::new();
    let mut placement = E::Placement::default();
    let mut placed_at = None;
    while let Some(Reverse((step, p))) = pending.pop() {
        if placed_at != Some(step) {
            // Stop only between samples, so that the result has the nearest pair of the sample of the first hit.
            if !query.whole && result.hit.is_some() {
                break;
            }
            placed_at = Some(step);
            frames_at(step, &mut frames);
            engine.place_frames(&frames, &mut placement);
        }
        let SweptPair { pair, speed, own } = query.pairs[p as usize];
        engine.place_pair(&mut placement, pair);
        let clearance = own.map_or(query.clearance, |own| own.min(query.clearance));
        let matters = own.map_or(result.min_distance, |own| own.min(result.min_distance));
        let distance = match engine.near(&placement, pair, matters) {
            Near::Within(near) => {
                if near.distance < result.min_distance || result.pair.is_none() {
                    result.min_distance = near.distance;
                    result.pair = Some(pair);
                }
                if near.distance <= clearance {
                    result.hit = result.hit.or(Some(step));
                }
                near.distance
            }
            Near::Beyond(distance) => distance,
        };
        // The pair is irrelevant until it can be nearer than the smallest distance so far. Rounding down makes the next
        // check too early and never too late; at least one step, so that the loop advances.
        let idle = ((distance - matters.min(result.min_distance)) / speed).floor();
        if speed > 0.0 && idle < f64::from(query.steps - step) {
            pending.push(Reverse((step + (idle.max(0.0) as u32).max(1), p)));
        }
    }
    result
}
