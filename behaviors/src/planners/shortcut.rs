//! A smoother: makes a path shorter by shortcuts and by cutting its corners.
//!
//! In each round the path skips way-points that it does not need, then its corners are cut, then lines are tried between random points of
//! it (Geraerts and Overmars, *Creating High-quality Paths for Motion Planning*, 2007). A new line is taken if it is certified without
//! much ado. Cuts leave parts of lines, which differ from the lines by rounding, so each round's path is certified as a whole as well.

use super::{JointPath, JointSpace, between};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Rounds at most, and the share of the path's length that a round must gain for another one.
const ROUNDS: usize = 16;
const ROUND_GAIN: f64 = 5e-3;
/// Shortcuts between random points that are tried in a round, and the share of the path's length that one must gain.
const RANDOM: usize = 8;
const GAIN: f64 = 1e-3;
/// Shares of the shorter of its two lines at which a corner is cut, the first that is free.
const CUTS: [f64; 4] = [1.0, 0.5, 0.25, 0.125];
/// Way-points beyond which no further ones are made.
const MOST_POINTS: usize = 64;

/// A path with the same ends that is no longer, by the weights of the space ([`JointSpace::weights`]), and whose straight lines are all
/// certified free.
///
/// # Arguments
/// * `path`: of this space, certified.
/// * `budget`: the most straight lines that may be judged.
pub fn shorten(space: &mut JointSpace, path: JointPath, seed: u64, budget: u64) -> JointPath {
    let begun = space.evaluations();
    let end = begun.saturating_add(budget);
    let before = path.evaluations;
    let mut best = path.poses;
    let mut shortener = Shortener { space, end, rng: ChaCha8Rng::seed_from_u64(seed) };
    for round in 0..ROUNDS {
        let whole = shortener.length(&best);
        let mut poses = best.clone();
        // Later on cuts do what skips can.
        if round == 0 {
            shortener.skip(&mut poses);
        }
        shortener.cut_corners(&mut poses);
        shortener.cut_across(&mut poses);
        poses.dedup();
        let length = shortener.length(&poses);
        if length >= whole {
            break;
        }
        if !shortener.is_certified(&poses) {
            break;
        }
        best = poses;
        if length > whole * (1.0 - ROUND_GAIN) {
            break;
        }
    }
    JointPath { poses: best, evaluations: before + space.evaluations() - begun }
}

struct Shortener<'a> {
    space: &'a mut JointSpace,
    /// The space's count of evaluations at which it ends.
    end: u64,
    rng: ChaCha8Rng,
}

impl Shortener<'_> {
    fn length(&self, poses: &[Vec<f64>]) -> f64 {
        poses.windows(2).map(|w| self.space.weighted(&w[0], &w[1])).sum()
    }

    /// Whether a line is free; none is once the budget is spent.
    fn is_free(&mut self, from: &[f64], to: &[f64]) -> bool {
        // What is left must be enough to certify the path.
        let affordable = self.space.evaluations().saturating_add(MOST_POINTS as u64) < self.end;
        affordable && self.space.is_easily_free(from, to)
    }

    fn is_certified(&mut self, poses: &[Vec<f64>]) -> bool {
        let lines = poses.len().saturating_sub(1) as u64;
        let affordable = self.space.evaluations().saturating_add(lines) <= self.end;
        affordable && self.space.all_free(poses.windows(2).map(|w| (w[0].as_slice(), w[1].as_slice())))
    }

    /// From each way-point straight to the last one that it can reach.
    fn skip(&mut self, poses: &mut Vec<Vec<f64>>) {
        let mut at = 0;
        while at + 2 < poses.len() {
            let far = (at + 2..poses.len()).rev().find(|next| {
                let (from, to) = (poses[at].as_slice(), poses[*next].as_slice());
                self.is_free(from, to)
            });
            if let Some(next) = far {
                poses.drain(at + 1..next);
            }
            at += 1;
        }
    }

    /// Cuts each corner at points that are equally far from it, as far out as the line between them is free.
    fn cut_corners(&mut self, poses: &mut Vec<Vec<f64>>) {
        let mut at = 1;
        while at + 1 < poses.len() {
            let (before, corner, after) = (&poses[at - 1], &poses[at], &poses[at + 1]);
            let ways = [before, after].map(|end| self.space.weighted(corner, end));
            let shorter = ways[0].min(ways[1]);
            let cut = CUTS.iter().find_map(|share| {
                let [x, y] = [(before, ways[0]), (after, ways[1])].map(|(end, way)| {
                    if shorter * share < way { between(corner, end, shorter * share / way) } else { end.clone() }
                });
                let gain = 2.0 * shorter * share - self.space.weighted(&x, &y);
                (gain > GAIN * shorter && self.is_free(&x, &y)).then_some([x, y])
            });
            match cut {
                Some(points) if poses.len() < MOST_POINTS => {
                    let new: Vec<Vec<f64>> =
                        points.into_iter().filter(|p| *p != poses[at - 1] && *p != poses[at + 1]).collect();
                    let count = new.len();
                    poses.splice(at..=at, new);
                    at += count.max(1);
                }
                _ => at += 1,
            }
        }
    }

    /// Lines between random points of the path.
    fn cut_across(&mut self, poses: &mut Vec<Vec<f64>>) {
        for _ in 0..RANDOM {
            if poses.len() < 3 || poses.len() > MOST_POINTS {
                return;
            }
            let ends: Vec<f64> = std::iter::once(0.0)
                .chain(poses.windows(2).scan(0.0, |sum, w| {
                    *sum += self.space.weighted(&w[0], &w[1]);
                    Some(*sum)
                }))
                .collect();
            let total = ends.last().copied().unwrap_or(0.0);
            let (a, b) = (self.rng.random_range(0.0..=total), self.rng.random_range(0.0..=total));
            let (from, to) = (a.min(b), a.max(b));
            // Where on the path, and the index of the way-point before it.
            let place = |at: f64| {
                let i = ends.partition_point(|end| *end <= at).clamp(1, poses.len() - 1) - 1;
                let way = ends[i + 1] - ends[i];
                (i, between(&poses[i], &poses[i + 1], if way > 0.0 { (at - ends[i]) / way } else { 0.0 }))
            };
            let ((i, p), (j, q)) = (place(from), place(to));
            let gain = (to - from) - self.space.weighted(&p, &q);
            if i < j && gain > GAIN * total && self.is_free(&p, &q) {
                poses.splice(i + 1..=j, [p, q]);
            }
        }
    }
}
