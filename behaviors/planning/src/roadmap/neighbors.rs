//! Nearest neighbors in joint space, behind one interface: a kd-tree in few dimensions, a linear
//! scan in more and with continuous joints.
//!
//! Both return identical results: exact distances, equal distances ordered by id. A run therefore
//! depends neither on the structure nor on the order of insertion.

mod flat;
mod tree;

pub use flat::Flat;

use crate::short_way::JointMetric;
use tree::PointTree;

/// A set of points with ids, for nearest-neighbor queries. Distances are those of a
/// [`JointMetric`], rad.
pub trait Neighbors: Send {
    /// Adds a point, or moves the point with this id. Missing coordinates count as 0, surplus ones
    /// are ignored.
    fn add(&mut self, id: u32, q: &[f64]);
    /// Removes a point. No-op for an unknown id.
    fn remove(&mut self, id: u32);
    /// Returns the `k` nearest points as (distance, id), nearest first, equal distances by id; all
    /// of them if there are fewer.
    fn knn(&self, q: &[f64], k: usize) -> Vec<(f64, u32)>;
    /// Returns, for every point by id, its `k` nearest others, as [`Neighbors::knn`].
    fn knn_all(&self, k: usize) -> Vec<(u32, Vec<(f64, u32)>)>;
    /// Number of points.
    fn len(&self) -> usize;
    /// Returns whether there are no points.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Creates the structure suitable for a dimension: kd-trees are slower than a linear scan above
/// about ten dimensions (kiddo's own advice, measured), and support only the plain metric.
pub fn neighbors(dimension: usize, metric: &JointMetric) -> Box<dyn Neighbors> {
    let flat = || Box::new(Flat::new(dimension, metric));
    if !metric.is_plain() {
        return flat();
    }
    macro_rules! by_dimension {
        ($($n:literal)*) => {
            match dimension {
                $($n => Box::new(PointTree::<$n>::default()),)*
                _ => flat(),
            }
        };
    }
    by_dimension!(1 2 3 4 5 6 7 8 9 10)
}

/// Sorts by distance, then by id, and returns the first `k`.
fn nearest(mut all: Vec<(f64, u32)>, k: usize) -> Vec<(f64, u32)> {
    all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    all.truncate(k);
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use mobee_model::Motor;
    use proptest::prelude::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use std::collections::BTreeMap;

    fn motor() -> Motor {
        crate::roadmap::tests::robot(1).motors.remove(0)
    }

    /// Generates points of some dimension with coordinates that are free, on a grid, or constant,
    /// with many repetitions.
    fn points() -> impl Strategy<Value = (usize, Vec<Vec<f64>>, Vec<f64>)> {
        (1usize..13).prop_flat_map(|d| {
            let free = prop::collection::vec(prop::collection::vec(-3.0..3.0f64, d), 0..120);
            let grid = prop::collection::vec(prop::collection::vec((0..3).prop_map(f64::from), d), 0..200);
            let constant = (0..d, free.clone()).prop_map(|(keep, mut all)| {
                all.iter_mut().for_each(|p| p.iter_mut().skip(keep).for_each(|c| *c = 0.25));
                all
            });
            (Just(d), prop_oneof![free, grid, constant], prop::collection::vec(-3.0..3.0f64, d))
        })
    }

    proptest! {
        #[test]
        fn tree_and_scan_agree_with_brute_force((d, all, q) in points(), k in 0usize..15, gone in 0u32..200) {
            let mut tree = neighbors(d, &JointMetric::default());
            all.iter().enumerate().for_each(|(i, p)| tree.add(i as u32, p));
            tree.remove(gone);
            let queries = std::iter::once(&q).chain(all.iter().take(5));
            for q in queries {
                let mut expected: Vec<_> = all
                    .iter()
                    .enumerate()
                    .filter(|(i, _)| *i as u32 != gone)
                    .map(|(i, p)| (p.iter().zip(q).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt(), i as u32))
                    .collect();
                expected.sort_by(|a, b| a.partial_cmp(b).unwrap());
                expected.truncate(k);
                prop_assert_eq!(tree.knn(q, k), expected);
            }
        }

        #[test]
        fn the_scan_agrees_with_brute_force_in_many_dimensions_and_over_the_seam(
            d in 11usize..44, count in 0usize..200, k in 0usize..70, kind in 0u8..4, seed in any::<u64>(), endless in any::<bool>(),
        ) {
            let motor = Motor { continuous: true, min: -60.0, max: 60.0, ..motor() };
            let metric = if endless { JointMetric::of_each((0..d).map(|i| (i % 3 != 1).then_some(&motor))) } else { JointMetric::default() };
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            // Free, on a grid with many repetitions, far out, not finite.
            let mut draw = || match kind {
                0 => rng.random_range(-3.0..3.0),
                1 => f64::from(rng.random_range(0..2)) * 3.0,
                2 => rng.random_range(-60.0..60.0),
                _ => if rng.random_range(0..200) == 0 { f64::NAN } else { rng.random_range(-1e7..1e7) },
            };
            let mut scan = Flat::new(d, &metric);
            let mut points: BTreeMap<u32, Vec<f64>> = BTreeMap::new();
            for i in 0..count as u32 {
                let id = i * 7 % 211;
                let q: Vec<f64> = (0..d).map(|_| draw()).collect();
                scan.add(id, &q);
                points.insert(id, q);
                if i % 5 == 4 {
                    scan.remove(i * 3 % 211);
                    points.remove(&(i * 3 % 211));
                }
            }
            prop_assert_eq!(scan.len(), points.len());
            let truth = |q: &[f64], k: usize, but: Option<u32>| {
                let others = points.iter().filter(|(id, _)| Some(**id) != but);
                nearest(others.map(|(id, p)| (metric.distance(p, q), *id)).collect(), k)
            };
            let bits = |all: &[(f64, u32)]| all.iter().map(|(d, id)| (d.to_bits() << 1, *id)).collect::<Vec<_>>();
            let q: Vec<f64> = (0..d).map(|_| draw()).collect();
            for q in points.values().take(5).chain([&q]) {
                prop_assert_eq!(bits(&scan.knn(q, k)), bits(&truth(q, k, None)));
            }
            let all = scan.knn_all(k);
            prop_assert_eq!(all.iter().map(|(id, _)| *id).collect::<Vec<_>>(), points.keys().copied().collect::<Vec<_>>());
            for (id, near) in &all {
                prop_assert_eq!(bits(near), bits(&truth(&points[id], k, Some(*id))));
            }
        }

        #[test]
        fn order_of_arrival_does_not_matter((d, all, q) in points(), k in 1usize..12) {
            let plain = JointMetric::default();
            let mut forward = neighbors(d, &plain);
            let mut backward = neighbors(d, &plain);
            all.iter().enumerate().for_each(|(i, p)| forward.add(i as u32, p));
            all.iter().enumerate().rev().for_each(|(i, p)| backward.add(i as u32, p));
            prop_assert_eq!(forward.knn(&q, k), backward.knn(&q, k));
        }
    }

    #[test]
    fn a_thousand_points_that_share_six_of_seven_coordinates_are_all_kept() {
        let mut tree = PointTree::<7>::default();
        (0..1000).for_each(|i| tree.add(i, &[f64::from(i), 0.5, 0.5, 0.5, 0.5, 0.5, 0.5]));
        assert!(tree.tree.is_some(), "the tree had to be given up");
        assert_eq!(tree.knn(&[2.0, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5], 1000).len(), 1000);
        assert_eq!(
            tree.knn(&[2.1, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5], 3).iter().map(|n| n.1).collect::<Vec<_>>(),
            [2, 3, 1]
        );
    }
}
