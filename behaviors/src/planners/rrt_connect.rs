//! RRT-Connect: two trees of certified straight lines grow from start and goal toward each other.
//!
//! Kuffner and LaValle, *RRT-Connect: An Efficient Approach to Single-Query Path Planning* (2000): one tree is extended by a step
//! toward a random pose, and the other is then led greedily, step by step, toward where that came to. Here [`WIDTH`] random poses are
//! extended to at once, and the other tree is led toward all that were reached at once, because lines that are judged together are
//! hardly dearer than one. What comes out depends on the problem alone, not on how lines are judged.

use super::tree::Tree;
use super::{JointPath, JointSpace, NoPath, PlanProgress, Planner, PlanningProblem, apart, between};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use std::ops::ControlFlow;

/// How many poses are extended to at once.
const WIDTH: usize = 16;

/// RRT-Connect on certified edges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RrtConnect {
    /// The longest straight line of its trees, as a share of the diagonal of the space.
    pub range: f64,
}

impl Default for RrtConnect {
    fn default() -> Self {
        RrtConnect { range: 0.2 }
    }
}

impl Planner for RrtConnect {
    fn plan(
        &self,
        space: &mut JointSpace,
        problem: &PlanningProblem,
        watch: &mut dyn FnMut(PlanProgress) -> ControlFlow<()>,
    ) -> Result<JointPath, NoPath> {
        let (start, goal) = space.ends(problem)?;
        let begun = space.evaluations();
        let step = (self.range * space.extent()).max(1e-6);
        let trees = [Tree::new(space, start), Tree::new(space, goal)];
        let end = begun.saturating_add(problem.budget);
        Search { space, trees, step, begun, end, watch }.run(problem.seed)
    }
}

/// A tree that is led toward a node of the other one.
struct Front {
    node: u32,
    toward: u32,
}

struct Search<'a> {
    space: &'a mut JointSpace,
    /// From the start, from the goal.
    trees: [Tree; 2],
    step: f64,
    /// The space's count of evaluations at the beginning, and at which it ends.
    begun: u64,
    end: u64,
    watch: &'a mut dyn FnMut(PlanProgress) -> ControlFlow<()>,
}

impl Search<'_> {
    fn run(&mut self, seed: u64) -> Result<JointPath, NoPath> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        // first the straight line: the goal's tree is led to the start
        let (mut grown, mut fresh) = (0, vec![0]);
        loop {
            if let Some(path) = self.connect(grown, &fresh)? {
                return Ok(path);
            }
            // the smaller tree is extended, so that both ends are explored alike
            grown = usize::from(self.trees[1].len() < self.trees[0].len());
            let draws: Vec<_> = (0..WIDTH).map(|_| self.space.sample(&mut rng)).collect();
            fresh = self.extend(grown, &draws)?;
        }
    }

    /// A step from a tree toward each of these poses; answers the nodes that were reached.
    fn extend(&mut self, tree: usize, toward: &[Vec<f64>]) -> Result<Vec<u32>, NoPath> {
        let steps = toward.iter().map(|q| {
            let from = self.trees[tree].nearest(q);
            (from, self.advance(self.trees[tree].pose(from), q).0)
        });
        let steps: Vec<(u32, Vec<f64>)> = steps.collect();
        let free = self.certify(tree, &steps)?;
        let reached = steps.into_iter().zip(free).filter(|(_, free)| *free);
        Ok(reached.map(|((from, pose), _)| self.trees[tree].add(from, pose)).collect())
    }

    /// Leads the other tree toward these nodes of a tree, until every way is blocked, or one has arrived: then the path.
    fn connect(&mut self, tree: usize, nodes: &[u32]) -> Result<Option<JointPath>, NoPath> {
        let other = 1 - tree;
        let front =
            |toward: &u32| Front { node: self.trees[other].nearest(self.trees[tree].pose(*toward)), toward: *toward };
        let mut fronts: Vec<Front> = nodes.iter().map(front).collect();
        while !fronts.is_empty() {
            let ahead = |f: &Front| self.advance(self.trees[other].pose(f.node), self.trees[tree].pose(f.toward));
            let (steps, arrives): (Vec<_>, Vec<bool>) =
                fronts.iter().map(|f| (f, ahead(f))).map(|(f, (pose, arrives))| ((f.node, pose), arrives)).unzip();
            let free = self.certify(other, &steps)?;
            let mut next = Vec::new();
            for (((mut front, (from, pose)), free), arrives) in fronts.into_iter().zip(steps).zip(free).zip(arrives) {
                if !free {
                    continue;
                }
                front.node = self.trees[other].add(from, pose);
                if !arrives {
                    next.push(front);
                } else if let Some(path) = self.path(tree, &front)? {
                    return Ok(Some(path));
                }
            }
            fronts = next;
        }
        Ok(None)
    }

    /// At most a step toward a pose, the short way; whether that is all of it.
    fn advance(&self, from: &[f64], to: &[f64]) -> (Vec<f64>, bool) {
        let to = self.space.toward(from, to);
        let far = apart(from, &to);
        if far <= self.step { (to, true) } else { (between(from, &to, self.step / far), false) }
    }

    /// The path through where the trees met. Motors without end are unwound along it, and its lines are judged as they will be driven;
    /// `None` if one is not free that way.
    fn path(&mut self, tree: usize, met: &Front) -> Result<Option<JointPath>, NoPath> {
        let (mut here, there) = (self.trees[tree].to_root(met.toward), self.trees[1 - tree].to_root(met.node));
        here.reverse();
        // both hold the pose where they met
        here.extend(there.into_iter().skip(1));
        if tree == 1 {
            here.reverse();
        }
        let mut poses: Vec<Vec<f64>> = Vec::with_capacity(here.len());
        for pose in here {
            poses.push(poses.last().map_or_else(|| pose.clone(), |last| self.space.toward(last, &pose)));
        }
        self.pay(poses.len().saturating_sub(1))?;
        let mut path = JointPath { poses, evaluations: 0 };
        let inside = path.poses.iter().all(|q| self.space.outside(q).is_none());
        let free = inside && self.space.all_free(path.edges());
        path.evaluations = self.space.evaluations() - self.begun;
        Ok(free.then_some(path))
    }

    /// Judges straight lines that begin at nodes of a tree.
    fn certify(&mut self, tree: usize, steps: &[(u32, Vec<f64>)]) -> Result<Vec<bool>, NoPath> {
        self.pay(steps.len())?;
        let edges = steps.iter().map(|(from, pose)| (self.trees[tree].pose(*from), pose.as_slice()));
        Ok(self.space.free_lines(edges))
    }

    /// Whether so many more lines may be judged.
    fn pay(&mut self, lines: usize) -> Result<(), NoPath> {
        let evaluations = self.space.evaluations() - self.begun;
        let poses = self.trees.iter().map(Tree::len).sum();
        if (self.watch)(PlanProgress { evaluations, poses }).is_break() {
            return Err(NoPath::Cancelled);
        }
        if self.space.evaluations().saturating_add(lines as u64) > self.end {
            return Err(NoPath::Exhausted { evaluations });
        }
        Ok(())
    }
}
