//! RRT-Connect: two trees of straight lines grow from the start and from all goals toward each other, and the path between them is certified.
//!
//! Kuffner and LaValle, *RRT-Connect: An Efficient Approach to Single-Query Path Planning* (2000):
//! the smaller tree is extended by a step toward a random configuration, and the other tree is then
//! extended step by step toward the configuration that was reached.
//!
//! ```text
//! search: lines sampled at configurations ──> path ──certify──> all free: done
//!    ^                                                     └──> refuted lines: pruned, the search continues
//!    └───────────────────────────────────────────────────────────────┘
//! ```
//!
//! Most lines of a search are discarded, so they are only sampled; the lines of a path are proved.
//! If samples are misleading repeatedly, each line is certified at once.
//!
//! A node at which steps fail attracts only nearby random configurations (Yershova et al.,
//! *Dynamic-Domain RRTs*, 2005), so that a tree in a corner does not spend its lines on the walls
//! around it.

use super::draws::SplitMix;
use super::tree::{SearchTree, joined};
use super::{JointPath, JointSpace, NoPath, PlanEnds, PlanProgress, Planner, PlanningProblem};
use std::ops::ControlFlow;

/// Radius of a node's domain after its first blocked step, in steps; the minimum is one step.
const DOMAIN_STEPS: f64 = 3.5;
/// Relative change of a domain after each further step: it shrinks if the step was blocked, and
/// grows otherwise.
const DOMAIN_CHANGE: f64 = 1e-4;
/// Number of random configurations in a row outside every domain after which the next one is used
/// anyway, so that the search never starves.
const MAX_OUTSIDE: u32 = 400;
/// Number of configurations outside every domain that count as one line of the budget.
const OUTSIDE_PER_LINE: u32 = 4;
/// Number of configurations outside every domain between two calls of `watch`.
const WATCH_EVERY: u32 = 64;
/// Number of refuted paths after which each line is certified at once.
const MAX_REFUTED: u32 = 8;

/// RRT-Connect with certified paths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RrtConnect {
    /// Maximum length of a straight line of its trees, rad; a meter of a prismatic joint counts as
    /// a radian.
    pub step: f64,
}

impl Default for RrtConnect {
    fn default() -> Self {
        RrtConnect { step: 1.0 }
    }
}

impl Planner for RrtConnect {
    fn plan(
        &self,
        space: &mut JointSpace,
        problem: &PlanningProblem,
        watch: &mut dyn FnMut(PlanProgress) -> ControlFlow<()>,
    ) -> Result<JointPath, NoPath> {
        let PlanEnds { start, goals, .. } = space.ends(problem)?;
        let begun = space.evaluations();
        let step = self.step.max(1e-6);
        let trees = [SearchTree::new(space, [&start]), SearchTree::new(space, goals.iter().map(|(_, goal)| goal))];
        let goals = goals.into_iter().map(|(i, _)| i).collect();
        let end = begun.saturating_add(problem.budget);
        let search = RrtSearch {
            space,
            trees,
            goals,
            step,
            begun,
            end,
            refuted: 0,
            target: Vec::new(),
            ahead: Vec::new(),
            watch,
        };
        search.run(problem.seed)
    }
}

struct RrtSearch<'a> {
    space: &'a mut JointSpace,
    /// Trees of the start and of the goals, each of which is a root of the second one.
    trees: [SearchTree; 2],
    /// Per root of the goals' tree: its index among the problem's goals.
    goals: Vec<usize>,
    step: f64,
    /// The space's count of evaluations at the beginning.
    begun: u64,
    /// The space's count of evaluations at which the budget is spent.
    end: u64,
    /// Number of refuted paths so far.
    refuted: u32,
    /// Buffer: the configuration that a tree is extended toward.
    target: Vec<f64>,
    /// Buffer: the next configuration on the way there.
    ahead: Vec<f64>,
    watch: &'a mut dyn FnMut(PlanProgress) -> ControlFlow<()>,
}

impl RrtSearch<'_> {
    fn run(mut self, seed: u64) -> Result<JointPath, NoPath> {
        let mut rng = SplitMix(seed);
        // First try the whole straight line.
        if let Some(path) = self.straight()? {
            return Ok(path);
        }
        let mut draw = Vec::new();
        let mut outside = 0;
        loop {
            // The smaller tree is extended, so that both ends are explored equally.
            let grown = usize::from(self.trees[1].len() < self.trees[0].len());
            self.space.sample_into(&mut rng, &mut draw);
            let (near, far) = self.trees[grown].nearest(&draw);
            let domain = self.trees[grown].radius_mut(near).map_or(f64::INFINITY, |r| *r);
            if far > domain && outside < MAX_OUTSIDE {
                outside += 1;
                // They cost time as well, so a search without success ends as soon as one that
                // checks lines.
                if outside.is_multiple_of(OUTSIDE_PER_LINE) {
                    self.end = self.end.saturating_sub(1);
                }
                if outside.is_multiple_of(WATCH_EVERY) {
                    self.pay(0)?;
                }
                continue;
            }
            outside = 0;
            self.space.toward_into(self.trees[grown].pose(near), &draw, &mut self.target);
            let far = self.space.weighted(self.trees[grown].pose(near), &self.target);
            let share = (self.step / far).min(1.0);
            let reached = self.advance(grown, near, share)?;
            self.adapt_domain(grown, near, reached.is_some());
            if let Some(node) = reached
                && let Some(path) = self.connect(grown, node)?
            {
                return Ok(path);
            }
        }
    }

    /// Returns the straight line from the start to the nearest goal for which it is free.
    fn straight(&mut self) -> Result<Option<JointPath>, NoPath> {
        for root in 0..self.goals.len() as u32 {
            let goal = self.trees[1].pose(root).to_vec();
            self.space.toward_into(self.trees[0].pose(0), &goal, &mut self.target);
            if let Some(node) = self.advance(0, 0, 1.0)?
                && let Some(path) = self.path([node, root])?
            {
                return Ok(Some(path));
            }
        }
        Ok(None)
    }

    /// Shrinks a node's domain after a blocked step, and enlarges it slightly after a free one.
    fn adapt_domain(&mut self, tree: usize, node: u32, is_free: bool) {
        let step = self.step;
        let Some(radius) = self.trees[tree].radius_mut(node) else { return };
        if is_free {
            *radius *= 1.0 + DOMAIN_CHANGE;
        } else if radius.is_finite() {
            *radius = (*radius * (1.0 - DOMAIN_CHANGE)).max(step);
        } else {
            *radius = DOMAIN_STEPS * step;
        }
    }

    /// Adds the configuration at a share of the line from a node to the target, if the line to it
    /// is free.
    fn advance(&mut self, tree: usize, from: u32, share: f64) -> Result<Option<u32>, NoPath> {
        self.pay(1)?;
        let here = self.trees[tree].pose(from);
        self.ahead.clear();
        self.ahead
            .extend(here.iter().zip(&self.target).map(|(a, b)| if share < 1.0 { a + (b - a) * share } else { *b }));
        let free = if self.refuted < MAX_REFUTED {
            self.space.samples_free(here, &self.ahead)
        } else {
            self.space.all_free([(here, self.ahead.as_slice())])
        };
        Ok(free.then(|| self.trees[tree].add(from, &self.ahead)))
    }

    /// Extends the other tree to a node of a tree until a line is blocked or it arrives. Returns
    /// the path if it arrives and is certified.
    fn connect(&mut self, tree: usize, node: u32) -> Result<Option<JointPath>, NoPath> {
        let other = 1 - tree;
        let goal = self.trees[tree].pose(node).to_vec();
        let (mut at, _) = self.trees[other].nearest(&goal);
        self.space.toward_into(self.trees[other].pose(at), &goal, &mut self.target);
        let far = self.space.weighted(self.trees[other].pose(at), &self.target);
        let mut left = (far / self.step).ceil().max(1.0);
        while left >= 1.0 {
            match self.advance(other, at, 1.0 / left)? {
                Some(next) => at = next,
                None => return Ok(None),
            }
            left -= 1.0;
        }
        let met = if tree == 0 { [node, at] } else { [at, node] };
        self.path(met)
    }

    /// Returns the path through the two nodes at which the trees met, if all its lines are
    /// certified as they will be driven, with continuous joints unwound. Refuted lines are pruned
    /// from their trees.
    fn path(&mut self, met: [u32; 2]) -> Result<Option<JointPath>, NoPath> {
        let (mut path, [here, there]) = joined(self.space, &self.trees, met);
        let root = there.last().copied().unwrap_or_default();
        path.goal = self.goals.get(root as usize).copied().unwrap_or_default();
        self.pay(path.poses.len().saturating_sub(1))?;
        if path.poses.iter().any(|q| self.space.outside(q).is_some()) {
            return Ok(None);
        }
        let free = self.space.free_lines(path.edges());
        path.evaluations = self.space.evaluations() - self.begun;
        if free.iter().all(|free| *free) {
            return Ok(Some(path));
        }
        self.refuted += 1;
        // A line of a tree is identified by the node farther from the root.
        let lines = here.iter().skip(1).map(|n| (0, *n)).chain(there.iter().map(|n| (1, *n)));
        let refuted: Vec<(usize, u32)> = lines.zip(free).filter(|(_, free)| !*free).map(|(line, _)| line).collect();
        for tree in [0, 1] {
            let cut: Vec<u32> = refuted.iter().filter(|(t, _)| *t == tree).map(|(_, node)| *node).collect();
            if !cut.is_empty() {
                self.trees[tree].prune(&cut);
            }
        }
        Ok(None)
    }

    /// Checks that the budget allows this number of further lines, and reports the progress.
    fn pay(&mut self, lines: usize) -> Result<(), NoPath> {
        let evaluations = self.space.evaluations() - self.begun;
        let poses = self.trees.iter().map(SearchTree::len).sum();
        if (self.watch)(PlanProgress { evaluations, poses }).is_break() {
            return Err(NoPath::Cancelled);
        }
        if self.space.evaluations().saturating_add(lines as u64) > self.end {
            return Err(NoPath::Exhausted { evaluations });
        }
        Ok(())
    }
}
