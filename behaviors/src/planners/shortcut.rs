//! A smoother: makes a path shorter by shortcuts.
//!
//! First the shortest way over the path's own way-points: all straight lines between them that are free. Then lines between
//! random points of it (Geraerts and Overmars, *Creating High-quality Paths for Motion Planning*, 2007), as long as they gain something.

use super::{JointPath, JointSpace, apart, between};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Shortcuts that are tried at once, of which the best is taken.
const WIDTH: usize = 5;
/// Rounds of random shortcuts, and how many in a row may gain nothing.
const ROUNDS: usize = 40;
const IN_VAIN: usize = 3;
/// The share of the path's length that a shortcut must gain.
const GAIN: f64 = 1e-3;
/// Way-points beyond which the lines between all of them are too many.
const MOST_POINTS: usize = 64;

/// A path with the same ends that is no longer, and whose straight lines are all certified free.
///
/// # Arguments
/// * `path`: of this space, certified.
/// * `budget`: the most straight lines that may be judged.
pub fn shorten(space: &mut JointSpace, path: JointPath, seed: u64, budget: u64) -> JointPath {
    let begun = space.evaluations();
    let end = begun.saturating_add(budget);
    let before = path.evaluations;
    let mut poses = over_its_points(space, path.poses, end);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut in_vain = 0;
    for _ in 0..ROUNDS {
        if in_vain >= IN_VAIN || poses.len() < 3 {
            break;
        }
        let Some(shorter) = best_shortcut(space, &poses, &mut rng, end) else { break };
        match shorter {
            Some(shorter) => (poses, in_vain) = (shorter, 0),
            None => in_vain += 1,
        }
    }
    JointPath { poses, evaluations: before + space.evaluations() - begun }
}

/// The shortest way over some of the way-points, in their order (dynamic programming).
fn over_its_points(space: &mut JointSpace, poses: Vec<Vec<f64>>, end: u64) -> Vec<Vec<f64>> {
    let n = poses.len();
    let lines: Vec<(usize, usize)> = (0..n).flat_map(|i| (i + 2..n).map(move |j| (i, j))).collect();
    if n > MOST_POINTS || space.evaluations().saturating_add(lines.len() as u64) > end {
        return poses;
    }
    // in the turn that the path has there, or the poses behind a shortcut would be in another
    let far = |(i, j): (usize, usize)| apart(&poses[i], &poses[j]);
    let free = space.free_lines(lines.iter().map(|(i, j)| (poses[*i].as_slice(), poses[*j].as_slice())));
    let mut ways: Vec<Vec<usize>> = (0..n).map(|j| j.checked_sub(1).into_iter().collect()).collect();
    for ((i, j), _) in lines.iter().zip(free).filter(|(_, free)| *free) {
        ways[*j].push(*i);
    }
    let mut best: Vec<(f64, usize)> = vec![(0.0, 0)];
    for j in 1..n {
        let reached = ways[j].iter().map(|i| (best[*i].0 + far((*i, j)), *i));
        best.push(reached.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))).unwrap_or((f64::INFINITY, j - 1)));
    }
    let mut kept = vec![n - 1];
    while let Some(at) = kept.last().copied().filter(|at| *at > 0) {
        kept.push(best[at].1);
    }
    kept.into_iter().rev().map(|i| poses[i].clone()).collect()
}

/// The path with the best of a few random shortcuts, if any is free and gains something. `None` if they cost too much.
fn best_shortcut(
    space: &mut JointSpace,
    poses: &[Vec<f64>],
    rng: &mut ChaCha8Rng,
    end: u64,
) -> Option<Option<Vec<Vec<f64>>>> {
    let lengths: Vec<f64> = poses.windows(2).map(|w| apart(&w[0], &w[1])).collect();
    let total: f64 = lengths.iter().sum();
    // where on the path, and the index of the way-point before it
    let place = |at: f64| {
        let (mut i, mut rest) = (0, at);
        while i + 1 < lengths.len() && rest > lengths[i] {
            rest -= lengths[i];
            i += 1;
        }
        let share = if lengths[i] > 0.0 { (rest / lengths[i]).min(1.0) } else { 0.0 };
        (i, between(&poses[i], &poses[i + 1], share))
    };
    let mut tries: Vec<(f64, Vec<Vec<f64>>, usize, usize)> = Vec::new();
    for _ in 0..WIDTH {
        let (a, b) = (rng.random_range(0.0..=total), rng.random_range(0.0..=total));
        let (from, to) = (a.min(b), a.max(b));
        let ((i, p), (j, q)) = (place(from), place(to));
        let gain = (to - from) - apart(&p, &q);
        if i < j && gain > GAIN * total {
            tries.push((gain, vec![poses[i].clone(), p, q, poses[j + 1].clone()], i, j));
        }
    }
    let lines = 3 * tries.len();
    if space.evaluations().saturating_add(lines as u64) > end {
        return None;
    }
    let edges = tries.iter().flat_map(|(_, new, ..)| new.windows(2).map(|w| (w[0].as_slice(), w[1].as_slice())));
    let free: Vec<bool> = space.free_lines(edges).chunks(3).map(|three| three.iter().all(|free| *free)).collect();
    let good = tries.into_iter().zip(free).filter(|(_, free)| *free).map(|(try_, _)| try_);
    let best = good.reduce(|a, b| if b.0 > a.0 { b } else { a });
    Some(best.map(|(_, new, i, j)| {
        let mut shorter = poses[..=i].to_vec();
        shorter.extend(new.into_iter().skip(1).take(2));
        shorter.extend_from_slice(&poses[j + 1..]);
        shorter.dedup();
        shorter
    }))
}
