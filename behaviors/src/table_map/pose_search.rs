//! One pose for one place: equations (1)-(4), limits and collision as one fitness.

use super::cells::Cells;
use super::growth::{Growth, Trial, Wish};
use super::hand::{HandChain, HandPose};
use super::{TableMapPlan, group};
use crate::search::{EvolutionStrategy, Snes, Xnes};
use mobee_fast::{FastError, FastScene};
use mobee_model::Scene;
use std::sync::Arc;

/// A pose is accepted if its height is off by at most so much, meters.
pub const ACCEPT_OFFSET: f64 = 0.005;
/// And the palm's direction by so much, rad (10 degrees).
pub const ACCEPT_ANGLE: f64 = std::f64::consts::PI / 18.0;
/// And no other pose is nearer than this share of the spacing.
pub const ACCEPT_SPACING: f64 = 0.8;

/// A search stops once a pose is so good: height, meters; angle, rad; off the middle of its cell, share of the spacing.
const GOOD: (f64, f64, f64) = (0.002, 0.8 * ACCEPT_ANGLE, 0.1);
/// Samples of a generation: what the collision engine judges at once.
const POPULATION: usize = 16;
/// Equation (1), and staying near the pose that the search began at: the weakest, as the others are to be met.
const HOME_WEIGHT: f64 = 0.1;
const START_WEIGHT: f64 = 0.02;
/// What a collision costs: more than any place on the table.
const COLLISION: f64 = 100.0;
/// A centimeter costs as much as ten degrees.
const PER_METER: f64 = 100.0;
/// The first search of a cell, SNES from a neighbor's pose: samples at most, and its first width, as a share of the motors'
/// ranges. A centimeter needs little.
const SHORT: (usize, f64) = (640, 0.005);
/// Where that stalls: xNES from another neighbor's pose, wider. It takes ten times as long for each sample.
const LONG: (usize, f64) = (1600, 0.05);
/// The first pose of all begins at home.
const FIRST: (usize, f64) = (8000, 0.1);
/// Poses are whole millionths of a radian, so that they are written and read without a change.
const GRAIN: f64 = 1e6;

/// A pose that keeps all that is asked.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundPose {
    /// Positions of the plan's motors, rad of encoder.
    pub q: Vec<f64>,
    /// The whole robot's pose.
    pub whole: Vec<f64>,
    /// Where the hand is, meters.
    pub at: [f64; 3],
}

/// Searches poses for one robot over one table.
#[derive(Clone, Debug)]
pub struct PoseSearch {
    plan: Arc<TableMapPlan>,
    chain: HandChain,
    fast: FastScene,
    /// Limits of the plan's motors, rad of encoder.
    ranges: Vec<(f64, f64)>,
    /// The whole robot's home.
    home: Vec<f64>,
    points: Vec<f64>,
    poses: Vec<f64>,
    free: Vec<bool>,
    fitness: Vec<f64>,
}

impl PoseSearch {
    /// For the only robot of a scene.
    ///
    /// # Errors
    /// If the scene can't be compiled for the plan's clearance.
    pub fn new(scene: &Scene, plan: Arc<TableMapPlan>) -> Result<PoseSearch, FastError> {
        let fast = FastScene::new(scene, plan.clearance)?;
        let home = scene.robots().first().map(|r| group::home(r)).unwrap_or_default();
        let range = |m: &usize| scene.robots().first().and_then(|r| r.motors.get(*m)).map(|m| m.range());
        let ranges = plan.motors.iter().filter_map(range).collect();
        let chain = plan.chain(scene);
        let (points, poses, free, fitness) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Ok(PoseSearch { plan, chain, fast, ranges, home, points, poses, free, fitness })
    }

    /// Looks for what growth wishes for.
    pub fn search(&mut self, growth: &Growth, wish: &Wish) -> Trial {
        let cell = wish.cell.map_or(0, |c| u64::from(c) + 1);
        let seed = self.plan.seed.wrapping_mul(1_000_003).wrapping_add(cell * 8 + u64::from(wish.attempt));
        let start = self.shares(&wish.start);
        let (budget, width) = match (wish.cell, wish.attempt) {
            (None, _) => FIRST,
            (Some(_), 0) => SHORT,
            _ => LONG,
        };
        let (found, evaluations) = if (budget, width) == SHORT {
            self.run(Snes::new(start.clone(), width, POPULATION, seed), &start, growth.cells(), wish, budget)
        } else {
            self.run(Xnes::new(start.clone(), width, POPULATION, seed), &start, growth.cells(), wish, budget)
        };
        Trial { cell: wish.cell, attempt: wish.attempt, evaluations: evaluations as u32, q: found }
    }

    /// A pose with all that a map keeps of it, if it is acceptable where growth wishes for one.
    pub fn accept(&mut self, growth: &Growth, wish: &Wish, q: &[f64]) -> Option<FoundPose> {
        self.accepted(growth.cells(), wish, q)
    }

    /// Whether an acceptable pose can be found over a cell from this start, however many others are near: a longer search
    /// than growth makes.
    pub fn reaches(&mut self, empty: &Growth, wish: &Wish, budget: usize) -> bool {
        let start = self.shares(&wish.start);
        let search = Xnes::new(start.clone(), LONG.1, POPULATION, u64::from(wish.cell.unwrap_or(0)));
        self.run(search, &start, empty.cells(), wish, budget).0.is_some()
    }

    fn run(
        &mut self,
        mut search: impl EvolutionStrategy,
        start: &[f64],
        cells: &Cells,
        wish: &Wish,
        budget: usize,
    ) -> (Option<Vec<f64>>, usize) {
        let mut points = std::mem::take(&mut self.points);
        let mut best: Option<(f64, Vec<f64>)> = None;
        let mut evaluations = 0;
        while evaluations < budget && search.width() > 1e-5 {
            search.sample(&mut points);
            // what is beyond a limit counts as the limit, and is kept as that
            points.iter_mut().for_each(|x| *x = x.clamp(0.0, 1.0));
            let good = self.generation(&points, start, cells, wish, &mut best);
            evaluations += POPULATION;
            if good {
                break;
            }
            search.update(&self.fitness);
        }
        self.points = points;
        let q = best.map(|(_, x)| self.positions(&x)).filter(|q| self.accepted(cells, wish, q).is_some());
        (q, evaluations)
    }

    /// Judges a generation; keeps the best acceptable pose so far, and answers whether one is as good as can be.
    fn generation(
        &mut self,
        points: &[f64],
        start: &[f64],
        cells: &Cells,
        wish: &Wish,
        best: &mut Option<(f64, Vec<f64>)>,
    ) -> bool {
        let d = self.ranges.len();
        self.poses.clear();
        for x in points.chunks_exact(d) {
            let first = self.poses.len();
            self.poses.extend(&self.home);
            for ((x, (min, max)), motor) in x.iter().zip(&self.ranges).zip(&self.plan.motors) {
                if let Some(q) = self.poses.get_mut(first + motor) {
                    *q = min + x * (max - min);
                }
            }
        }
        if self.fast.free(&self.poses, &mut self.free).is_err() {
            // cannot be: these are whole poses of the scene's only robot
            self.free.clear();
        }
        let home = self.shares(&self.home_of_group());
        self.fitness.clear();
        let mut good = false;
        let each = points.chunks_exact(d).zip(self.poses.chunks_exact(self.home.len().max(1))).zip(&self.free);
        for ((x, pose), free) in each {
            let judged = judge(&self.plan, cells, wish, &self.chain.at(pose));
            let far = |from: &[f64]| x.iter().zip(from).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
            let regular = HOME_WEIGHT * far(&home) / (d as f64).sqrt() + START_WEIGHT * far(start);
            let fitness = judged.cost + regular + if *free { 0.0 } else { COLLISION };
            self.fitness.push(fitness);
            if *free && judged.acceptable && best.as_ref().is_none_or(|(f, _)| fitness < *f) {
                *best = Some((fitness, x.to_vec()));
                good |= judged.good;
            }
        }
        good
    }

    fn accepted(&mut self, cells: &Cells, wish: &Wish, q: &[f64]) -> Option<FoundPose> {
        let inside = |(q, (min, max)): (&f64, &(f64, f64))| *q >= *min && *q <= *max;
        if q.len() != self.ranges.len() || !q.iter().zip(&self.ranges).all(inside) {
            return None;
        }
        let mut whole = self.home.clone();
        for (motor, q) in self.plan.motors.iter().zip(q) {
            *whole.get_mut(*motor)? = *q;
        }
        self.fast.free(&whole, &mut self.free).ok()?;
        let hand = self.chain.at(&whole);
        let good = self.free.first() == Some(&true) && judge(&self.plan, cells, wish, &hand).acceptable;
        good.then(|| FoundPose { q: q.to_vec(), whole, at: hand.at.coords.into() })
    }

    fn home_of_group(&self) -> Vec<f64> {
        self.plan.motors.iter().filter_map(|m| self.home.get(*m).copied()).collect()
    }

    /// Positions as shares of the motors' ranges.
    fn shares(&self, q: &[f64]) -> Vec<f64> {
        let share = |(q, (min, max)): (&f64, &(f64, f64))| if max > min { (q - min) / (max - min) } else { 0.0 };
        q.iter().zip(&self.ranges).map(share).collect()
    }

    /// Shares as positions, on the grain, within the limits.
    fn positions(&self, x: &[f64]) -> Vec<f64> {
        let position = |(x, (min, max)): (&f64, &(f64, f64))| {
            let q = ((min + x * (max - min)) * GRAIN).round();
            // towards the inside, where the nearest grain is beyond a limit
            let q = if q / GRAIN < *min { q + 1.0 } else { q };
            let q = if q / GRAIN > *max { q - 1.0 } else { q };
            q / GRAIN
        };
        x.iter().zip(&self.ranges).map(position).collect()
    }
}

/// What a hand's pose is worth at a place, collision and regularization left out.
struct Judgment {
    cost: f64,
    acceptable: bool,
    good: bool,
}

fn judge(plan: &TableMapPlan, cells: &Cells, wish: &Wish, hand: &HandPose) -> Judgment {
    let spacing = cells.spacing();
    let place = [hand.at.x, hand.at.y];
    // (2)
    let height = (hand.at.z - plan.table.height_m - plan.offset).abs();
    // (3): the table's normal points up, the palm down
    let angle = (-hand.palm.z).clamp(-1.0, 1.0).acos();
    // the root of the squares, not the sum: where several are to be met at once, it has no ridges to get stuck on
    let mut squares = (height * PER_METER).powi(2) + (angle / ACCEPT_ANGLE).powi(2);
    let cell = cells.at(place);
    let (inside, off) = match wish.cell {
        None => (cell.is_some(), 0.0),
        Some(wished) => {
            let [x, y] = cells.middle(wished);
            // (4): a step from the nearest pose, and over the cell that has none yet
            let nearest = cells.nearest(place, 2.0 * spacing);
            let off = (place[0] - x).hypot(place[1] - y);
            squares += ((nearest.min(spacing) - spacing) * PER_METER).powi(2) + (off * PER_METER).powi(2);
            (cell == Some(wished) && nearest >= ACCEPT_SPACING * spacing, off)
        }
    };
    let acceptable = inside && height <= ACCEPT_OFFSET && angle <= ACCEPT_ANGLE;
    let good = acceptable && height <= GOOD.0 && angle <= GOOD.1 && off <= GOOD.2 * spacing;
    Judgment { cost: squares.sqrt(), acceptable, good }
}
