//! Repair of disconnected maps (the paper's own future work, section 3.1): parts of a map that
//! can't be reached, or can't be left, are joined by a planner; parts that stay disconnected are
//! pruned; sparse parts grow.
//!
//! ```text
//! islands: strongly connected components over edges that are not removed
//!    largest <──plan, shorten── next one, from its vertices nearest to the largest ──> vertices, edges both ways
//!    not joined ──> pruned: a map without it           sparse parts ──> grow: free poses there, certified edges
//! ```
//! Everything is a function of map, scene and seed; nothing is driven. New edges are certified in
//! the space's scene but still optimistic: only driving confirms them.

use super::{Roadmap, Vertex};
use crate::map_file::TriedMotion;
use crate::planners::{JointPath, JointSpace, Planner, PlanningProblem, shorten};
use mobee_contract::{EdgeState, Pose, Target};
use petgraph::algo::tarjan_scc;
use petgraph::stable_graph::NodeIndex;
use petgraph::visit::EdgeRef;
use rand::distr::weighted::WeightedIndex;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::cmp::Reverse;
use std::ops::ControlFlow;

/// Radius around the middle of a failed edge that new paths avoid, as a share of the edge's length.
const AVOID_RADIUS_SHARE: f64 = 0.2;

/// Limits for joining and growing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JoinSettings {
    /// Maximum number of pairs of vertices tried for each island.
    pub pairs: usize,
    /// Maximum number of straight lines checked by one plan.
    pub budget: u64,
    /// Seed of all randomness.
    pub seed: u64,
}

impl Default for JoinSettings {
    fn default() -> Self {
        JoinSettings { pairs: 3, budget: 5000, seed: 1 }
    }
}

/// Result of joining a map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct JoinReport {
    /// Number of islands before and after.
    pub islands: (usize, usize),
    /// Number of vertices that were added.
    pub vertices: usize,
    /// Number of directed edges that were added.
    pub edges: usize,
    /// Number of plans without a result.
    pub in_vain: usize,
    /// Number of straight lines checked.
    pub evaluations: u64,
}

/// A map without some of its vertices.
pub struct Pruned {
    /// The remaining map, renumbered.
    pub map: Roadmap,
    /// New number of each old vertex; `None`: removed.
    pub numbers: Vec<Option<u32>>,
}

impl Roadmap {
    /// Returns the strongly connected components of the map, over edges that are not removed: the
    /// largest first, equal ones by their smallest number. A vertex that can't be left, or can't be
    /// reached, is a component of its own.
    pub fn islands(&self) -> Vec<Vec<u32>> {
        let number = |n: NodeIndex| n.index() as u32;
        let mut all: Vec<Vec<u32>> =
            tarjan_scc(&self.graph).into_iter().map(|part| part.into_iter().map(number).collect()).collect();
        all.iter_mut().for_each(|part| part.sort_unstable());
        all.sort_by_key(|part| (Reverse(part.len()), part.first().copied()));
        all
    }

    /// Joins every island to the largest one by planned paths, as far as the planner finds them.
    ///
    /// # Arguments
    /// * `space`: joint space of the map's motors, in the scene that the map is for.
    /// * `rest`: configuration of the robot, from which new vertices take the motors that the map
    ///   does not move.
    /// * `shown`: returns the position at which a whole configuration is drawn, meters.
    /// * `tell`: called with the completed share of the islands.
    pub fn join_islands(
        &mut self,
        space: &mut JointSpace,
        planner: &dyn Planner,
        settings: JoinSettings,
        rest: &Pose,
        shown: &dyn Fn(&[f64]) -> [f64; 3],
        tell: &mut dyn FnMut(f64),
    ) -> JoinReport {
        let islands = self.islands();
        let begun = space.evaluations();
        let before = (self.len(), self.graph.edge_count());
        let mut report = JoinReport { islands: (islands.len(), 0), ..JoinReport::default() };
        let count = islands.len();
        let mut islands = islands.into_iter();
        let mut main = islands.next().unwrap_or_default();
        for (done, island) in islands.enumerate() {
            tell(done as f64 / count as f64);
            for (trial, (from, to)) in self.nearest_pairs(&island, &main, settings.pairs).into_iter().enumerate() {
                let seed = settings.seed.wrapping_add(u64::from(from) << 8).wrapping_add(trial as u64);
                match self.way(space, planner, (from, to), settings.budget, seed) {
                    Some(path) => {
                        let new = self.enter(&path, (from, to), rest, shown);
                        main.extend(new.into_iter().chain(island));
                        break;
                    }
                    None => report.in_vain += 1,
                }
            }
        }
        report.islands.1 = self.islands().len();
        report.vertices = self.len() - before.0;
        report.edges = self.graph.edge_count() - before.1;
        report.evaluations = space.evaluations() - begun;
        report
    }

    /// Returns pairs of vertices of two parts, the closest first: for each vertex of the first
    /// part, the nearest of the other.
    fn nearest_pairs(&self, from: &[u32], to: &[u32], count: usize) -> Vec<(u32, u32)> {
        let mut near = crate::roadmap::neighbors::neighbors(self.motors.len(), &self.metric);
        let pose = |id: u32| self.vertex(id).map(|v| self.group(&v.q));
        to.iter().filter_map(|id| Some((*id, pose(*id)?))).for_each(|(id, q)| near.add(id, &q));
        let nearest = |id: &u32| near.knn(&pose(*id)?, 1).first().map(|(d, to)| (*d, *id, *to));
        let mut pairs: Vec<(f64, u32, u32)> = from.iter().filter_map(nearest).collect();
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        pairs.into_iter().take(count).map(|(_, from, to)| (from, to)).collect()
    }

    /// Plans a path between two vertices. If their edge was removed, the path avoids its middle.
    fn way(
        &self,
        space: &mut JointSpace,
        planner: &dyn Planner,
        (from, to): (u32, u32),
        budget: u64,
        seed: u64,
    ) -> Option<JointPath> {
        let pose = |id: u32| self.vertex(id).map(|v| self.group(&v.q));
        let start = pose(from)?;
        let goal = pose(to)?;
        let removed = |a, b| self.edge(a, b).is_some_and(|e| e.state == EdgeState::Removed);
        if removed(from, to) || removed(to, from) {
            let end = space.toward(&start, &goal);
            let middle = start.iter().zip(&end).map(|(a, b)| (a + b) / 2.0).collect();
            space.avoid(middle, AVOID_RADIUS_SHARE * self.metric.distance(&start, &goal));
        }
        let problem = PlanningProblem { start, goals: vec![goal], seed, budget };
        let path = planner.plan(space, &problem, &mut |_| ControlFlow::Continue(())).ok();
        let path = path.map(|path| shorten(space, path, seed, budget));
        space.forgive();
        path
    }

    /// Adds a path between two vertices to the map; returns the new vertices.
    fn enter(
        &mut self,
        path: &JointPath,
        (from, to): (u32, u32),
        rest: &Pose,
        shown: &dyn Fn(&[f64]) -> [f64; 3],
    ) -> Vec<u32> {
        let inner = path.poses.len().saturating_sub(2);
        let new: Vec<u32> =
            path.poses.iter().skip(1).take(inner).map(|pose| self.add_group(pose, rest, shown)).collect();
        let way: Vec<u32> = [from].into_iter().chain(new.iter().copied()).chain([to]).collect();
        for (a, b) in way.iter().zip(way.iter().skip(1)) {
            self.join(*a, *b);
        }
        new
    }

    /// Adds a vertex with the group at these positions.
    fn add_group(&mut self, pose: &[f64], rest: &Pose, shown: &dyn Fn(&[f64]) -> [f64; 3]) -> u32 {
        let target = Target { motors: self.motors.clone(), q: pose.to_vec(), speed: 1.0 };
        let q = target.pose(rest).to_vec();
        let at = shown(&q);
        self.add(Vertex { name: None, q, at })
    }

    /// Adds up to `count` free vertices where vertices are far apart, each joined to the nearest
    /// ones by certified edges (the expansion step of Kavraki et al., *Probabilistic Roadmaps*,
    /// 1996, by distance instead of failures). A configuration that can't be joined is not added.
    ///
    /// # Arguments
    /// * `k`: number of nearest vertices that a new one may be joined to.
    /// * Others: as for [`Roadmap::join_islands`].
    pub fn grow(
        &mut self,
        space: &mut JointSpace,
        (count, k, seed): (usize, usize, u64),
        rest: &Pose,
        shown: &dyn Fn(&[f64]) -> [f64; 3],
    ) -> usize {
        let far = |near: &[(f64, u32)]| near.last().map_or(0.0, |(d, _)| *d);
        let thin: Vec<(u32, f64)> = self.near.knn_all(k).into_iter().map(|(id, near)| (id, far(&near))).collect();
        let Ok(weights) = WeightedIndex::new(thin.iter().map(|(_, far)| *far)) else { return 0 };
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut grown = 0;
        // Allow for about as many failures as successes.
        for _ in 0..2 * count + 16 {
            if grown >= count {
                break;
            }
            let Some((about, far)) = thin.get(rng.sample(&weights)).copied() else { continue };
            let Some(center) = self.vertex(about).map(|v| self.group(&v.q)) else { continue };
            let reach = far / (2.0 * (self.motors.len() as f64).sqrt());
            let pose: Vec<f64> = center.iter().map(|q| q + rng.random_range(-1.0..=1.0) * reach).collect();
            let pose = space.within(&pose);
            let near = self.near.knn(&pose, k);
            let lines: Vec<(u32, Vec<f64>)> = near
                .iter()
                .filter_map(|(_, id)| Some((*id, space.toward(&pose, &self.group(&self.vertex(*id)?.q)))))
                .collect();
            let edges = lines.iter().map(|(_, q)| (pose.as_slice(), q.as_slice()));
            let free = space.free_lines(edges);
            let joined: Vec<u32> = lines.iter().zip(free).filter(|(_, free)| *free).map(|((id, _), _)| *id).collect();
            if joined.is_empty() {
                continue;
            }
            let new = self.add_group(&pose, rest, shown);
            joined.into_iter().for_each(|id| self.join(new, id));
            grown += 1;
        }
        grown
    }

    /// Returns a map of the largest island and of all named vertices, renumbered in their order.
    /// Blocked edges are in their unblocked state: the obstacles have to be determined again. Of
    /// the log, motions between remaining vertices are kept.
    pub fn pruned(&self) -> Pruned {
        let main = self.islands().into_iter().next().unwrap_or_default();
        let mut map = Roadmap::empty(self.motors.clone(), self.metric.clone());
        let keep = |(id, v): (u32, &Vertex)| v.name.is_some() || main.binary_search(&id).is_ok();
        let numbers: Vec<Option<u32>> =
            self.vertices().map(|(id, v)| keep((id, v)).then(|| map.add(v.clone()))).collect();
        let new = |id: u32| numbers.get(id as usize).copied().flatten();
        // In the order in which they were added, vertex by vertex: among paths of equal cost the
        // same one is then chosen.
        for id in 0..self.len() as u32 {
            let mut out: Vec<_> = self.graph.edges(NodeIndex::new(id as usize)).collect();
            out.reverse();
            for edge in out {
                if let (Some(from), Some(to)) = (new(id), new(edge.target().index() as u32)) {
                    map.restore(from, to, edge.weight().clone());
                }
            }
        }
        for (old, edge) in &self.ledger {
            if let (Some(from), Some(to)) = (new(old.0), new(old.1)) {
                map.restore(from, to, self.unblocked(old.0, old.1).unwrap_or_else(|| edge.clone()));
            }
        }
        map.about.clone_from(&self.about);
        let tried = self.tried.iter().filter_map(|t| {
            let from = new(t.from)?;
            let to = new(t.to)?;
            Some(TriedMotion { from, to, ..t.clone() })
        });
        map.tried = tried.collect();
        Pruned { map, numbers }
    }
}
