//! AORRTC: RRT-Connect in a space with the cost as one more coordinate, run again and again with a lower bound each time. Anytime and almost
//! surely asymptotically optimal.
//!
//! Wilson, Thomason, Kingston and Gammell, *AORRTC: Almost-Surely Asymptotically Optimal Planning with RRT-Connect* (2025,
//! arXiv:2505.10542); informed samples: Gammell, Srinivasa and Barfoot, *Informed RRT\** (2014, doi:10.1109/IROS.2014.6942976).
//!
//! ```text
//! RRT-Connect ──> path ──shorten──> best path, cost c
//!                                      │
//!        trees with costs below c <────┘ a shorter path lowers c, and the trees begin again
//! ```
//! The cost of a path is its length by the weights of the space: a meter of a prismatic joint counts as a radian.

use super::tree::{SearchTree, joined};
use super::{JointPath, JointSpace, NoPath, PlanProgress, Planner, PlanningProblem, RrtConnect, shorten};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;
use std::ops::ControlFlow;

/// Lines that may be judged to shorten each path that was found.
const SHORTEN_LINES: u64 = 1000;
/// A path counts as shorter if its cost is lower by this share.
const MIN_GAIN: f64 = 1e-4;
/// Attempts to draw a configuration through which a shorter path may lead.
const MAX_DRAWS: u32 = 64;
/// Attempts to find a cheaper parent for a new node.
const MAX_PARENTS: u32 = 8;

/// Asymptotically optimal RRT-Connect with certified paths.
///
/// # Examples
/// ```no_run
/// # use mobee_planning::planners::{AoRrtConnect, JointSpace, Planner, PlanningProblem};
/// # fn plan(space: &mut JointSpace, problem: &PlanningProblem) {
/// let planner = AoRrtConnect { iterations: 5000, ..AoRrtConnect::default() };
/// let path = planner.plan(space, problem, &mut |_| std::ops::ControlFlow::Continue(()));
/// # }
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AoRrtConnect {
    /// Greatest length of a straight line of its trees, rad; a meter of a prismatic joint counts as a radian.
    pub step: f64,
    /// Greatest number of random configurations after the first path.
    pub iterations: u64,
}

impl Default for AoRrtConnect {
    fn default() -> Self {
        AoRrtConnect { step: RrtConnect::default().step, iterations: 2000 }
    }
}

impl Planner for AoRrtConnect {
    /// The first path is that of [`RrtConnect`], to one of the goals; the rest of the iterations and of the budget shortens the way to it. A break of the watch, or a spent
    /// budget, ends the search with the best path so far.
    fn plan(
        &self,
        space: &mut JointSpace,
        problem: &PlanningProblem,
        watch: &mut dyn FnMut(PlanProgress) -> ControlFlow<()>,
    ) -> Result<JointPath, NoPath> {
        let begun = space.evaluations();
        let first = RrtConnect { step: self.step }.plan(space, problem, watch)?;
        let end = begun.saturating_add(problem.budget);
        let goal = first.goal;
        let mut best = shortened(space, first, problem.seed, end);
        let mut search = AoRrtSearch {
            start: best.poses.first().cloned().unwrap_or_default(),
            goal: best.poses.last().cloned().unwrap_or_default(),
            space,
            step: self.step.max(1e-6),
            rng: ChaCha8Rng::seed_from_u64(problem.seed),
            certifies: false,
            begun,
            end,
            left: self.iterations,
            watch,
        };
        let least = search.far(&search.start, &search.goal);
        let mut round = problem.seed;
        loop {
            let bound = search.cost(&best) * (1.0 - MIN_GAIN);
            if bound <= least {
                break;
            }
            let Some(path) = search.round(bound) else { break };
            round = round.wrapping_add(1);
            let path = shortened(search.space, path, round, end);
            if search.cost(&path) < search.cost(&best) {
                best = JointPath { goal, ..path };
            }
        }
        best.evaluations = space.evaluations() - begun;
        Ok(best)
    }
}

/// A path made shorter within what is left of the budget.
fn shortened(space: &mut JointSpace, path: JointPath, seed: u64, end: u64) -> JointPath {
    let lines = end.saturating_sub(space.evaluations()).min(SHORTEN_LINES);
    shorten(space, path, seed, lines)
}

struct AoRrtSearch<'a> {
    space: &'a mut JointSpace,
    start: Vec<f64>,
    /// In the turn in which the best path reaches it.
    goal: Vec<f64>,
    step: f64,
    rng: ChaCha8Rng,
    /// Whether lines are certified as they are added: since a path was refuted whose lines were only sampled.
    certifies: bool,
    /// The space's count of evaluations at the beginning, and at which the search ends.
    begun: u64,
    end: u64,
    /// Random configurations that are left.
    left: u64,
    watch: &'a mut dyn FnMut(PlanProgress) -> ControlFlow<()>,
}

impl AoRrtSearch<'_> {
    /// Length of the straight line between two configurations, the short way of joints without end.
    fn far(&self, from: &[f64], to: &[f64]) -> f64 {
        let axes = self.space.weights().iter().enumerate();
        let ways = axes.zip(from.iter().zip(to)).map(|((i, weight), (from, to))| {
            let way = to - from;
            let way = if self.space.metric().turns(i) { way - (way / TAU).round() * TAU } else { way };
            way * weight
        });
        ways.map(|way| way * way).sum::<f64>().sqrt()
    }

    /// Cost of a path.
    fn cost(&self, path: &JointPath) -> f64 {
        path.edges().map(|(from, to)| self.space.weighted(from, to)).sum()
    }

    /// The trees of a round: the roots alone.
    fn roots(&self) -> [SearchTree; 2] {
        [SearchTree::new(self.space, [&self.start]), SearchTree::new(self.space, [&self.goal])]
    }

    /// A path that costs less than `bound`; `None` if budget or iterations are spent, or the watch ends the search.
    fn round(&mut self, bound: f64) -> Option<JointPath> {
        let mut trees = self.roots();
        let mut grown = 0;
        while self.left > 0 {
            self.left -= 1;
            let poses = trees.iter().map(SearchTree::len).sum();
            let evaluations = self.space.evaluations();
            let progress = PlanProgress { evaluations: evaluations - self.begun, poses };
            if evaluations >= self.end || (self.watch)(progress).is_break() {
                return None;
            }
            grown = 1 - grown;
            let Some(draw) = self.draw(bound) else { continue };
            let [from, to] = if grown == 0 { [&self.start, &self.goal] } else { [&self.goal, &self.start] };
            // the cost that the drawn configuration may have
            let least = self.far(from, &draw);
            let most = bound - self.far(&draw, to);
            let cost = if most > least { self.rng.random_range(least..most) } else { least };
            let near = trees[grown].nearest_within(&draw, cost);
            let Some(node) = self.extend(&mut trees[grown], near, &draw, grown, bound) else { continue };
            let Some(other) = self.connect(&mut trees, grown, node, bound) else { continue };
            let met = if grown == 0 { [node, other] } else { [other, node] };
            match self.path(&trees, met) {
                Some(path) => return Some(path),
                None => {
                    self.certifies = true;
                    trees = self.roots();
                }
            }
        }
        None
    }

    /// A random configuration through which a path that costs less than `bound` may lead.
    fn draw(&mut self, bound: f64) -> Option<Vec<f64>> {
        let mut draw = Vec::new();
        for attempt in 0..MAX_DRAWS {
            // The ellipsoid of such configurations may be a small part of the joint space, or the larger one of both.
            if attempt % 2 == 0 {
                self.draw_informed(bound, &mut draw);
                self.space.put_held(&mut draw);
            } else {
                self.space.sample_into(&mut self.rng, &mut draw);
            }
            let within = self.space.outside(&draw).is_none();
            if within && self.far(&self.start, &draw) + self.far(&draw, &self.goal) < bound {
                return Some(draw);
            }
        }
        None
    }

    /// A configuration of the ellipsoid whose foci are start and goal and whose long axis is `bound`, all alike likely.
    fn draw_informed(&mut self, bound: f64, draw: &mut Vec<f64>) {
        let weights = self.space.weights();
        let n = weights.len();
        // in weighted coordinates: the axis from focus to focus
        let axis: Vec<f64> = self
            .goal
            .iter()
            .zip(&self.start)
            .zip(weights)
            .map(|((goal, start), weight)| (goal - start) * weight)
            .collect();
        let least = norm(&axis);
        let [long, short] = [bound / 2.0, (bound * bound - least * least).max(0.0).sqrt() / 2.0];
        // a point of the unit ball: a normal direction, and a radius
        let mut point: Vec<f64> = (0..n).map(|_| normal(&mut self.rng)).collect();
        let radius = self.rng.random::<f64>().powf(1.0 / n.max(1) as f64) / norm(&point).max(1e-12);
        for (i, x) in point.iter_mut().enumerate() {
            *x *= radius * if i == 0 { long } else { short };
        }
        // The reflection that takes the first unit vector to the axis (Householder) turns the ellipsoid: it is symmetric.
        let mut mirror: Vec<f64> = axis.iter().map(|x| -x / least.max(1e-12)).collect();
        if let Some(first) = mirror.first_mut() {
            *first += 1.0;
        }
        let length = norm(&mirror);
        if length > 1e-9 {
            let along = 2.0 * point.iter().zip(&mirror).map(|(p, m)| p * m).sum::<f64>() / (length * length);
            point.iter_mut().zip(&mirror).for_each(|(p, m)| *p -= along * m);
        }
        draw.clear();
        let middle = self.start.iter().zip(&self.goal).map(|(start, goal)| 0.5 * (start + goal));
        draw.extend(middle.zip(&point).zip(weights).map(|((middle, p), weight)| middle + p / weight));
    }

    /// Adds a node at most a step from `from` toward `target`, at a parent as cheap as is found. `None` if that is blocked, or no path
    /// through it costs less than `bound`.
    fn extend(&mut self, tree: &mut SearchTree, from: u32, target: &[f64], grown: usize, bound: f64) -> Option<u32> {
        let target = self.space.toward(tree.pose(from), target);
        let far = self.space.weighted(tree.pose(from), &target);
        let share = (self.step / far).min(1.0);
        let mut q: Vec<f64> = tree.pose(from).iter().zip(&target).map(|(a, b)| a + (b - a) * share).collect();
        let mut parent = from;
        let mut cost = tree.cost(from) + far * share;
        let end = if grown == 0 { &self.goal } else { &self.start };
        if cost + self.far(&q, end) >= bound || !self.is_free(tree.pose(from), &q) {
            return None;
        }
        // Draws of a lower cost, each for a nearest node of its own, lower the cost of the new one (AORRTC, section IV).
        let least = self.far(tree.pose(0), &q);
        for _ in 0..MAX_PARENTS {
            if cost <= least {
                break;
            }
            let wanted = self.rng.random_range(least..cost);
            let other = tree.nearest_within(&q, wanted);
            let turned = self.space.toward(tree.pose(other), &q);
            let cheaper = tree.cost(other) + self.space.weighted(tree.pose(other), &turned);
            if other == parent || cheaper >= cost || !self.is_free(tree.pose(other), &turned) {
                break;
            }
            cost = cheaper;
            parent = other;
            q = turned;
        }
        Some(tree.add_costed(parent, &q, cost))
    }

    /// Leads the other tree to a node, step by step. Returns its last node if it arrives.
    fn connect(&mut self, trees: &mut [SearchTree; 2], grown: usize, node: u32, bound: f64) -> Option<u32> {
        let goal = trees[grown].pose(node).to_vec();
        let spent = trees[grown].cost(node);
        let other = &mut trees[1 - grown];
        let mut at = other.nearest_within(&goal, bound - spent);
        loop {
            let target = self.space.toward(other.pose(at), &goal);
            let far = self.space.weighted(other.pose(at), &target);
            if other.cost(at) + far + spent >= bound {
                return None;
            }
            let steps = (far / self.step).ceil().max(1.0);
            let is_last = steps <= 1.0;
            let q: Vec<f64> = other
                .pose(at)
                .iter()
                .zip(&target)
                .map(|(a, b)| if is_last { *b } else { a + (b - a) / steps })
                .collect();
            if !self.is_free(other.pose(at), &q) {
                return None;
            }
            at = other.add_costed(at, &q, other.cost(at) + far / steps);
            if is_last {
                return Some(at);
            }
        }
    }

    /// Whether a line is free: by samples, or certified once these have misled.
    fn is_free(&mut self, from: &[f64], to: &[f64]) -> bool {
        if self.certifies { self.space.free_lines([(from, to)]) == [true] } else { self.space.samples_free(from, to) }
    }

    /// The path through the nodes at which the trees met, if it is certified as it will be driven.
    fn path(&mut self, trees: &[SearchTree; 2], met: [u32; 2]) -> Option<JointPath> {
        let (path, _) = joined(self.space, trees, met);
        let within = path.poses.iter().all(|q| self.space.outside(q).is_none());
        (within && self.space.free_lines(path.edges()).iter().all(|free| *free)).then_some(path)
    }
}

fn norm(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// A normal number (Box and Muller).
fn normal(rng: &mut impl Rng) -> f64 {
    let radius = (-2.0 * (1.0 - rng.random::<f64>()).ln()).sqrt();
    radius * (TAU * rng.random::<f64>()).cos()
}
