//! Path smoother: shortens a path by shortcuts and by cutting its corners.
//!
//! Each round removes unneeded waypoints, cuts the corners, and then tries lines between random
//! points of the path (Geraerts and Overmars, *Creating High-quality Paths for Motion Planning*,
//! 2007). Lines are only sampled, and the resulting path is certified as a whole. If lines of it are
//! refuted, the rounds are repeated without them.

use super::{JointPath, JointSpace, between};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Maximum number of rounds.
const MAX_ROUNDS: usize = 16;
/// Maximum number of paths of sampled lines; if all are refuted, each line is certified before it is
/// accepted.
const MAX_SAMPLED: usize = 4;
/// Minimum gain of a round, as a share of the path's length, for another round.
const MIN_ROUND_GAIN: f64 = 0.02;
/// Number of shortcuts between random points tried in a round.
const RANDOM_SHORTCUTS: usize = 8;
/// Minimum gain of a shortcut, as a share of the path's length, or of a cut, as a share of the
/// shorter line.
const MIN_GAIN: f64 = 1e-3;
/// Distances from a corner at which it is cut, as shares of the shorter of its two lines; the first
/// free cut is used.
const CUT_SHARES: [f64; 4] = [1.0, 0.5, 0.25, 0.125];
/// Maximum number of waypoints; no more are added beyond it.
const MAX_WAYPOINTS: usize = 64;

/// Returns a path with the same ends that is not longer, by the weights of the space
/// ([`JointSpace::weights`]), with straight lines that are all certified free.
///
/// # Arguments
/// * `path`: a certified path of this space.
/// * `budget`: maximum number of straight lines that may be checked.
pub fn shorten(space: &mut JointSpace, path: JointPath, seed: u64, budget: u64) -> JointPath {
    let begun = space.evaluations();
    let end = begun.saturating_add(budget);
    let before = path.evaluations;
    let goal = path.goal;
    let mut shortener =
        Shortener { space, end, rng: ChaCha8Rng::seed_from_u64(seed), certifies: false, seed, refuted: Vec::new() };
    let poses = (0..MAX_SAMPLED).find_map(|_| shortener.sampled(&path.poses));
    let poses = poses.unwrap_or_else(|| shortener.certified(path.poses));
    JointPath { poses, goal, evaluations: before + space.evaluations() - begun }
}

struct Shortener<'a> {
    space: &'a mut JointSpace,
    /// The space's count of evaluations at which it ends.
    end: u64,
    rng: ChaCha8Rng,
    seed: u64,
    /// Whether each line is certified before it is accepted.
    certifies: bool,
    /// Lines whose samples were free but that were not certified.
    refuted: Vec<[Vec<f64>; 2]>,
}

impl Shortener<'_> {
    /// Returns the path of rounds in which lines are only sampled, once it is certified; `None` if lines of it are refuted,
    /// which are then excluded.
    fn sampled(&mut self, path: &[Vec<f64>]) -> Option<Vec<Vec<f64>>> {
        self.rng = ChaCha8Rng::seed_from_u64(self.seed);
        let mut best = path.to_vec();
        for round in 0..MAX_ROUNDS {
            let whole = self.length(&best);
            let poses = self.round(&best, round);
            let length = self.length(&poses);
            if length < whole {
                best = poses;
            }
            if length > whole * (1.0 - MIN_ROUND_GAIN) {
                break;
            }
        }
        if best == path || !self.affords(best.len() as u64) {
            return Some(path.to_vec());
        }
        let lines = best.windows(2).map(|w| (w[0].as_slice(), w[1].as_slice()));
        let free = self.space.path_lines_free(lines);
        let before = self.refuted.len();
        let refuted = best.windows(2).zip(free).filter(|(_, free)| !free);
        self.refuted.extend(refuted.map(|(w, _)| [w[0].clone(), w[1].clone()]));
        (self.refuted.len() == before).then_some(best)
    }

    /// Returns the path of rounds in which each line is certified.
    fn certified(&mut self, path: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
        self.certifies = true;
        let mut best = path;
        for round in 0..MAX_ROUNDS {
            let whole = self.length(&best);
            let poses = self.round(&best, round);
            let length = self.length(&poses);
            if length >= whole || !self.is_certified(&poses) {
                break;
            }
            best = poses;
            if length > whole * (1.0 - MIN_ROUND_GAIN) {
                break;
            }
        }
        best
    }

    /// Returns the path after a round.
    fn round(&mut self, path: &[Vec<f64>], round: usize) -> Vec<Vec<f64>> {
        let mut poses = path.to_vec();
        // In later rounds cuts have the effect of skips.
        if round == 0 {
            self.skip(&mut poses);
        }
        self.cut_corners(&mut poses);
        self.cut_across(&mut poses);
        poses.dedup();
        poses
    }

    /// Returns whether the budget allows this number of further lines.
    fn affords(&self, lines: u64) -> bool {
        self.space.evaluations().saturating_add(lines) <= self.end
    }

    fn length(&self, poses: &[Vec<f64>]) -> f64 {
        poses.windows(2).map(|w| self.space.weighted(&w[0], &w[1])).sum()
    }

    /// Returns whether a line is free; `false` once the budget is spent.
    fn is_free(&mut self, from: &[f64], to: &[f64]) -> bool {
        // The rest of the budget must suffice to certify the path.
        let affordable = self.space.evaluations().saturating_add(MAX_WAYPOINTS as u64) < self.end;
        if self.refuted.iter().any(|[a, b]| on_line(a, from, to) && on_line(b, from, to)) {
            return false;
        }
        affordable
            && if self.certifies { self.space.is_easily_free(from, to) } else { self.space.samples_free(from, to) }
    }

    fn is_certified(&mut self, poses: &[Vec<f64>]) -> bool {
        self.affords(poses.len() as u64)
            && self.space.all_free(poses.windows(2).map(|w| (w[0].as_slice(), w[1].as_slice())))
    }

    /// Replaces each waypoint's successors by a straight line to the last one that it can reach.
    fn skip(&mut self, poses: &mut Vec<Vec<f64>>) {
        let mut at = 0;
        while at + 2 < poses.len() {
            let far = (at + 2..poses.len()).rev().find(|next| {
                let from = poses[at].as_slice();
                let to = poses[*next].as_slice();
                self.is_free(from, to)
            });
            if let Some(next) = far {
                poses.drain(at + 1..next);
            }
            at += 1;
        }
    }

    /// Cuts each corner at equal distances from it, as far out as the line between the two points
    /// is free.
    fn cut_corners(&mut self, poses: &mut Vec<Vec<f64>>) {
        let mut at = 1;
        while at + 1 < poses.len() {
            let before = &poses[at - 1];
            let corner = &poses[at];
            let after = &poses[at + 1];
            let ways = [before, after].map(|end| self.space.weighted(corner, end));
            let shorter = ways[0].min(ways[1]);
            let cut = CUT_SHARES.iter().find_map(|share| {
                let [x, y] = [(before, ways[0]), (after, ways[1])].map(|(end, way)| {
                    if shorter * share < way { between(corner, end, shorter * share / way) } else { end.clone() }
                });
                let gain = 2.0 * shorter * share - self.space.weighted(&x, &y);
                (gain > MIN_GAIN * shorter && self.is_free(&x, &y)).then_some([x, y])
            });
            match cut {
                Some(points) if poses.len() < MAX_WAYPOINTS => {
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

    /// Tries lines between random points of the path.
    fn cut_across(&mut self, poses: &mut Vec<Vec<f64>>) {
        for _ in 0..RANDOM_SHORTCUTS {
            if poses.len() < 3 || poses.len() > MAX_WAYPOINTS {
                return;
            }
            let ends: Vec<f64> = std::iter::once(0.0)
                .chain(poses.windows(2).scan(0.0, |sum, w| {
                    *sum += self.space.weighted(&w[0], &w[1]);
                    Some(*sum)
                }))
                .collect();
            let total = ends.last().copied().unwrap_or(0.0);
            let a = self.rng.random_range(0.0..=total);
            let b = self.rng.random_range(0.0..=total);
            let from = a.min(b);
            let to = a.max(b);
            // The point of the path, and the index of the waypoint before it.
            let place = |at: f64| {
                let i = ends.partition_point(|end| *end <= at).clamp(1, poses.len() - 1) - 1;
                let way = ends[i + 1] - ends[i];
                (i, between(&poses[i], &poses[i + 1], if way > 0.0 { (at - ends[i]) / way } else { 0.0 }))
            };
            let (i, p) = place(from);
            let (j, q) = place(to);
            let gain = (to - from) - self.space.weighted(&p, &q);
            if i < j && gain > MIN_GAIN * total && self.is_free(&p, &q) {
                poses.splice(i + 1..=j, [p, q]);
            }
        }
    }
}

/// Returns whether a configuration is on a straight line, except for rounding.
fn on_line(q: &[f64], from: &[f64], to: &[f64]) -> bool {
    let along: f64 = from.iter().zip(to).zip(q).map(|((a, b), q)| (q - a) * (b - a)).sum();
    let squared: f64 = from.iter().zip(to).map(|(a, b)| (b - a) * (b - a)).sum();
    let share = along / squared.max(1e-12);
    (-1e-6..=1.0 + 1e-6).contains(&share)
        && from.iter().zip(to).zip(q).all(|((a, b), q)| (a + (b - a) * share - q).abs() < 1e-6)
}
