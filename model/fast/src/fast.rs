//! A scene compiled for testing many poses.

use crate::edges::Edges;
use crate::intervals::Intervals;
use crate::isa::{InstructionSet, Runner, checked};
use crate::kernel::Block;
use crate::lanes::{LaneMask, WIDTH};
use crate::limits::within_limits;
use crate::objects::Objects;
use crate::program::Program;
use crate::reference::Reference;
use crate::robots::{RobotProgram, RobotPrograms, RobotTests};
use mobee_model::Scene;
use std::sync::Arc;

/// Minimum number of poses of a block that satisfy the constraints for it to be processed at once; fewer wait for
/// others.
const MIN_BLOCK_POSES: u32 = 12;
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
    /// Programs of the robots, independent of the obstacles.
    programs: Arc<RobotPrograms>,
    robots: Arc<RobotProgram>,
    objects: Objects,
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
    /// Ten to thirty milliseconds for a humanoid, more with hulls. When the world changes, use
    /// [`FastScene::set_scene`] or [`FastScene::among`].
    pub fn new(scene: &Scene, clearance: f64) -> Result<Self, FastError> {
        Self::with_instructions(scene, clearance, best())
    }

    /// As [`FastScene::new`], with a given instruction set: for tests and measurements.
    ///
    /// # Errors
    /// As [`FastScene::new`], and if the processor lacks the instructions.
    pub fn with_instructions(scene: &Scene, clearance: f64, set: InstructionSet) -> Result<Self, FastError> {
        Self::compiled(scene, &|_, _| true, clearance, set, Arc::default())
    }

    /// As [`FastScene::new`], for some pairs only: a robot with itself, with the world, or with one object. Limits and
    /// constraints are checked as before.
    ///
    /// # Arguments
    /// * `select`: true for a pair that is checked, given two indices into [`Scene::colliders`] (see
    ///   [`Scene::shape_id`]) of [`Scene::pairs`].
    ///
    /// # Errors
    /// As [`FastScene::new`].
    pub fn of_pairs(scene: &Scene, clearance: f64, select: impl Fn(u32, u32) -> bool) -> Result<Self, FastError> {
        Self::compiled(scene, &select, clearance, best(), Arc::default())
    }

    /// The same robots among other obstacles, as [`FastScene::of_pairs`]: the program of the robots is shared, and only
    /// the objects are added to it. Compiles from scratch if the robots or their base poses differ.
    ///
    /// # Errors
    /// As [`FastScene::of_pairs`].
    pub fn among(&self, scene: &Scene, select: impl Fn(u32, u32) -> bool) -> Result<Self, FastError> {
        let is_same = scene.has_robots_of(self.reference.scene());
        let programs = if is_same { self.programs.clone() } else { Arc::default() };
        Self::compiled(scene, &select, self.clearance, self.runner.set(), programs)
    }

    /// Continues with another scene, such as one after an edit: equals [`FastScene::among`], but only what belongs to
    /// changed objects is replaced, if the scenes differ in objects only. Cheap unless a clone shares the program.
    ///
    /// # Arguments
    /// * `select`: as for [`FastScene::of_pairs`]; same results as before for unchanged objects.
    ///
    /// # Errors
    /// As [`FastScene::of_pairs`].
    pub fn set_scene(&mut self, scene: &Scene, select: impl Fn(u32, u32) -> bool) -> Result<(), FastError> {
        let has_objects = |scene: &Scene| scene.colliders().len() > scene.robot_colliders();
        let before = self.reference.scene();
        if !scene.differs_in_objects_only(before) || has_objects(scene) != has_objects(before) {
            *self = self.among(scene, select)?;
            return Ok(());
        }
        let program = Arc::make_mut(&mut self.program);
        if !self.objects.update(&self.robots, program, &mut self.block, scene, &select) {
            *self = self.among(scene, select)?;
            return Ok(());
        }
        self.reference.set_scene(scene);
        self.refit();
        Ok(())
    }

    fn compiled(
        scene: &Scene,
        select: &impl Fn(u32, u32) -> bool,
        clearance: f64,
        set: InstructionSet,
        programs: Arc<RobotPrograms>,
    ) -> Result<Self, FastError> {
        if !(0.0..f64::INFINITY).contains(&clearance) {
            return Err(FastError::Clearance(clearance));
        }
        let runner = checked(set).ok_or(FastError::Instructions(set))?;
        let robots = programs.program(scene, RobotTests::of(scene, clearance, select), clearance, runner);
        let mut program = robots.program.clone();
        let mut block = Block::new(&program);
        let mut objects = Objects::default();
        objects.update(&robots, &mut program, &mut block, scene, select);
        let mut fast = FastScene {
            clearance,
            runner,
            block,
            intervals: Intervals::new(&program),
            edges: Edges::default(),
            program: Arc::new(program),
            reference: Reference::new(scene),
            programs,
            robots,
            objects,
            waiting: Vec::new(),
            figures: FastFigures::default(),
        };
        fast.refit();
        Ok(fast)
    }

    /// Fits buffers and figures to a changed program.
    fn refit(&mut self) {
        self.waiting.resize(self.program.cuts.len(), Vec::new());
        self.edges.fit(&self.program);
        let (selected, kept) = self.objects.pairs();
        self.figures.pairs = self.robots.tests.pairs.len() + selected;
        self.figures.pruned = self.robots.pruned + selected - kept;
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
                    free[*i] = {
                        let pairs = self.program.tested_pairs();
                        self.reference.free(&poses[i * motors..(i + 1) * motors], pairs, self.clearance)
                    };
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
        let pairs = doubts.map(|(pair, _)| self.program.ids(*pair));
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
