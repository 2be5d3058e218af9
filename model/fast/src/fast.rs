//! A scene compiled for many poses.

use crate::compile::{Compiled, RobotFacts, compile};
use crate::edges::Edges;
use crate::intervals::Intervals;
use crate::isa::{InstructionSet, Runner, checked};
use crate::kernel::Block;
use crate::lanes::{Mask, WIDTH};
use crate::limits::within_limits;
use crate::program::Program;
use crate::reference::Reference;
use mobee_model::{IndexPair, Scene, random_poses};
use std::sync::Arc;

/// Most poses that the order of tests is learned from, and how many for each pair: few pairs are in order soon.
const SAMPLE: usize = 4096;
const SAMPLE_PAIR: usize = 8;
/// Poses that the order of tests with obstacles is learned from, where that of the robots' own is known.
const SAMPLE_OBSTACLES: usize = 256;
/// Poses of a block that satisfy the constraints and are judged at once; fewer wait for others.
const FULL: u32 = 12;
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
    /// What holds of the robots, whatever stands about them.
    facts: Arc<RobotFacts>,
    /// Per cut of the program: the poses that wait there for a full block.
    waiting: Vec<Vec<usize>>,
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
    /// Ten to thirty milliseconds for a humanoid. Compile anew when the world changes.
    pub fn new(scene: &Scene, clearance: f64) -> Result<Self, FastError> {
        Self::with_instructions(scene, clearance, best())
    }

    /// As [`FastScene::new`], with chosen instructions: for tests and measurements.
    ///
    /// # Errors
    /// As [`FastScene::new`], and if the processor lacks the instructions.
    pub fn with_instructions(scene: &Scene, clearance: f64, set: InstructionSet) -> Result<Self, FastError> {
        Self::compiled(scene, scene.pairs().to_vec(), clearance, set, RobotFacts::default())
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
        Self::compiled(scene, kept, clearance, best(), RobotFacts::default())
    }

    /// The same robots among other obstacles, as [`FastScene::of_pairs`]: what was proved and learned of the robots themselves is
    /// used again, which is most of the work. Compiles from the beginning if the robots are not the same ones at the same
    /// places.
    ///
    /// # Errors
    /// None but for what [`FastScene::of_pairs`] has.
    pub fn among(&self, scene: &Scene, keep: impl Fn(u32, u32) -> bool) -> Result<Self, FastError> {
        let before = self.reference.scene();
        let (robots, others) = (scene.robots(), before.robots());
        let is_same = robots.len() == others.len()
            && robots.iter().zip(others).all(|(a, b)| Arc::ptr_eq(a, b))
            && (0..robots.len()).all(|r| scene.base(r) == before.base(r));
        let facts = if is_same { RobotFacts::clone(&self.facts) } else { RobotFacts::default() };
        let kept = scene.pairs().iter().copied().filter(|(a, b)| keep(*a, *b)).collect();
        Self::compiled(scene, kept, self.clearance, self.runner.set(), facts)
    }

    fn compiled(
        scene: &Scene,
        kept: Vec<IndexPair>,
        clearance: f64,
        set: InstructionSet,
        mut facts: RobotFacts,
    ) -> Result<Self, FastError> {
        if !(0.0..f64::INFINITY).contains(&clearance) {
            return Err(FastError::Clearance(clearance));
        }
        let runner = checked(set).ok_or(FastError::Instructions(set))?;
        let Compiled { program, layout, pruned, mut movers } = compile(scene, &kept, clearance, &mut facts);
        let figures = FastFigures { pairs: kept.len(), pruned, ..FastFigures::default() };
        let block = Block::new(&program);
        let reference = Reference::new(scene, kept);
        let program = Arc::new(program);
        let (intervals, edges) = Default::default();
        let waiting = Vec::new();
        let facts = Arc::new(facts);
        let mut fast =
            FastScene { program, clearance, runner, block, intervals, edges, reference, facts, waiting, figures };
        let decided = fast.evidence(scene);
        let program = Arc::make_mut(&mut fast.program);
        layout.write(program, &decided);
        layout.write_motions(program, &mut movers);
        fast.waiting = vec![Vec::new(); program.cuts.len()];
        (fast.intervals, fast.edges) = (Intervals::new(program), Edges::new(program));
        Ok(fast)
    }

    /// In how many lanes each pair decided, at random poses.
    fn evidence(&mut self, scene: &Scene) -> Vec<u32> {
        self.block.decided = vec![0; self.program.pairs.len()];
        let mut robots: Vec<_> = scene.robots().iter().map(|robot| random_poses(robot, SEED)).collect();
        // All the way with every lane: none goes on elsewhere.
        Arc::make_mut(&mut self.program).cuts = vec![0, self.program.units.len()];
        let most = if self.facts.decided.is_empty() { SAMPLE } else { SAMPLE_OBSTACLES };
        let poses = most.min(SAMPLE_PAIR * self.program.pairs.len());
        for _ in 0..poses / WIDTH {
            for lane in 0..WIDTH {
                let pose: Vec<f64> = robots.iter_mut().filter_map(Iterator::next).flatten().collect();
                self.load(lane, &pose);
            }
            let (violated, _) = self.runner.violated(&self.program, &self.block);
            let asked = !violated;
            self.runner.judge(&self.program, &mut self.block, asked, 0);
        }
        let mut decided = std::mem::take(&mut self.block.decided);
        self.share_evidence(scene, &mut decided, poses);
        decided
    }

    /// Learns of the robots' own pairs, or puts what is known of them in place of what few poses showed. Counts are those of
    /// [`SAMPLE`] poses.
    fn share_evidence(&mut self, scene: &Scene, decided: &mut [u32], poses: usize) {
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
            let asked = finite & !violated & !doubtful;
            let mut cut = if asked.count_ones() >= FULL {
                self.judge_lanes(poses, block, (asked, 0), free)
            } else {
                self.waiting[0]
                    .extend(block.iter().enumerate().filter(|(lane, _)| asked & 1 << lane != 0).map(|(_, i)| i));
                Some(0)
            };
            // A block that stops may fill the next one.
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

    /// Judges a block of those that wait at a cut; returns the cut at which what is left of it waits now, if any.
    fn judge_waiting(&mut self, poses: &[f64], cut: usize, free: &mut [bool]) -> Option<usize> {
        let mut block = [0; WIDTH];
        let count = WIDTH.min(self.waiting[cut].len());
        block.iter_mut().zip(self.waiting[cut].drain(..count)).for_each(|(lane, i)| *lane = i);
        let block = &block[..count];
        let asked = self.load_all(poses, block);
        self.judge_lanes(poses, block, (asked, cut), free)
    }

    /// Judges poses that are in the lanes, by their numbers, from a cut on; returns the cut at which those that are left
    /// wait now, if any.
    fn judge_lanes(
        &mut self,
        poses: &[f64],
        block: &[usize],
        (asked, cut): (Mask, usize),
        free: &mut [bool],
    ) -> Option<usize> {
        let motors = self.motors();
        let (live, stopped) = self.runner.judge(&self.program, &mut self.block, asked, cut);
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

    /// Puts poses into the lanes, by their numbers.
    ///
    /// # Returns
    /// The lanes whose numbers are all finite.
    fn load_all(&mut self, poses: &[f64], block: &[usize]) -> Mask {
        let motors = self.motors();
        let lanes = block.iter().enumerate();
        lanes.fold(0, |all, (lane, i)| all | Mask::from(self.load(lane, &poses[i * motors..(i + 1) * motors])) << lane)
    }

    /// Whether a pair that is in doubt in this lane touches.
    pub(crate) fn doubt_touches(&mut self, pose: &[f64], lane: Mask) -> bool {
        let doubts = self.block.doubts.iter().filter(|(_, lanes)| lanes & lane != 0);
        let pairs = doubts.map(|(pair, _)| self.program.pairs[*pair].ids);
        self.reference.any_touches(pose, pairs, self.clearance)
    }

    /// Puts a pose into a lane, within its limits.
    ///
    /// # Returns
    /// Whether its numbers are all finite.
    fn load(&mut self, lane: usize, pose: &[f64]) -> bool {
        let mut sound = 0.0;
        for ((row, q), limits) in self.block.motors.iter_mut().zip(pose).zip(&self.program.limits) {
            row.0[lane] = within_limits(*q, *limits);
            sound += q * 0.0;
        }
        sound == 0.0
    }
}

/// The best instructions that this processor has.
fn best() -> InstructionSet {
    InstructionSet::available().pop().unwrap_or(InstructionSet::Portable)
}
