//! A kd-tree for few dimensions.

use super::{Flat, Neighbors, nearest};
use crate::short_way::JointMetric;
use kiddo::{MutableKdTree, SquaredEuclidean};
use std::num::NonZero;

/// A kd-tree over the same points.
///
/// kiddo's mutable tree can't split a leaf of points that share a coordinate (locked motors,
/// repeated configurations, grids). Therefore the tree contains every coordinate shifted by up to
/// [`JITTER`]; results use the unshifted points. If the tree still rejects a point, it is replaced
/// by the scan, so no point is ever lost.
pub(super) struct PointTree<const N: usize> {
    flat: Flat,
    pub(super) tree: Option<MutableKdTree<f64, N>>,
}

/// Maximum shift of each coordinate in the tree's copy of a point.
const JITTER: f64 = 1e-9;

impl<const N: usize> Default for PointTree<N> {
    fn default() -> Self {
        PointTree { flat: Flat::new(N, &JointMetric::default()), tree: Some(MutableKdTree::default()) }
    }
}

impl<const N: usize> Neighbors for PointTree<N> {
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
        let Some(q) = self.flat.point(id).map(fixed::<N>) else { return };
        self.flat.remove(id);
        if let Some(tree) = &mut self.tree {
            tree.remove(&shifted(id, &q), id);
        }
    }

    fn knn(&self, q: &[f64], k: usize) -> Vec<(f64, u32)> {
        let q = fixed::<N>(q);
        let (Some(tree), Some(wanted)) = (&self.tree, NonZero::new(k)) else { return self.flat.knn(&q, k) };
        if k >= self.len() || q.iter().any(|c| !c.is_finite()) {
            return self.flat.knn(&q, k);
        }
        // The shift may have swapped points at almost equal distances, so take all points within
        // the k-th distance and sort them again.
        let found = tree.query(&q).nearest_n::<SquaredEuclidean<f64>>(wanted).execute();
        let reach = found.iter().map(|f| f.distance).fold(0.0, f64::max).sqrt() + 4.0 * JITTER * (N as f64).sqrt();
        let near = tree.query(&q).within::<SquaredEuclidean<f64>>(reach * reach).unsorted().execute();
        nearest(near.iter().filter_map(|f| Some((self.flat.distance(f.item, &q)?, f.item))).collect(), k)
    }

    fn knn_all(&self, k: usize) -> Vec<(u32, Vec<(f64, u32)>)> {
        self.flat.knn_all(k)
    }

    fn len(&self) -> usize {
        self.flat.len()
    }
}

fn fixed<const N: usize>(q: &[f64]) -> [f64; N] {
    let mut out = [0.0; N];
    out.iter_mut().zip(q).for_each(|(o, c)| *o = *c);
    out
}

/// Returns the tree's copy of a point: a fixed function of id and coordinate, so that it can be
/// found again for removal.
fn shifted<const N: usize>(id: u32, q: &[f64; N]) -> [f64; N] {
    let mut out = *q;
    for (i, c) in out.iter_mut().enumerate() {
        // splitmix64: consecutive ids get unrelated shifts.
        let mut z = (u64::from(id) << 8 | i as u64).wrapping_add(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        let unit = ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64;
        *c += JITTER * (2.0 * unit - 1.0);
    }
    out
}
