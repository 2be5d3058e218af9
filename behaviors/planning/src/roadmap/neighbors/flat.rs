//! Linear scan over all points, several at once.
//!
//! A copy of the points in `f32` is stored in tiles, each coordinate of sixteen points side by
//! side, so that the loops below compile to vector instructions. The copy is only used to exclude
//! points that can't be among the nearest, with rounding on the safe side; the distances of the
//! others are computed exactly.

use super::{Neighbors, nearest};
use crate::short_way::JointMetric;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Number of points of a tile.
const TILE_POINTS: usize = 16;
/// Number of coordinates after which a tile may be excluded.
const CHECK_INTERVAL: usize = 8;
/// Absolute value beyond which coordinates are handled in exact arithmetic only, like NaN.
const MAX_COORDINATE: f64 = 1e6;
/// Number of neighbors beyond which all points are sorted instead.
const MAX_NEIGHBORS: usize = 64;

/// One number per point of a tile.
type TileRow = [f32; TILE_POINTS];

/// Nearest neighbors by a linear scan: the fastest structure in many dimensions, and the reference
/// for the tree.
#[derive(Clone, Debug, Default)]
pub struct Flat {
    metric: JointMetric,
    dimension: usize,
    /// For each coordinate, `true` if its full turns are ignored; empty if there is no such
    /// coordinate.
    turning: Vec<bool>,
    /// Id of each slot.
    ids: Vec<u32>,
    /// Coordinates of each slot, one after the other.
    points: Vec<f64>,
    slots: BTreeMap<u32, usize>,
    /// Copy in `f32`: `dimension` rows for each tile; infinity in lanes without a point.
    tiles: Vec<TileRow>,
    /// Largest absolute coordinate that was ever added, up to [`MAX_COORDINATE`].
    largest: f64,
    /// Number of points beyond [`MAX_COORDINATE`].
    wild: usize,
}

impl Flat {
    /// Creates an empty set of points with this number of coordinates.
    pub fn new(dimension: usize, metric: &JointMetric) -> Flat {
        let turning = if metric.is_plain() { Vec::new() } else { (0..dimension).map(|i| metric.turns(i)).collect() };
        Flat { metric: metric.clone(), dimension, turning, ..Flat::default() }
    }

    /// Returns a point by its id.
    pub fn point(&self, id: u32) -> Option<&[f64]> {
        self.slots.get(&id).map(|slot| self.at(*slot))
    }

    /// Returns the distance of the point with this id from another point.
    pub fn distance(&self, id: u32, q: &[f64]) -> Option<f64> {
        self.point(id).map(|p| self.metric.distance(p, q))
    }

    fn at(&self, slot: usize) -> &[f64] {
        let from = slot * self.dimension;
        self.points.get(from..from + self.dimension).unwrap_or(&[])
    }

    /// Pads with zeros or truncates to the dimension.
    fn fitted(&self, q: &[f64]) -> Vec<f64> {
        q.iter().copied().chain(std::iter::repeat(0.0)).take(self.dimension).collect()
    }

    /// Converts a coordinate for the copy; for a continuous joint, reduces it to one turn.
    fn copied(&self, i: usize, x: f64) -> f32 {
        if self.turns(i) { (x - (x / TAU).round() * TAU) as f32 } else { x as f32 }
    }

    fn turns(&self, i: usize) -> bool {
        self.turning.get(i).copied().unwrap_or(false)
    }

    /// Writes a slot into the copy; infinity without a point.
    fn copy(&mut self, slot: usize, q: Option<&[f64]>) {
        let first = slot / TILE_POINTS * self.dimension;
        let lane = slot % TILE_POINTS;
        if self.tiles.len() < first + self.dimension {
            self.tiles.resize(first + self.dimension, [f32::INFINITY; TILE_POINTS]);
        }
        for i in 0..self.dimension {
            let x = q.and_then(|q| q.get(i)).map_or(f32::INFINITY, |x| self.copied(i, *x));
            if let Some(x_there) = self.tiles.get_mut(first + i).and_then(|row| row.get_mut(lane)) {
                *x_there = x;
            }
        }
    }

    /// Returns the squared distance in the copy beyond which a point is farther than `distance`,
    /// taking rounding into account.
    ///
    /// The copies of two points differ from them by less than `moved` in total; each of the sums
    /// has an error of less than one rounding per term and a few more.
    fn limit(&self, distance: f64, largest: f64) -> f32 {
        let unit = f64::from(f32::EPSILON);
        let moved = (self.dimension as f64).sqrt() * (self.largest + largest + TAU) * unit;
        let squared = (distance + moved).powi(2) * (1.0 + (self.dimension as f64 + 8.0) * unit);
        squared as f32
    }

    /// Returns the nearest points, all computed in exact arithmetic.
    fn every(&self, q: &[f64], k: usize) -> Vec<(f64, u32)> {
        let all = self.ids.iter().enumerate();
        nearest(all.map(|(slot, id)| (self.metric.distance(self.at(slot), q), *id)).collect(), k)
    }

    /// Returns the rows of a tile.
    fn tile(&self, tile: usize) -> &[TileRow] {
        let from = tile * self.dimension;
        self.tiles.get(from..from + self.dimension).unwrap_or(&[])
    }
}

impl Neighbors for Flat {
    fn add(&mut self, id: u32, q: &[f64]) {
        let q = self.fitted(q);
        self.remove(id);
        let slot = self.ids.len();
        self.ids.push(id);
        self.slots.insert(id, slot);
        self.wild += usize::from(is_wild(&q));
        if !is_wild(&q) {
            self.largest = q.iter().fold(self.largest, |most, x| most.max(x.abs()));
        }
        self.copy(slot, Some(&q));
        self.points.extend(q);
    }

    fn remove(&mut self, id: u32) {
        let Some(slot) = self.slots.remove(&id) else { return };
        self.wild -= usize::from(is_wild(self.at(slot)));
        // The last slot takes its place.
        let last = self.ids.len() - 1;
        let moved = self.at(last).to_vec();
        self.ids.swap_remove(slot);
        self.points.truncate(last * self.dimension);
        self.copy(last, None);
        if let Some(id) = self.ids.get(slot) {
            self.slots.insert(*id, slot);
            self.copy(slot, Some(&moved));
            let from = slot * self.dimension;
            self.points.splice(from..from + self.dimension, moved);
        }
    }

    fn knn(&self, q: &[f64], k: usize) -> Vec<(f64, u32)> {
        let q = self.fitted(q);
        if k >= self.len() || k > MAX_NEIGHBORS || self.wild > 0 || is_wild(&q) {
            return self.every(&q, k);
        }
        let mut best = Best::new(k);
        let largest = q.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
        let copy: Vec<f32> = q.iter().enumerate().map(|(i, x)| self.copied(i, *x)).collect();
        let mut limit = f32::INFINITY;
        for (tile, ids) in self.ids.chunks(TILE_POINTS).enumerate() {
            let Some(squares) = squares(&copy, self.tile(tile), &self.turning, limit) else { continue };
            for (lane, (id, square)) in ids.iter().zip(&squares).enumerate() {
                if *square <= limit && best.offer(self.metric.distance(self.at(tile * TILE_POINTS + lane), &q), *id) {
                    limit = self.limit(best.worst(), largest);
                }
            }
        }
        best.found
    }

    fn knn_all(&self, k: usize) -> Vec<(u32, Vec<(f64, u32)>)> {
        let others = |(id, slot): (&u32, &usize)| {
            let mut near = self.knn(self.at(*slot), k.saturating_add(1));
            near.retain(|(_, other)| other != id);
            near.truncate(k);
            (*id, near)
        };
        self.slots.iter().map(others).collect()
    }

    fn len(&self) -> usize {
        self.ids.len()
    }
}

/// Returns the squared distances of a point from those of a tile; `None` as soon as all exceed the
/// limit.
#[inline(always)]
fn squares(row: &[f32], tile: &[TileRow], turning: &[bool], limit: f32) -> Option<TileRow> {
    let mut sums = [0.0f32; TILE_POINTS];
    for (from, coordinates) in tile.chunks(CHECK_INTERVAL).enumerate() {
        for (i, xs) in coordinates.iter().enumerate() {
            let i = from * CHECK_INTERVAL + i;
            let y = row.get(i).copied().unwrap_or(0.0);
            if turning.get(i).copied().unwrap_or(false) {
                for (sum, x) in sums.iter_mut().zip(xs) {
                    let way = (x - y).abs();
                    let other = TAU as f32 - way;
                    let way = if other < way { other } else { way };
                    *sum += way * way;
                }
            } else {
                for (sum, x) in sums.iter_mut().zip(xs) {
                    *sum += (x - y) * (x - y);
                }
            }
        }
        let mut near = false;
        for sum in &sums {
            near |= *sum <= limit;
        }
        if !near {
            return None;
        }
    }
    Some(sums)
}

/// Returns whether a point is handled in exact arithmetic only.
fn is_wild(q: &[f64]) -> bool {
    q.iter().any(|x| x.is_nan() || x.abs() > MAX_COORDINATE)
}

/// The nearest points so far, in order.
struct Best {
    k: usize,
    found: Vec<(f64, u32)>,
}

impl Best {
    fn new(k: usize) -> Best {
        Best { k, found: Vec::with_capacity(k + 1) }
    }

    /// Offers a point. Returns whether it is among the nearest, and there are enough of them for a
    /// limit.
    fn offer(&mut self, distance: f64, id: u32) -> bool {
        let place = self.found.partition_point(|(d, i)| d.total_cmp(&distance).then(i.cmp(&id)).is_lt());
        if place >= self.k {
            return false;
        }
        self.found.insert(place, (distance, id));
        self.found.truncate(self.k);
        self.found.len() == self.k
    }

    /// Returns the distance of the last one.
    fn worst(&self) -> f64 {
        self.found.last().map_or(f64::INFINITY, |(d, _)| *d)
    }
}
