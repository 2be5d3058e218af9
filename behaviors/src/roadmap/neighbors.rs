//! Nearest neighbors in joint space, behind one interface: a kd-tree up to ten dimensions, a flat scan above and where motors turn
//! without end.
//!
//! Both answer alike: exact distances, equal distances ordered by id. A run therefore does not depend on which
//! of them serves it, nor on the order in which points came.

use crate::short_way::JointMetric;
use kiddo::{MutableKdTree, SquaredEuclidean};
use std::collections::BTreeMap;
use std::num::NonZero;

/// Points with ids, asked for those nearest to a query. Distances are those of a [`JointMetric`], rad.
pub trait Neighbors: Send {
    /// Adds a point, or moves the one that has this id. Missing coordinates count as 0, surplus ones are ignored.
    fn add(&mut self, id: u32, q: &[f64]);
    /// Takes a point out; an unknown id changes nothing.
    fn remove(&mut self, id: u32);
    /// The `k` nearest points as (distance, id), nearest first, equal distances by id; all of them if there are fewer.
    fn knn(&self, q: &[f64], k: usize) -> Vec<(f64, u32)>;
    /// How many points there are.
    fn len(&self) -> usize;
    /// Whether there are none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// The structure that suits a dimension: kd-trees lose to a plain scan above about ten (kiddo's own advice, measured), and know no
/// metric but the plain one.
pub fn neighbors(dimension: usize, metric: &JointMetric) -> Box<dyn Neighbors> {
    let flat = || Box::new(Flat { metric: metric.clone(), ..Flat::default() });
    if !metric.is_plain() {
        return flat();
    }
    macro_rules! by_dimension {
        ($($n:literal)*) => {
            match dimension {
                $($n => Box::new(Tree::<$n>::default()),)*
                _ => flat(),
            }
        };
    }
    by_dimension!(1 2 3 4 5 6 7 8 9 10)
}

/// Looks at every point: the right thing in many dimensions, and the reference for the tree.
#[derive(Clone, Debug, Default)]
pub struct Flat {
    metric: JointMetric,
    points: BTreeMap<u32, Vec<f64>>,
}

impl Neighbors for Flat {
    fn add(&mut self, id: u32, q: &[f64]) {
        self.points.insert(id, q.to_vec());
    }

    fn remove(&mut self, id: u32) {
        self.points.remove(&id);
    }

    fn knn(&self, q: &[f64], k: usize) -> Vec<(f64, u32)> {
        nearest(self.points.iter().map(|(id, p)| (self.metric.distance(p, q), *id)).collect(), k)
    }

    fn len(&self) -> usize {
        self.points.len()
    }
}

/// A kd-tree over the same points.
///
/// kiddo's mutable tree can't split a leaf whose points share a coordinate (locked motors, repeated poses, grids), so
/// the tree sees every coordinate shifted by up to [`JITTER`]; answers are taken from the unshifted points. Should it refuse a
/// point all the same, the tree is given up for the scan: no point is ever lost.
struct Tree<const N: usize> {
    flat: Flat,
    tree: Option<MutableKdTree<f64, N>>,
}

/// How far the tree's copy of a point may lie from the point, per coordinate.
const JITTER: f64 = 1e-9;

impl<const N: usize> Default for Tree<N> {
    fn default() -> Self {
        Tree { flat: Flat::default(), tree: Some(MutableKdTree::default()) }
    }
}

impl<const N: usize> Neighbors for Tree<N> {
    fn add(&mut self, id: u32, q: &[f64]) {
        self.remove(id);
        let q = fixed::<N>(q);
        self.flat.add(id, &q);
        if let Some(tree) = &mut self.tree
            && (q.iter().any(|c| !c.is_finite()) || tree.add(&shifted(id, &q), id).is_err())
        {
            self.tree = None;
        }
    }

    fn remove(&mut self, id: u32) {
        let Some(q) = self.flat.points.remove(&id) else { return };
        if let Some(tree) = &mut self.tree {
            tree.remove(&shifted(id, &fixed::<N>(&q)), id);
        }
    }

    fn knn(&self, q: &[f64], k: usize) -> Vec<(f64, u32)> {
        let q = fixed::<N>(q);
        let (Some(tree), Some(wanted)) = (&self.tree, NonZero::new(k)) else { return self.flat.knn(&q, k) };
        if k >= self.len() || q.iter().any(|c| !c.is_finite()) {
            return self.flat.knn(&q, k);
        }
        // The shift may have swapped near-equal points, so take everything within the k-th distance and sort it anew.
        let found = tree.query(&q).nearest_n::<SquaredEuclidean<f64>>(wanted).execute();
        let reach = found.iter().map(|f| f.distance).fold(0.0, f64::max).sqrt() + 4.0 * JITTER * (N as f64).sqrt();
        let near = tree.query(&q).within::<SquaredEuclidean<f64>>(reach * reach).unsorted().execute();
        let exact = |id: u32| self.flat.points.get(&id).map(|p| (self.flat.metric.distance(p, &q), id));
        nearest(near.iter().filter_map(|f| exact(f.item)).collect(), k)
    }

    fn len(&self) -> usize {
        self.flat.len()
    }
}

fn nearest(mut all: Vec<(f64, u32)>, k: usize) -> Vec<(f64, u32)> {
    all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    all.truncate(k);
    all
}

fn fixed<const N: usize>(q: &[f64]) -> [f64; N] {
    let mut out = [0.0; N];
    out.iter_mut().zip(q).for_each(|(o, c)| *o = *c);
    out
}

/// The tree's copy of a point: a fixed function of id and coordinate, so that it can be found again for removal.
fn shifted<const N: usize>(id: u32, q: &[f64; N]) -> [f64; N] {
    let mut out = *q;
    for (i, c) in out.iter_mut().enumerate() {
        // splitmix64: neighboring ids get unrelated shifts
        let mut z = (u64::from(id) << 8 | i as u64).wrapping_add(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        let unit = ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64;
        *c += JITTER * (2.0 * unit - 1.0);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Points of some dimension whose coordinates are free, on a grid, or constant, with many repeats.
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
        fn order_of_arrival_does_not_matter((d, all, q) in points(), k in 1usize..12) {
            let plain = JointMetric::default();
            let (mut forward, mut backward) = (neighbors(d, &plain), neighbors(d, &plain));
            all.iter().enumerate().for_each(|(i, p)| forward.add(i as u32, p));
            all.iter().enumerate().rev().for_each(|(i, p)| backward.add(i as u32, p));
            prop_assert_eq!(forward.knn(&q, k), backward.knn(&q, k));
        }
    }

    #[test]
    fn a_thousand_points_that_share_six_of_seven_coordinates_are_all_kept() {
        let mut tree = Tree::<7>::default();
        (0..1000).for_each(|i| tree.add(i, &[f64::from(i), 0.5, 0.5, 0.5, 0.5, 0.5, 0.5]));
        assert!(tree.tree.is_some(), "the tree had to be given up");
        assert_eq!(tree.knn(&[2.0, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5], 1000).len(), 1000);
        assert_eq!(
            tree.knn(&[2.1, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5], 3).iter().map(|n| n.1).collect::<Vec<_>>(),
            [2, 3, 1]
        );
    }
}
