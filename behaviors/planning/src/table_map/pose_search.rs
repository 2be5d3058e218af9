//! Search of one pose for one cell: equations (1)-(4), limits and collision as one fitness.

use super::cells::Cells;
use super::growth::{Growth, PoseWish, Trial};
use super::hand::{HandChain, HandPose};
use super::{TableMapPlan, group};
use crate::search::{EvolutionStrategy, Snes, Xnes};
use mobee_fast::{FastError, FastScene};
use mobee_model::Scene;
use std::sync::Arc;

/// Maximum height error of an accepted pose, meters.
pub const ACCEPT_OFFSET: f64 = 0.005;
/// Maximum angle of an accepted pose's palm from its direction, rad (10 degrees).
pub const ACCEPT_ANGLE: f64 = std::f64::consts::PI / 18.0;
/// Minimum distance of an accepted pose from all others, as a share of the spacing.
pub const ACCEPT_SPACING: f64 = 0.8;

/// Errors at which a search stops: height, meters; angle, rad; distance from the cell's center,
/// share of the spacing.
const GOOD_ENOUGH: (f64, f64, f64) = (0.002, 0.8 * ACCEPT_ANGLE, 0.1);
/// Number of samples in a generation: the batch size of the collision engine.
const POPULATION: usize = 16;
/// Weight of the distance from home, equation (1): small, because the other equations have
/// priority.
const HOME_WEIGHT: f64 = 0.1;
/// Weight of the distance from the start of the search.
const START_WEIGHT: f64 = 0.02;
/// Cost of a collision: more than that of any position on the table.
const COLLISION_COST: f64 = 100.0;
/// Weight of a meter: a centimeter costs as much as ten degrees.
const COST_PER_METER: f64 = 100.0;
/// First search of a cell, SNES from a neighbor's pose: maximum number of samples, and initial
/// width as a share of the motors' ranges. A centimeter needs a small width.
const SHORT_SEARCH: (usize, f64) = (640, 0.005);
/// Second search of a cell, xNES from another neighbor's pose, wider. A sample takes ten times as
/// long.
const LONG_SEARCH: (usize, f64) = (1600, 0.05);
/// Search of the first pose, from home.
const FIRST_SEARCH: (usize, f64) = (8000, 0.1);
/// Inverse of the resolution of poses: multiples of 1e-6 rad are written and read without a change.
const STEPS_PER_RAD: f64 = 1e6;

/// An accepted pose.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundPose {
    /// Positions of the plan's motors, rad at the encoder.
    pub q: Vec<f64>,
    /// Configuration of the whole robot.
    pub whole: Vec<f64>,
    /// Position of the hand, meters.
    pub at: [f64; 3],
}

/// Searches poses for one robot over one table.
#[derive(Clone, Debug)]
pub struct PoseSearch {
    plan: Arc<TableMapPlan>,
    chain: HandChain,
    fast: FastScene,
    /// Limits of the plan's motors, rad at the encoder.
    ranges: Vec<(f64, f64)>,
    /// Home configuration of the whole robot.
    home: Vec<f64>,
    points: Vec<f64>,
    poses: Vec<f64>,
    free: Vec<bool>,
    fitness: Vec<f64>,
}

impl PoseSearch {
    /// Creates a search for the only robot of a scene.
    ///
    /// # Errors
    /// A scene that can't be compiled for the plan's clearance.
    pub fn new(scene: &Scene, plan: Arc<TableMapPlan>) -> Result<PoseSearch, FastError> {
        let fast = FastScene::new(scene, plan.clearance)?;
        let home = scene.robots().first().map(|r| group::home(r)).unwrap_or_default();
        let range = |m: &usize| scene.robots().first().and_then(|r| r.motors.get(*m)).map(|m| m.range());
        let ranges = plan.motors.iter().filter_map(range).collect();
        let chain = plan.chain(scene);
        let (points, poses, free, fitness) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Ok(PoseSearch { plan, chain, fast, ranges, home, points, poses, free, fitness })
    }

    /// Makes the search that growth requests.
    pub fn search(&mut self, growth: &Growth, wish: &PoseWish) -> Trial {
        let cell = wish.cell.map_or(0, |c| u64::from(c) + 1);
        let seed = self.plan.seed.wrapping_mul(1_000_003).wrapping_add(cell * 8 + u64::from(wish.attempt));
        let start = self.shares(&wish.start);
        let (budget, width) = match (wish.cell, wish.attempt) {
            (None, _) => FIRST_SEARCH,
            (Some(_), 0) => SHORT_SEARCH,
            _ => LONG_SEARCH,
        };
        let (found, evaluations) = if (budget, width) == SHORT_SEARCH {
            self.run(Snes::new(start.clone(), width, POPULATION, seed), &start, growth.cells(), wish, budget)
        } else {
            self.run(Xnes::new(start.clone(), width, POPULATION, seed), &start, growth.cells(), wish, budget)
        };
        Trial { cell: wish.cell, attempt: wish.attempt, evaluations: evaluations as u32, q: found }
    }

    /// Checks a pose for the search that growth requests; returns it with everything that a map
    /// stores if it is acceptable.
    pub fn accept(&mut self, growth: &Growth, wish: &PoseWish, q: &[f64]) -> Option<FoundPose> {
        self.accepted(growth.cells(), wish, q)
    }

    /// Returns whether an acceptable pose for a cell can be found from this start, ignoring all
    /// others: a longer search than growth makes.
    pub fn reaches(&mut self, empty: &Growth, wish: &PoseWish, budget: usize) -> bool {
        let start = self.shares(&wish.start);
        let search = Xnes::new(start.clone(), LONG_SEARCH.1, POPULATION, u64::from(wish.cell.unwrap_or(0)));
        self.run(search, &start, empty.cells(), wish, budget).0.is_some()
    }

    fn run(
        &mut self,
        mut search: impl EvolutionStrategy,
        start: &[f64],
        cells: &Cells,
        wish: &PoseWish,
        budget: usize,
    ) -> (Option<Vec<f64>>, usize) {
        let mut points = std::mem::take(&mut self.points);
        let mut best: Option<(f64, Vec<f64>)> = None;
        let mut evaluations = 0;
        while evaluations < budget && search.width() > 1e-5 {
            search.sample(&mut points);
            // Positions beyond a limit are evaluated and stored as the limit.
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

    /// Evaluates a generation and updates the best acceptable pose; returns whether one is good
    /// enough to stop.
    fn generation(
        &mut self,
        points: &[f64],
        start: &[f64],
        cells: &Cells,
        wish: &PoseWish,
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
            // Cannot happen: these are whole configurations of the scene's only robot.
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
            let fitness = judged.cost + regular + if *free { 0.0 } else { COLLISION_COST };
            self.fitness.push(fitness);
            if *free && judged.acceptable && best.as_ref().is_none_or(|(f, _)| fitness < *f) {
                *best = Some((fitness, x.to_vec()));
                good |= judged.good;
            }
        }
        good
    }

    fn accepted(&mut self, cells: &Cells, wish: &PoseWish, q: &[f64]) -> Option<FoundPose> {
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

    /// Converts positions to shares of the motors' ranges.
    fn shares(&self, q: &[f64]) -> Vec<f64> {
        let share = |(q, (min, max)): (&f64, &(f64, f64))| if max > min { (q - min) / (max - min) } else { 0.0 };
        q.iter().zip(&self.ranges).map(share).collect()
    }

    /// Converts shares to positions, rounded to the resolution, within the limits.
    fn positions(&self, x: &[f64]) -> Vec<f64> {
        let position = |(x, (min, max)): (&f64, &(f64, f64))| {
            let q = ((min + x * (max - min)) * STEPS_PER_RAD).round();
            // Rounded inward where the nearest multiple is beyond a limit.
            let q = if q / STEPS_PER_RAD < *min { q + 1.0 } else { q };
            let q = if q / STEPS_PER_RAD > *max { q - 1.0 } else { q };
            q / STEPS_PER_RAD
        };
        x.iter().zip(&self.ranges).map(position).collect()
    }
}

/// Evaluation of a hand pose for a cell, without collision and regularization.
struct Judgment {
    cost: f64,
    acceptable: bool,
    good: bool,
}

fn judge(plan: &TableMapPlan, cells: &Cells, wish: &PoseWish, hand: &HandPose) -> Judgment {
    let spacing = cells.spacing();
    let place = [hand.at.x, hand.at.y];
    // (2)
    let height = (hand.at.z - plan.table.height_m - plan.offset).abs();
    // (3): the table's normal points up, the palm down.
    let angle = (-hand.palm.z).clamp(-1.0, 1.0).acos();
    // The root of the sum of squares, not the sum of absolute values: with several equations at
    // once it has no ridges that trap the search.
    let mut squares = (height * COST_PER_METER).powi(2) + (angle / ACCEPT_ANGLE).powi(2);
    let cell = cells.at(place);
    let (inside, off) = match wish.cell {
        None => (cell.is_some(), 0.0),
        Some(wished) => {
            let [x, y] = cells.middle(wished);
            // (4): one step from the nearest pose, and within the empty cell.
            let nearest = cells.nearest(place, 2.0 * spacing);
            let off = (place[0] - x).hypot(place[1] - y);
            squares += ((nearest.min(spacing) - spacing) * COST_PER_METER).powi(2) + (off * COST_PER_METER).powi(2);
            (cell == Some(wished) && nearest >= ACCEPT_SPACING * spacing, off)
        }
    };
    let acceptable = inside && height <= ACCEPT_OFFSET && angle <= ACCEPT_ANGLE;
    let good = acceptable && height <= GOOD_ENOUGH.0 && angle <= GOOD_ENOUGH.1 && off <= GOOD_ENOUGH.2 * spacing;
    Judgment { cost: squares.sqrt(), acceptable, good }
}
