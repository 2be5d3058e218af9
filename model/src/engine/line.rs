//! A sampled motion, judged by conservative advancement.
//!
//! A pair that is `d` meters farther apart than matters, and closes at no more than `v` meters per step, can't matter for the
//! next `d / v` steps: it is looked at again only then. Since `v` bounds the true speed, the skipped samples could not have
//! changed the answer, which is that of testing every pair at every step.

use super::{Engine, IndexPair, Near};
use nalgebra::Isometry3;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// A pair and how fast it can close in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SweptPair {
    /// Which two.
    pub pair: IndexPair,
    /// Meters per step that their distance changes at most.
    pub speed: f64,
}

/// A motion in equal steps, and what is asked of it.
#[derive(Clone, Copy, Debug)]
pub struct LineQuery<'a> {
    /// The pairs that matter.
    pub pairs: &'a [SweptPair],
    /// Number of steps; samples are at 0 to `steps`, both ends included.
    pub steps: u32,
    /// Nearer than this, or as near, meters, is not free.
    pub clearance: f64,
    /// Distances are measured up to here, meters; not below the clearance.
    pub cap: f64,
    /// Whether to go on to the end where it is not free, to find the smallest distance of all.
    pub whole: bool,
}

/// What came of a motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineResult {
    /// The smallest distance at any sample looked at, meters; the query's cap if none is below that.
    pub min_distance: f64,
    /// The pair of `min_distance`, unless that is the cap.
    pub pair: Option<IndexPair>,
    /// The first step at which the motion is not free.
    pub hit: Option<u32>,
}

/// See [`Engine::line`].
pub(super) fn advance<E: Engine>(
    engine: &E,
    query: &LineQuery<'_>,
    mut frames_at: impl FnMut(u32, &mut Vec<Isometry3<f64>>),
) -> LineResult {
    let mut result = LineResult { min_distance: query.cap, pair: None, hit: None };
    // Pairs by the step at which they must be looked at next: all of them at the first.
    let mut pending: BinaryHeap<Reverse<(u32, u32)>> = (0..query.pairs.len() as u32).map(|p| Reverse((0, p))).collect();
    let (mut frames, mut placement) = (Vec::new(), E::Placement::default());
    let mut placed_at = None;
    while let Some(Reverse((step, p))) = pending.pop() {
        if placed_at != Some(step) {
            // Only between samples, so that the first hit is told with the nearest pair of its sample.
            if !query.whole && result.hit.is_some() {
                break;
            }
            placed_at = Some(step);
            frames_at(step, &mut frames);
            engine.place_frames(&frames, &mut placement);
        }
        let SweptPair { pair, speed } = query.pairs[p as usize];
        engine.place_pair(&mut placement, pair);
        let distance = match engine.near(&placement, pair, result.min_distance) {
            Near::Within(near) => {
                if near.distance < result.min_distance || result.pair.is_none() {
                    (result.min_distance, result.pair) = (near.distance, Some(pair));
                }
                if near.distance <= query.clearance {
                    result.hit = result.hit.or(Some(step));
                }
                near.distance
            }
            Near::Beyond(distance) => distance,
        };
        // Until it can have come below the smallest distance so far, it does not matter. Rounded down, so that rounding
        // looks too early and never too late; at least one step, so that the motion gets on.
        let idle = ((distance - result.min_distance) / speed).floor();
        if speed > 0.0 && idle < f64::from(query.steps - step) {
            pending.push(Reverse((step + (idle.max(0.0) as u32).max(1), p)));
        }
    }
    result
}
