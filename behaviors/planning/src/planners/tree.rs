//! A tree of configurations that are connected to its root by straight lines.

use super::{JointPath, JointSpace};
use std::f64::consts::TAU;

/// Number of nodes for which distances are computed together.
const BLOCK_SIZE: usize = 16;

/// Adding this to a number below 2^22 and subtracting it rounds the number to a whole one.
const ROUND: f32 = 12_582_912.0;

/// A tree that grows from one end of a problem; from several goals it is a forest. The roots are the first nodes.
pub(super) struct SearchTree {
    /// Configurations one after the other, each in the turn in which it was reached.
    poses: Vec<f64>,
    parents: Vec<u32>,
    /// Cost of each node from the root, by the weights of the space. Only [`SearchTree::add_costed`] sets it.
    costs: Vec<f64>,
    /// Radius of each node's domain: random configurations beyond it are not stepped toward.
    /// Infinite until a step is blocked.
    radii: Vec<f64>,
    near: NearestScan,
    dimension: usize,
    /// Number of roots.
    roots: u32,
}

impl SearchTree {
    /// Creates a tree of its roots alone, one at least.
    pub fn new<'a>(space: &JointSpace, roots: impl IntoIterator<Item = &'a Vec<f64>>) -> SearchTree {
        let near = NearestScan::new(space);
        let mut tree = SearchTree {
            poses: Vec::new(),
            parents: Vec::new(),
            costs: Vec::new(),
            radii: Vec::new(),
            near,
            dimension: space.motors().len(),
            roots: 0,
        };
        for root in roots {
            tree.add(tree.roots, root);
            tree.roots += 1;
        }
        tree
    }

    pub fn len(&self) -> usize {
        self.parents.len()
    }

    pub fn pose(&self, node: u32) -> &[f64] {
        let first = node as usize * self.dimension;
        self.poses.get(first..first + self.dimension).unwrap_or(&[])
    }

    /// Returns the node nearest to a configuration, and its distance by the weights of the space.
    pub fn nearest(&mut self, q: &[f64]) -> (u32, f64) {
        self.near.nearest(q)
    }

    /// Returns the node nearest to a configuration among those from which it costs no more than `cost`; the root if there is none.
    pub fn nearest_within(&mut self, q: &[f64], cost: f64) -> u32 {
        self.near.nearest_within(q, &self.costs, cost)
    }

    /// Returns the cost from the root to a node.
    pub fn cost(&self, node: u32) -> f64 {
        self.costs.get(node as usize).copied().unwrap_or(0.0)
    }

    /// Adds a node with its cost from the root.
    pub fn add_costed(&mut self, parent: u32, pose: &[f64], cost: f64) -> u32 {
        let node = self.add(parent, pose);
        if let Some(slot) = self.costs.get_mut(node as usize) {
            *slot = cost;
        }
        node
    }

    pub fn add(&mut self, parent: u32, pose: &[f64]) -> u32 {
        let node = self.parents.len() as u32;
        self.costs.push(0.0);
        self.poses.extend(pose);
        self.parents.push(parent);
        self.radii.push(f64::INFINITY);
        self.near.add(pose);
        node
    }

    pub fn radius_mut(&mut self, node: u32) -> Option<&mut f64> {
        self.radii.get_mut(node as usize)
    }

    /// Returns the nodes from `node` to its root.
    pub fn to_root(&self, node: u32) -> Vec<u32> {
        let mut path = Vec::new();
        let mut at = node;
        loop {
            path.push(at);
            match self.parents.get(at as usize) {
                Some(parent) if *parent < at => at = *parent,
                _ => return path,
            }
        }
    }

    /// Removes nodes and their descendants. Roots stay.
    pub fn prune(&mut self, cut: &[u32]) {
        let mut kept: Vec<Option<u32>> = Vec::with_capacity(self.len());
        let poses = std::mem::take(&mut self.poses);
        let parents = std::mem::take(&mut self.parents);
        let radii = std::mem::take(&mut self.radii);
        // Only trees without costs are pruned.
        self.costs.clear();
        self.near.clear();
        for (node, ((parent, radius), pose)) in
            parents.iter().zip(radii).zip(poses.chunks(self.dimension.max(1))).enumerate()
        {
            let is_root = node < self.roots as usize;
            let parent = if is_root { Some(node as u32) } else { kept.get(*parent as usize).copied().flatten() };
            let stays = is_root || !cut.contains(&(node as u32));
            let moved = parent.filter(|_| stays).map(|parent| self.add(parent, pose));
            if let Some(slot) = moved.and_then(|node| self.radius_mut(node)) {
                *slot = radius;
            }
            kept.push(moved);
        }
    }
}

/// A path through the nodes at which two trees met, from the root of the first to that of the second, each configuration in the turn
/// nearest to the one before; and the nodes of either tree on it, in the order of the path. Both have the configuration where they met.
pub(super) fn joined(space: &JointSpace, trees: &[SearchTree; 2], met: [u32; 2]) -> (JointPath, [Vec<u32>; 2]) {
    let mut here = trees[0].to_root(met[0]);
    here.reverse();
    let there = trees[1].to_root(met[1]);
    let nodes = here.iter().map(|n| trees[0].pose(*n)).chain(there.iter().skip(1).map(|n| trees[1].pose(*n)));
    let mut path = JointPath { poses: Vec::with_capacity(here.len() + there.len()), goal: 0, evaluations: 0 };
    for q in nodes {
        let q = path.poses.last().map_or_else(|| q.to_vec(), |last| space.toward(last, q));
        path.poses.push(q);
    }
    (path, [here, there])
}

/// Nearest neighbor by a linear scan in single precision: trees are small, and the nearest node
/// only determines where a step begins.
struct NearestScan {
    /// Weight of each coordinate; and the weighted length of a turn and its reciprocal, if full turns are ignored.
    axes: Vec<(f64, Option<[f32; 2]>)>,
    /// Blocks of nodes, coordinate by coordinate; infinity where there is no node.
    blocks: Vec<[f32; BLOCK_SIZE]>,
    len: usize,
    query: Vec<f32>,
}

impl NearestScan {
    fn new(space: &JointSpace) -> Self {
        let metric = space.metric();
        let axis = |(i, weight): (usize, &f64)| {
            (*weight, metric.turns(i).then_some([(TAU * weight) as f32, (1.0 / (TAU * weight)) as f32]))
        };
        let axes = space.weights().iter().enumerate().map(axis).collect();
        NearestScan { axes, blocks: Vec::new(), len: 0, query: Vec::new() }
    }

    fn clear(&mut self) {
        self.blocks.clear();
        self.len = 0;
    }

    fn add(&mut self, q: &[f64]) {
        let lane = self.len % BLOCK_SIZE;
        if lane == 0 {
            self.blocks.extend(self.axes.iter().map(|_| [f32::INFINITY; BLOCK_SIZE]));
        }
        let first = self.blocks.len() - self.axes.len();
        for ((row, q), (weight, _)) in self.blocks[first..].iter_mut().zip(q).zip(&self.axes) {
            row[lane] = (q * weight) as f32;
        }
        self.len += 1;
    }

    fn load_query(&mut self, q: &[f64]) {
        self.query.clear();
        self.query.extend(q.iter().zip(&self.axes).map(|(q, (weight, _))| (q * weight) as f32));
    }

    /// Returns the squared distances of a block of nodes from the query.
    fn squares(&self, rows: &[[f32; BLOCK_SIZE]]) -> [f32; BLOCK_SIZE] {
        let mut sum = [0.0_f32; BLOCK_SIZE];
        for ((row, q), (_, turn)) in rows.iter().zip(&self.query).zip(&self.axes) {
            let mut ways = row.map(|x| x - q);
            if let Some([turn, per_turn]) = turn {
                // Rounds to a whole number, without a call.
                ways = ways.map(|way| way - ((way * per_turn + ROUND) - ROUND) * turn);
            }
            sum.iter_mut().zip(ways).for_each(|(sum, way)| *sum += way * way);
        }
        sum
    }

    fn nearest_within(&mut self, q: &[f64], costs: &[f64], cost: f64) -> u32 {
        self.load_query(q);
        let mut best = (f32::INFINITY, 0);
        let blocks = self.blocks.chunks(self.axes.len().max(1)).zip(costs.chunks(BLOCK_SIZE));
        for (block, (rows, costs)) in blocks.enumerate() {
            for (lane, (sum, before)) in self.squares(rows).into_iter().zip(costs).enumerate() {
                if sum < best.0 && before + f64::from(sum).sqrt() <= cost {
                    best = (sum, block * BLOCK_SIZE + lane);
                }
            }
        }
        best.1 as u32
    }

    fn nearest(&mut self, q: &[f64]) -> (u32, f64) {
        self.load_query(q);
        let mut best = (f32::INFINITY, 0);
        for (block, rows) in self.blocks.chunks(self.axes.len().max(1)).enumerate() {
            let squares = self.squares(rows);
            let least = least(&squares);
            if least < best.0 {
                let lane = squares.iter().position(|square| *square == least).unwrap_or(0);
                best = (least, block * BLOCK_SIZE + lane);
            }
        }
        (best.1 as u32, f64::from(best.0.sqrt()))
    }
}

/// Returns the least of some numbers, in a way that the compiler vectorizes.
fn least(numbers: &[f32; BLOCK_SIZE]) -> f32 {
    let mut least = *numbers;
    let mut count = BLOCK_SIZE / 2;
    while count > 0 {
        for i in 0..count {
            least[i] = if least[i + count] < least[i] { least[i + count] } else { least[i] };
        }
        count /= 2;
    }
    least[0]
}
