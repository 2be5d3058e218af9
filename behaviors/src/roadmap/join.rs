//! Out of the traps (the paper's own future work, section 3.1): parts of a map that can't be reached, or not be left, are joined by a
//! planner; what stays useless is left out; where the map is thin it grows.
//!
//! ```text
//! islands: strongly connected over edges that are not removed
//!    largest <──plan, shorten── next one, from its vertices nearest to the largest ──> vertices, edges both ways
//!    still apart ──> pruned: a map without it          thin places ──> grow: free poses there, certified edges
//! ```
//! All of it is a function of map, scene and seed; nothing is driven. New edges are certified in the space's scene and optimistic all the
//! same: only the robot knows better.

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

/// How near its middle a way may not pass a straight line that failed, as a share of its length.
const AVOID: f64 = 0.2;

/// What may be spent on joining and growing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JoinSettings {
    /// Pairs of vertices tried for each island.
    pub pairs: usize,
    /// Straight lines that one plan may judge.
    pub budget: u64,
    /// Seed of everything random.
    pub seed: u64,
}

impl Default for JoinSettings {
    fn default() -> Self {
        JoinSettings { pairs: 3, budget: 5000, seed: 1 }
    }
}

/// What became of a map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct JoinReport {
    /// Islands before and after.
    pub islands: (usize, usize),
    /// Vertices and directed edges that were added.
    pub vertices: usize,
    /// See `vertices`.
    pub edges: usize,
    /// Plans that found nothing.
    pub in_vain: usize,
    /// Straight lines that were judged.
    pub evaluations: u64,
}

/// A map without some of its vertices.
pub struct Pruned {
    /// What is left, numbered anew.
    pub map: Roadmap,
    /// By old number: the new one.
    pub numbers: Vec<Option<u32>>,
}

impl Roadmap {
    /// The parts of the map within which every vertex can be reached from every other, over edges that are not removed: the largest
    /// first, equal ones by their smallest number. A vertex that can't be left, or not be reached, is one of its own.
    pub fn islands(&self) -> Vec<Vec<u32>> {
        let number = |n: NodeIndex| n.index() as u32;
        let mut all: Vec<Vec<u32>> =
            tarjan_scc(&self.graph).into_iter().map(|part| part.into_iter().map(number).collect()).collect();
        all.iter_mut().for_each(|part| part.sort_unstable());
        all.sort_by_key(|part| (Reverse(part.len()), part.first().copied()));
        all
    }

    /// Joins every island to the largest one by paths of a planner, as far as it finds them.
    ///
    /// # Arguments
    /// * `space`: of the map's motors, in the scene that the map is for.
    /// * `rest`: the robot's pose; motors that the map does not move have it at new vertices.
    /// * `shown`: where a whole pose is shown, meters.
    /// * `tell`: told how much is done, as a share of the islands.
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
        let (begun, before) = (space.evaluations(), (self.len(), self.graph.edge_count()));
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

    /// Vertices of two parts, one of each, the nearest first: for each of the first part the nearest of the other.
    fn nearest_pairs(&self, from: &[u32], to: &[u32], count: usize) -> Vec<(u32, u32)> {
        let mut near = crate::roadmap::neighbors::neighbors(self.motors.len(), &self.metric);
        let pose = |id: u32| self.vertex(id).map(|v| self.group(&v.q));
        to.iter().filter_map(|id| Some((*id, pose(*id)?))).for_each(|(id, q)| near.add(id, &q));
        let nearest = |id: &u32| near.knn(&pose(*id)?, 1).first().map(|(d, to)| (*d, *id, *to));
        let mut pairs: Vec<(f64, u32, u32)> = from.iter().filter_map(nearest).collect();
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        pairs.into_iter().take(count).map(|(_, from, to)| (from, to)).collect()
    }

    /// A path between two vertices that does not drive what experience has removed.
    fn way(
        &self,
        space: &mut JointSpace,
        planner: &dyn Planner,
        (from, to): (u32, u32),
        budget: u64,
        seed: u64,
    ) -> Option<JointPath> {
        let pose = |id: u32| self.vertex(id).map(|v| self.group(&v.q));
        let (start, goal) = (pose(from)?, pose(to)?);
        let removed = |a, b| self.edge(a, b).is_some_and(|e| e.state == EdgeState::Removed);
        if removed(from, to) || removed(to, from) {
            let end = space.toward(&start, &goal);
            let middle = start.iter().zip(&end).map(|(a, b)| (a + b) / 2.0).collect();
            space.avoid(middle, AVOID * self.metric.distance(&start, &goal));
        }
        let problem = PlanningProblem { start, goal, seed, budget };
        let path = planner.plan(space, &problem, &mut |_| ControlFlow::Continue(())).ok();
        let path = path.map(|path| shorten(space, path, seed, budget));
        space.forgive();
        path
    }

    /// Takes a path between two vertices into the map; answers the vertices that are new.
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

    /// A vertex with the group at this pose.
    fn add_group(&mut self, pose: &[f64], rest: &Pose, shown: &dyn Fn(&[f64]) -> [f64; 3]) -> u32 {
        let target = Target { motors: self.motors.clone(), q: pose.to_vec(), speed: 1.0 };
        let q = target.pose(rest).to_vec();
        let at = shown(&q);
        self.add(Vertex { name: None, q, at })
    }

    /// Adds up to `count` free poses where vertices are far apart, each joined to the nearest ones by certified edges (the expansion step
    /// of Kavraki et al., *Probabilistic Roadmaps*, 1996, by distance instead of failures). A pose that can't be joined is not added.
    ///
    /// # Arguments
    /// * `k`: how many of its nearest vertices a new one may be joined to.
    /// * The others: as for [`Roadmap::join_islands`].
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
        // half of the tries may be in vain, and a few more
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

    /// A map of the vertices that are worth keeping, numbered anew in their order: the largest island, and what has a name. Blocked
    /// edges are what they are believed to be: what blocks them has to be found out anew. Of the log, what was tried between
    /// vertices that stay is kept.
    pub fn pruned(&self) -> Pruned {
        let main = self.islands().into_iter().next().unwrap_or_default();
        let mut map = Roadmap::empty(self.motors.clone(), self.metric.clone());
        let keep = |(id, v): (u32, &Vertex)| v.name.is_some() || main.binary_search(&id).is_ok();
        let numbers: Vec<Option<u32>> =
            self.vertices().map(|(id, v)| keep((id, v)).then(|| map.add(v.clone()))).collect();
        let new = |id: u32| numbers.get(id as usize).copied().flatten();
        // in the order in which they were added, vertex by vertex: ways of equal cost are chosen as before
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
                map.restore(from, to, self.believed(old.0, old.1).unwrap_or_else(|| edge.clone()));
            }
        }
        map.about.clone_from(&self.about);
        let tried = self.tried.iter().filter_map(|t| {
            let (from, to) = (new(t.from)?, new(t.to)?);
            Some(TriedMotion { from, to, ..t.clone() })
        });
        map.tried = tried.collect();
        Pruned { map, numbers }
    }
}
