//! A scene compiled for many poses.

use crate::compile::{Compiled, compile};
use crate::edges::Edges;
use crate::intervals::Intervals;
use crate::isa::{InstructionSet, Runner, checked};
use crate::kernel::Block;
use crate::lanes::{Mask, WIDTH};
use crate::program::Program;
use crate::reference::Reference;
use mobee_model::{IndexPair, Scene, random_poses};
use std::sync::Arc;

/// Most poses that the order of tests is learned from, and how many for each pair: few pairs are in order soon.
const SAMPLE: usize = 4096;
const SAMPLE_PAIR: usize = 8;
/// Their seed: equal scenes have equal programs.
const SEED: u64 = 1;

/// Why a scene was not compiled, or poses not judged.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FastError {
    /// Depths are not measured in lanes.
    #[error("a clearance of {0} m: it must be a number from 0 on")]
    Clearance(f64),
    /// The processor lacks them.
    #[error("this processor does not have {0:?} instructions: see InstructionSet::available")]
    Instructions(InstructionSet),
    /// A length that is no multiple of a pose's.
    #[error("{given} numbers are not a whole number of poses of {motors} motors")]
    Length {
        /// How many numbers there were.
        given: usize,
        /// Motors of all robots of the scene.
        motors: usize,
    },
    /// A length that is no multiple of an edge's.
    #[error("{given} numbers are not a whole number of edges: two poses of {motors} motors each")]
    Edges {
        /// How many numbers there were.
        given: usize,
        /// Motors of all robots of the scene.
        motors: usize,
    },
}

/// What a scene was compiled to, and what became of the poses so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FastFigures {
    /// Pairs of shapes that were asked for: all of the scene, unless it was compiled for some.
    pub pairs: usize,
    /// Of these, the ones that were proved to keep apart at every pose.
    pub pruned: usize,
    /// Poses judged.
    pub poses: u64,
    /// Of these, the ones that the scalar engine was asked about.
    pub doubtful: u64,
    /// Intervals of edges judged.
    pub intervals: u64,
    /// How often the scalar engine was asked about a pair on one.
    pub stuck: u64,
}

/// A scene compiled for one clearance: judges many poses at once.
///
/// Copies share the program and have buffers of their own: one for each thread.
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
/// // A thousand poses, one after the other in one list.
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
    pub(crate) figures: FastFigures,
}

impl FastScene {
    /// Compiles a scene with its robots where they stand and its obstacles as they are, for the best instructions of
    /// this processor.
    ///
    /// # Arguments
    /// * `clearance`: as for [`Scene::free`], meters: pairs must be farther apart.
    ///
    /// # Errors
    /// If the clearance is negative or not finite.
    ///
    /// # Performance
    /// Ten milliseconds for a humanoid. Compile anew when the world changes.
    pub fn new(scene: &Scene, clearance: f64) -> Result<Self, FastError> {
        Self::with_instructions(scene, clearance, best())
    }

    /// As [`FastScene::new`], with chosen instructions: for tests and measurements.
    ///
    /// # Errors
    /// As [`FastScene::new`], and if the processor lacks the instructions.
    pub fn with_instructions(scene: &Scene, clearance: f64, set: InstructionSet) -> Result<Self, FastError> {
        Self::compiled(scene, scene.pairs().to_vec(), clearance, set)
    }

    /// As [`FastScene::new`], for some pairs alone: a robot with itself, with the world, or with one object. Limits and
    /// constraints count as before.
    ///
    /// # Arguments
    /// * `keep`: whether a pair counts, by two indices into [`Scene::colliders`] ([`Scene::shape_id`] says who they are).
    ///   It is asked about each of [`Scene::pairs`].
    ///
    /// # Errors
    /// As [`FastScene::new`].
    pub fn of_pairs(scene: &Scene, clearance: f64, keep: impl Fn(u32, u32) -> bool) -> Result<Self, FastError> {
        let kept = scene.pairs().iter().copied().filter(|(a, b)| keep(*a, *b)).collect();
        Self::compiled(scene, kept, clearance, best())
    }

    fn compiled(scene: &Scene, kept: Vec<IndexPair>, clearance: f64, set: InstructionSet) -> Result<Self, FastError> {
        if !(0.0..f64::INFINITY).contains(&clearance) {
            return Err(FastError::Clearance(clearance));
        }
        let runner = checked(set).ok_or(FastError::Instructions(set))?;
        let Compiled { program, layout, pruned, mut movers } = compile(scene, &kept, clearance);
        let figures = FastFigures { pairs: kept.len(), pruned, ..FastFigures::default() };
        let block = Block::new(&program);
        let reference = Reference::new(scene, kept);
        let program = Arc::new(program);
        let (intervals, edges) = Default::default();
        let mut fast = FastScene { program, clearance, runner, block, intervals, edges, reference, figures };
        let decided = fast.evidence(scene);
        let program = Arc::make_mut(&mut fast.program);
        layout.write(program, &decided);
        layout.write_motions(program, &mut movers);
        (fast.intervals, fast.edges) = (Intervals::new(program), Edges::new(program));
        Ok(fast)
    }

    /// In how many lanes each pair decided, at random poses.
    fn evidence(&mut self, scene: &Scene) -> Vec<u32> {
        self.block.decided = vec![0; self.program.pairs.len()];
        let mut robots: Vec<_> = scene.robots().iter().map(|robot| random_poses(robot, SEED)).collect();
        for _ in 0..SAMPLE.min(SAMPLE_PAIR * self.program.pairs.len()) / WIDTH {
            let poses: Vec<f64> = (0..WIDTH)
                .flat_map(|_| robots.iter_mut().filter_map(Iterator::next).flatten().collect::<Vec<_>>())
                .collect();
            let asked = self.load(&poses);
            self.runner.judge(&self.program, &mut self.block, asked);
        }
        std::mem::take(&mut self.block.decided)
    }

    /// The instructions that it runs with.
    pub fn instructions(&self) -> InstructionSet {
        self.runner.set()
    }

    /// What was compiled and judged.
    pub fn figures(&self) -> FastFigures {
        self.figures
    }

    /// Motors of all robots: how many numbers a pose has.
    pub fn motors(&self) -> usize {
        self.program.limits.len()
    }

    /// Intersection test of many poses: for each, what [`Scene::free`] says of it.
    ///
    /// # Arguments
    /// * `poses`: one after the other, each with the motors of all robots in order, rad of encoder.
    /// * `free`: emptied first; one verdict per pose. Does not allocate when it is used again.
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
        for poses in poses.chunks(motors * WIDTH) {
            let count = poses.len() / motors;
            let all = Mask::MAX >> (WIDTH - count);
            let finite = self.load(poses) & all;
            let touching = self.runner.judge(&self.program, &mut self.block, finite);
            let open = self.open(all & !touching) | (all & !finite);
            for (lane, pose) in poses.chunks_exact(motors).enumerate() {
                let bit = 1 << lane;
                free.push(touching & bit == 0 && (open & bit == 0 || self.decide(pose, bit, finite & bit != 0)));
            }
            self.figures.poses += count as u64;
            self.figures.doubtful += u64::from(open.count_ones());
        }
        Ok(())
    }

    /// Lanes in doubt, among those that do not touch.
    fn open(&self, among: Mask) -> Mask {
        let pairs = self.block.doubts.iter().fold(0, |all, (_, lanes)| all | lanes);
        among & (pairs | self.block.doubtful_constraints)
    }

    /// Whether the pose in a lane that is in doubt is free.
    fn decide(&mut self, pose: &[f64], lane: Mask, finite: bool) -> bool {
        if !finite {
            return self.reference.free(pose, self.clearance);
        }
        if self.block.doubtful_constraints & lane != 0 && !self.reference.satisfies_constraints(pose) {
            return false;
        }
        let doubts = self.block.doubts.iter().filter(|(_, lanes)| lanes & lane != 0);
        let pairs = doubts.map(|(pair, _)| self.program.pairs[*pair].ids);
        !self.reference.any_touches(pose, pairs, self.clearance)
    }

    /// Fills the block with poses, at most [`WIDTH`] of them; what is missing is as it was.
    ///
    /// # Returns
    /// The lanes whose numbers are all finite.
    fn load(&mut self, poses: &[f64]) -> Mask {
        let mut finite = Mask::MAX;
        for (lane, pose) in poses.chunks_exact(self.program.limits.len()).enumerate() {
            let mut sound = 0.0;
            for ((row, q), (low, high)) in self.block.motors.iter_mut().zip(pose).zip(&self.program.limits) {
                row.0[lane] = if q > low { if q < high { *q } else { *high } } else { *low };
                sound += q * 0.0;
            }
            if sound != 0.0 {
                finite &= !(1 << lane);
            }
        }
        finite
    }
}

/// The best instructions that this processor has.
fn best() -> InstructionSet {
    InstructionSet::available().pop().unwrap_or(InstructionSet::Portable)
}
