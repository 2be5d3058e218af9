//! A scene compiled for testing many poses.

use crate::compile::{Compiled, RobotFacts, compile};
use crate::edges::Edges;
use crate::intervals::Intervals;
use crate::isa::{InstructionSet, Runner, checked};
use crate::kernel::Block;
use crate::lanes::{LaneMask, WIDTH};
use crate::limits::within_limits;
use crate::program::Program;
use crate::reference::Reference;
use mobee_model::{IndexPair, Scene, random_poses};
use std::sync::Arc;

/// Maximum number of sample poses for the order of tests, and the number per pair: a few pairs need only a few.
const SAMPLE: usize = 4096;
const SAMPLE_PAIR: usize = 8;
/// Number of sample poses for the order of tests with obstacles, if that of the robots' own pairs is already
/// determined.
const SAMPLE_WITH_OBSTACLES: usize = 256;
/// Minimum number of poses of a block that satisfy the constraints for it to be processed at once; fewer wait for
/// others.
const MIN_BLOCK_POSES: u32 = 12;
/// Seed of the samples: equal scenes have equal programs.
const SAMPLE_SEED: u64 = 1;

/// Reason why a scene was not compiled, or poses not checked.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FastError {
    /// The clearance is negative or not finite: the lanes do not measure depths.
    #[error("a clearance of {0} m: it must be a number from 0 on")]
    Clearance(f64),
    /// The processor lacks the instructions.
    #[error("this processor does not have {0:?} instructions: see InstructionSet::available")]
    Instructions(InstructionSet),
    /// The length is not a multiple of a pose's.
    #[error("{given} numbers are not a whole number of poses of {motors} motors")]
    Length {
        /// Length of the input.
        given: usize,
        /// Motors of all robots of the scene.
        motors: usize,
    },
    /// The length is not a multiple of an edge's.
    #[error("{given} numbers are not a whole number of edges: two poses of {motors} motors each")]
    Edges {
        /// Length of the input.
        given: usize,
        /// Motors of all robots of the scene.
        motors: usize,
    },
}

/// Statistics of the compilation, and of the poses checked so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FastFigures {
    /// Requested pairs of shapes: all of the scene, unless it was compiled for some.
    pub pairs: usize,
    /// Of these, pairs that were proved to stay apart at every pose.
    pub pruned: usize,
    /// Poses checked.
    pub poses: u64,
    /// Of these, poses for which the scalar engine was needed.
    pub doubtful: u64,
    /// Intervals of edges checked.
    pub intervals: u64,
    /// Number of pairs on intervals for which the scalar engine was needed.
    pub stuck: u64,
}

/// A scene compiled for one clearance: checks many poses at once.
///
/// Clones share the program and have their own buffers: use one per thread.
///
/// # Example
/// ```
/// use mobee_fast::FastScene;
/// use mobee_model::{Scene, load_robot, random_poses};
/// use nalgebra::Isometry3;
/// use std::sync::Arc;
///
/// let robot = Arc::new(load_robot("../../configs/robots/katana.xml")?.value);
/// let scene = Scene::new(vec![(robot.clone(), Isometry3::identity())], Vec::new())?;
/// let mut fast = FastScene::new(&scene, 0.01)?;
///
/// // A thousand poses, concatenated in one list.
/// let poses: Vec<f64> = random_poses(&robot, 7).take(1000).flatten().collect();
/// let mut free = Vec::new();
/// fast.free(&poses, &mut free)?;
///
/// let first = &poses[..robot.motors.len()];
/// assert_eq!((free.len(), free[0]), (1000, scene.free(&[first], 0.01)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct FastScene {
    pub(crate) program: Arc<Program>,
    pub(crate) clearance: f64,
    pub(crate) runner: Runner,
    pub(crate) block: Block,
    pub(crate) intervals: Intervals,
    pub(crate) edges: Edges,
    pub(crate) reference: Reference,
    /// Facts about the robots, independent of the obstacles.
    facts: Arc<RobotFacts>,
    /// Per cut of the program: the poses that wait there for a full block.
    waiting: Vec<Vec<usize>>,
    pub(crate) figures: FastFigures,
}

impl FastScene {
    /// Compiles a scene with the base poses of its robots and its present obstacles, for the best instruction set of
    /// this processor.
    ///
    /// # Arguments
    /// * `clearance`: as for [`Scene::free`], meters: pairs must be farther apart than this.
    ///
    /// # Errors
    /// If the clearance is negative or not finite.
    ///
    /// # Performance
    /// Ten to thirty milliseconds for a humanoid. Compile again when the world changes.
    pub fn new(scene: &Scene, clearance: f64) -> Result<Self, FastError> {
        Self::with_instructions(scene, clearance, best())
    }

    /// As [`FastScene::new`], with a given instruction set: for tests and measurements.
    ///
    /// # Errors
    /// As [`FastScene::new`], and if the processor lacks the instructions.
    pub fn with_instructions(scene: &Scene, clearance: f64, set: InstructionSet) -> Result<Self, FastError> {
        Self::compiled(scene, scene.pairs().to_vec(), clearance, set, RobotFacts::default())
    }

    /// As [`FastScene::new`], for some pairs only: a robot with itself, with the world, or with one object. Limits and
    /// constraints are checked as before.
    ///
    /// # Arguments
    /// * `select`: true for a pair that is checked, given two indices into [`Scene::colliders`] (see
    ///   [`Scene::shape_id`]). Called for each of [`Scene::pairs`].
    ///
    /// # Errors
    /// As [`FastScene::new`].
    pub fn of_pairs(scene: &Scene, clearance: f64, select: impl Fn(u32, u32) -> bool) -> Result<Self, FastError> {
        let selected = scene.pairs().iter().copied().filter(|(a, b)| select(*a, *b)).collect();
        Self::compiled(scene, selected, clearance, best(), RobotFacts::default())
    }

    /// The same robots among other obstacles, as [`FastScene::of_pairs`]: reuses the facts about the robots themselves,
    /// which are most of the work. Compiles from scratch if the robots or their base poses differ.
    ///
    /// # Errors
    /// As [`FastScene::of_pairs`].
    pub fn among(&self, scene: &Scene, select: impl Fn(u32, u32) -> bool) -> Result<Self, FastError> {
        let before = self.reference.scene();
        let robots = scene.robots();
        let others = before.robots();
        let is_same = robots.len() == others.len()
            && robots.iter().zip(others).all(|(a, b)| Arc::ptr_eq(a, b))
            && (0..robots.len()).all(|r| scene.base(r) == before.base(r));
        let facts = if is_same { RobotFacts::clone(&self.facts) } else { RobotFacts::default() };
        let selected = scene.pairs().iter().copied().filter(|(a, b)| select(*a, *b)).collect();
        Self::compiled(scene, selected, self.clearance, self.runner.set(), facts)
    }

    fn compiled(
        scene: &Scene,
        selected: Vec<IndexPair>,
        clearance: f64,
        set: InstructionSet,
        mut facts: RobotFacts,
    ) -> Result<Self, FastError> {
        if !(0.0..f64::INFINITY).contains(&clearance) {
            return Err(FastError::Clearance(clearance));
        }
        let runner = checked(set).ok_or(FastError::Instructions(set))?;
        let Compiled { program, layout, pruned, mut movers } = compile(scene, &selected, clearance, &mut facts);
        let figures = FastFigures { pairs: selected.len(), pruned, ..FastFigures::default() };
        let block = Block::new(&program);
        let reference = Reference::new(scene, selected);
        let program = Arc::new(program);
        let (intervals, edges) = Default::default();
        let waiting = Vec::new();
        let facts = Arc::new(facts);
        let mut fast =
            FastScene { program, clearance, runner, block, intervals, edges, reference, facts, waiting, figures };
        let decided = fast.count_decisions(scene);
        let program = Arc::make_mut(&mut fast.program);
        layout.write(program, &decided);
        layout.write_motions(program, &mut movers);
        fast.waiting = vec![Vec::new(); program.cuts.len()];
        fast.intervals = Intervals::new(program);
        fast.edges = Edges::new(program);
        Ok(fast)
    }

    /// Number of lanes that each pair decided, at random poses.
    fn count_decisions(&mut self, scene: &Scene) -> Vec<u32> {
        self.block.decided = vec![0; self.program.pairs.len()];
        let mut robots: Vec<_> = scene.robots().iter().map(|robot| random_poses(robot, SAMPLE_SEED)).collect();
        // Without cuts, so that every block runs to the end with all of its lanes.
        Arc::make_mut(&mut self.program).cuts = vec![0, self.program.units.len()];
        let most = if self.facts.decided.is_empty() { SAMPLE } else { SAMPLE_WITH_OBSTACLES };
        let poses = most.min(SAMPLE_PAIR * self.program.pairs.len());
        for _ in 0..poses / WIDTH {
            for lane in 0..WIDTH {
                let pose: Vec<f64> = robots.iter_mut().filter_map(Iterator::next).flatten().collect();
                self.load(lane, &pose);
            }
            let (violated, _) = self.runner.violated(&self.program, &self.block);
            let requested = !violated;
            self.runner.judge(&self.program, &mut self.block, requested, 0);
        }
        let mut decided = std::mem::take(&mut self.block.decided);
        self.share_decisions(scene, &mut decided, poses);
        decided
    }

    /// Stores the counts of the robots' own pairs, or replaces those from a small sample by the stored ones. Counts are
    /// scaled to [`SAMPLE`] poses.
    fn share_decisions(&mut self, scene: &Scene, decided: &mut [u32], poses: usize) {
        let pairs = self.program.pairs.iter().map(|pair| pair.ids).zip(decided.iter_mut());
        if !self.facts.decided.is_empty() {
            let more = SAMPLE / poses.max(1);
            for (pair, lanes) in pairs {
                *lanes = self.facts.decided(pair).unwrap_or(*lanes * more as u32);
            }
            return;
        }
        let is_robot = |shape: u32| scene.shape_id(shape).is_some_and(|id| id.robot().is_some());
        let own = pairs.filter(|((a, b), _)| is_robot(*a) && is_robot(*b));
        let mut known: Vec<(IndexPair, u32)> = own.map(|(pair, lanes)| (pair, *lanes)).collect();
        known.sort_unstable();
        Arc::make_mut(&mut self.facts).decided = known;
    }

    /// The instruction set in use.
    pub fn instructions(&self) -> InstructionSet {
        self.runner.set()
    }

    /// Statistics of the compilation and of the checks.
    pub fn figures(&self) -> FastFigures {
        self.figures
    }

    /// Number of motors of all robots, which is the length of a pose.
    pub fn motors(&self) -> usize {
        self.program.limits.len()
    }

    /// Intersection test of many poses: the result of [`Scene::free`] for each.
    ///
    /// # Arguments
    /// * `poses`: concatenated, each with the motors of all robots in order, rad of encoder.
    /// * `free`: cleared first; one verdict per pose. Does not allocate when reused.
    ///
    /// # Errors
    /// If the numbers are not a whole number of poses.
    pub fn free(&mut self, poses: &[f64], free: &mut Vec<bool>) -> Result<(), FastError> {
        free.clear();
        let motors = self.motors();
        if motors == 0 || !poses.len().is_multiple_of(motors) {
            return Err(FastError::Length { given: poses.len(), motors });
        }
        self.block.forget(&self.program);
        free.resize(poses.len() / motors, false);
        for first in (0..free.len()).step_by(WIDTH) {
            let block: [usize; WIDTH] = std::array::from_fn(|lane| first + lane);
            let block = &block[..WIDTH.min(free.len() - first)];
            let finite = self.load_all(poses, block);
            let (violated, doubtful) = self.runner.violated(&self.program, &self.block);
            for (lane, i) in block.iter().enumerate() {
                if (!finite | doubtful) & !(finite & violated) & 1 << lane != 0 {
                    self.figures.doubtful += 1;
                    free[*i] = self.reference.free(&poses[i * motors..(i + 1) * motors], self.clearance);
                }
            }
            let requested = finite & !violated & !doubtful;
            let mut cut = if requested.count_ones() >= MIN_BLOCK_POSES {
                self.judge_lanes(poses, block, (requested, 0), free)
            } else {
                self.waiting[0]
                    .extend(block.iter().enumerate().filter(|(lane, _)| requested & 1 << lane != 0).map(|(_, i)| i));
                Some(0)
            };
            // The rest of a block that stops may complete a waiting one.
            while let Some(full) = cut.filter(|cut| self.waiting[*cut].len() >= WIDTH) {
                cut = self.judge_waiting(poses, full, free);
            }
        }
        for cut in 0..self.waiting.len() {
            while !self.waiting[cut].is_empty() {
                self.judge_waiting(poses, cut, free);
            }
        }
        self.figures.poses += free.len() as u64;
        Ok(())
    }

    /// Checks a block of the poses that wait at a cut; returns the cut at which the remaining ones wait now, if any.
    fn judge_waiting(&mut self, poses: &[f64], cut: usize, free: &mut [bool]) -> Option<usize> {
        let mut block = [0; WIDTH];
        let count = WIDTH.min(self.waiting[cut].len());
        block.iter_mut().zip(self.waiting[cut].drain(..count)).for_each(|(lane, i)| *lane = i);
        let block = &block[..count];
        let requested = self.load_all(poses, block);
        self.judge_lanes(poses, block, (requested, cut), free)
    }

    /// Checks the poses (given by index) in the lanes, starting at a cut; returns the cut at which the remaining ones
    /// wait now, if any.
    fn judge_lanes(
        &mut self,
        poses: &[f64],
        block: &[usize],
        (requested, cut): (LaneMask, usize),
        free: &mut [bool],
    ) -> Option<usize> {
        let motors = self.motors();
        let (live, stopped) = self.runner.judge(&self.program, &mut self.block, requested, cut);
        let doubtful = self.block.doubts.iter().fold(0, |all, (_, lanes)| all | lanes) & live;
        self.figures.doubtful += u64::from(doubtful.count_ones());
        for (lane, i) in block.iter().enumerate().filter(|(lane, _)| live & 1 << lane != 0) {
            let bit = 1 << lane;
            if doubtful & bit == 0 || !self.doubt_touches(&poses[i * motors..(i + 1) * motors], bit) {
                match stopped {
                    Some(at) => self.waiting[at].push(*i),
                    None => free[*i] = true,
                }
            }
        }
        stopped
    }

    /// Loads poses, given by index, into the lanes.
    ///
    /// # Returns
    /// The lanes with only finite numbers.
    fn load_all(&mut self, poses: &[f64], block: &[usize]) -> LaneMask {
        let motors = self.motors();
        let lanes = block.iter().enumerate();
        lanes.fold(0, |all, (lane, i)| {
            all | LaneMask::from(self.load(lane, &poses[i * motors..(i + 1) * motors])) << lane
        })
    }

    /// True if a pair that is in doubt in this lane touches.
    pub(crate) fn doubt_touches(&mut self, pose: &[f64], lane: LaneMask) -> bool {
        let doubts = self.block.doubts.iter().filter(|(_, lanes)| lanes & lane != 0);
        let pairs = doubts.map(|(pair, _)| self.program.pairs[*pair].ids);
        self.reference.any_touches(pose, pairs, self.clearance)
    }

    /// Loads a pose into a lane, clamped to its limits.
    ///
    /// # Returns
    /// True if its numbers are all finite.
    fn load(&mut self, lane: usize, pose: &[f64]) -> bool {
        let mut finite_check = 0.0;
        for ((row, q), limits) in self.block.motors.iter_mut().zip(pose).zip(&self.program.limits) {
            row.0[lane] = within_limits(*q, *limits);
            finite_check += q * 0.0;
        }
        finite_check == 0.0
    }
}

/// The best instruction set of this processor.
fn best() -> InstructionSet {
    InstructionSet::available().pop().unwrap_or(InstructionSet::Portable)
}
