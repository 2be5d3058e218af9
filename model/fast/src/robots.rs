//! The robots of a scene, compiled once for all objects that may be among them.

use crate::compile::{Compiled, RobotFacts, compile};
use crate::isa::Runner;
use crate::kernel::Block;
use crate::lanes::{LaneMask, WIDTH};
use crate::levers::Slip;
use crate::limits::within_limits;
use crate::program::{Joint, Program, Relative};
use crate::solids::PairSide;
use crate::steps::{StepLayout, Unit, cuts};
use crate::sweep::Sphere;
use crate::vector::Rows3;
use mobee_model::{IndexPair, Scene, random_poses};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

/// Maximum number of sample poses for the order of tests, and the number per pair: a few pairs need only a few.
const SAMPLE: usize = 4096;
const SAMPLE_PAIR: usize = 8;
/// Number of blocks of sample poses that rate an object.
const RATING_BLOCKS: usize = 4;
/// Number of poses of the complete sample for which one of these stands.
pub(crate) const RATED_POSES: f32 = (SAMPLE / (RATING_BLOCKS * WIDTH)) as f32;
/// Seed of the samples: equal scenes have equal programs.
const SAMPLE_SEED: u64 = 1;
/// Maximum number of stored programs of the same robots.
const MAX_PROGRAMS: usize = 4;
/// Distance of a pose that violates a constraint from everything, meters: it does not count for the order.
const FAR_M: f32 = 1e9;

/// Programs of the same robots for one clearance, shared by all scenes that are derived from one.
#[derive(Debug, Default)]
pub(crate) struct RobotPrograms {
    stored: Mutex<(Option<RobotFacts>, Vec<Arc<RobotProgram>>)>,
}

/// The part of a scene that a program of robots depends on.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct RobotTests {
    /// Pairs of the robots' solids to check.
    pub pairs: Vec<IndexPair>,
    /// Those with a clearance of their own, meters.
    near: Vec<(IndexPair, f64)>,
    /// Per robot: true if it is checked with any object.
    pub meets: Vec<bool>,
}

/// A program of robots without objects, and the data for adding objects.
#[derive(Debug)]
pub(crate) struct RobotProgram {
    pub tests: RobotTests,
    pub program: Program,
    pub layout: StepLayout,
    /// Number of pairs that were proved to stay apart.
    pub pruned: usize,
    /// Per collider of the robots: its solid in the program, if it has one.
    pub place: Vec<Option<usize>>,
    /// Per solid: sizes, and a ball that contains it at every pose, world frame.
    pub sides: Vec<PairSide>,
    pub swept: Vec<Sphere>,
    /// Per ball and solid: its motion in the world.
    pub in_world: Vec<Relative>,
    /// Units that may meet objects.
    pub units: Vec<RobotUnit>,
    /// Number of the frame of the world.
    pub world: usize,
    /// All joints, and the number of those that no region places on demand.
    joints: Vec<Joint>,
    placed: usize,
    slip: Slip,
}

/// A unit of a robot that objects are tested against.
#[derive(Debug)]
pub(crate) struct RobotUnit {
    pub unit: Unit,
    pub ball: usize,
    /// The groups of one finger each, or of the whole unit.
    pub parts: Vec<UnitPart>,
    /// Centers of its ball at sample poses.
    pub samples: Vec<Rows3>,
}

/// A part of a unit.
#[derive(Debug)]
pub(crate) struct UnitPart {
    /// Ball around all of it.
    pub ball: usize,
    pub groups: Vec<PartGroup>,
}

/// A group of solids of a part.
#[derive(Debug)]
pub(crate) struct PartGroup {
    pub group: usize,
    /// The branch that carries it, if it is placed on demand.
    pub branch: Option<usize>,
    /// Its solids, the largest first.
    pub solids: Vec<usize>,
}

impl RobotTests {
    /// The tests of a scene; `select` is called for the pairs of robots, and for those with objects until one is
    /// selected.
    pub fn of(scene: &Scene, clearance: f64, select: &impl Fn(u32, u32) -> bool) -> Self {
        let robots = scene.robot_colliders() as u32;
        let pairs: Vec<IndexPair> =
            scene.pairs().iter().copied().filter(|(a, b)| *b < robots && select(*a, *b)).collect();
        let own = |pair: &IndexPair| Some((*pair, scene.pair_clearance(*pair, clearance)));
        let near = pairs.iter().filter_map(own).filter(|(_, own)| *own < clearance).collect();
        let mut meets = vec![false; scene.robots().len()];
        let objects = robots..scene.colliders().len() as u32;
        for a in scene.tested_colliders() {
            if let Some(meets) = robot_of(scene, *a).and_then(|robot| meets.get_mut(robot)) {
                *meets |= objects.clone().any(|b| select(*a, b));
            }
        }
        RobotTests { pairs, near, meets }
    }
}

/// The robot of a collider.
pub(crate) fn robot_of(scene: &Scene, collider: u32) -> Option<usize> {
    scene.shape_id(collider).and_then(|id| id.robot())
}

impl RobotPrograms {
    /// The program for these tests, compiled unless it is stored.
    pub fn program(&self, scene: &Scene, tests: RobotTests, clearance: f64, runner: Runner) -> Arc<RobotProgram> {
        let mut stored = self.stored.lock().unwrap_or_else(PoisonError::into_inner);
        let (facts, programs) = &mut *stored;
        if let Some(known) = programs.iter().find(|known| known.tests == tests) {
            return known.clone();
        }
        let facts = facts.get_or_insert_with(|| RobotFacts::new(scene));
        let new = Arc::new(RobotProgram::new(scene, tests, clearance, runner, facts));
        if programs.len() >= MAX_PROGRAMS {
            programs.remove(0);
        }
        programs.push(new.clone());
        new
    }
}

impl RobotProgram {
    fn new(scene: &Scene, tests: RobotTests, clearance: f64, runner: Runner, facts: &mut RobotFacts) -> Self {
        let meets = |a: &u32| robot_of(scene, *a).is_some_and(|robot| tests.meets.get(robot) == Some(&true));
        let tested: Vec<u32> = scene.tested_colliders().iter().copied().filter(meets).collect();
        let has_objects = !tested.is_empty();
        let Compiled { mut program, layout, pruned, mut movers, order } =
            compile(scene, &tests.pairs, &tested, clearance, facts);
        let mut units = if has_objects { robot_units(&program, &layout) } else { Vec::new() };
        let decided = count_decisions(scene, &mut program, runner, &mut units);
        layout.write(&mut program, &decided);
        let in_world = layout.write_motions(&mut program, &mut movers, has_objects);
        let mut place = vec![None; scene.robot_colliders()];
        order.iter().enumerate().for_each(|(i, s)| place[*s] = Some(i));
        let placed = program.regions.first().map_or(0, |first| first.end);
        let joints = program.joints.clone();
        let mut robots = RobotProgram {
            tests,
            layout,
            pruned,
            place,
            sides: order.iter().map(|s| facts.sized[*s].side()).collect(),
            swept: order.iter().map(|s| facts.swept[*s]).collect(),
            in_world,
            units,
            world: program.frames - 1,
            joints,
            placed,
            slip: movers.slip(),
            program: Program::default(),
        };
        robots.complete(&mut program, 0.0);
        robots.program = program;
        robots
    }

    /// Completes a program after its units have changed.
    ///
    /// # Arguments
    /// * `far`: maximum distance of any object's points from the world's origin, meters.
    pub fn complete(&self, program: &mut Program, far: f64) {
        program.cuts = cuts(program.units.len());
        program.slips.clear();
        program.slips.resize(program.limits.len(), 0.0);
        let slip = self.slip.among(far);
        self.joints.iter().for_each(|j| program.slips[j.motor] += (slip * j.gain.abs()) as f32);
        self.place_needed(program);
    }

    /// Omits joints that carry nothing that is tested.
    fn place_needed(&self, program: &mut Program) {
        let mut needed = vec![false; program.frames];
        let frame = |center: usize| match center.checked_sub(program.balls.len()) {
            Some(solid) => program.solids[solid].frame,
            None => program.balls[center].frame,
        };
        program.units.iter().for_each(|unit| (needed[frame(unit.a)], needed[frame(unit.b)]) = (true, true));
        let (always, on_demand) = self.joints.split_at(self.placed);
        for joint in always.iter().rev() {
            needed[joint.parent] |= needed[joint.frame];
        }
        let placed = |joints: &[Joint]| joints.iter().filter(|joint| needed[joint.frame]).map(|j| j.frame).collect();
        let now: Vec<usize> = placed(always);
        let region = program.regions.first().map_or(0..0, Range::clone);
        if program.joints[region.clone()].iter().map(|joint| joint.frame).eq(now) {
            return;
        }
        let before = region.end;
        program.joints = always.iter().filter(|joint| needed[joint.frame]).chain(on_demand).cloned().collect();
        let after = program.joints.len() - on_demand.len();
        for region in program.regions.iter_mut().skip(1) {
            *region = region.start - before + after..region.end - before + after;
        }
        if let Some(first) = program.regions.first_mut() {
            *first = 0..after;
        }
    }
}

/// The units that objects are tested against.
fn robot_units(program: &Program, layout: &StepLayout) -> Vec<RobotUnit> {
    let mut units = BTreeMap::<Unit, BTreeMap<usize, Vec<PartGroup>>>::new();
    for (group, range) in layout.groups.iter().enumerate().filter(|(g, _)| !program.groups[*g].fixed) {
        let mut solids: Vec<usize> = range.clone().collect();
        // A large shape is likely to decide.
        solids.sort_by(|a, b| layout.solids[*b].ball.total_cmp(&layout.solids[*a].ball));
        let parts = units.entry(layout.unit(group)).or_default();
        let branch = layout.branch(group);
        parts.entry(layout.part_ball(group)).or_default().push(PartGroup { group, branch, solids });
    }
    let part = |(ball, groups)| UnitPart { ball, groups };
    let unit = |(unit, parts): (Unit, BTreeMap<_, _>)| {
        let parts = parts.into_iter().map(part).collect();
        RobotUnit { unit, ball: layout.unit_ball(unit), parts, samples: Vec::new() }
    };
    units.into_iter().map(unit).collect()
}

/// Number of lanes that each pair decided, at random poses; also samples the positions of units.
fn count_decisions(scene: &Scene, program: &mut Program, runner: Runner, units: &mut [RobotUnit]) -> Vec<u32> {
    let mut block = Block::new(program);
    block.decided = vec![0; program.pairs()];
    // Without cuts, so that every block runs to the end with all of its lanes.
    program.cuts = vec![0, program.units.len()];
    let mut robots: Vec<_> = scene.robots().iter().map(|robot| random_poses(robot, SAMPLE_SEED)).collect();
    let rating = if units.is_empty() { 0 } else { RATING_BLOCKS };
    for i in 0..(SAMPLE.min(SAMPLE_PAIR * program.pairs()) / WIDTH).max(rating) {
        for lane in 0..WIDTH {
            let pose = robots.iter_mut().filter_map(Iterator::next).flatten();
            for ((row, q), limits) in block.motors.iter_mut().zip(pose).zip(&program.limits) {
                row.0[lane] = within_limits(q, *limits);
            }
        }
        let (violated, _) = runner.violated(program, &block);
        let requested: LaneMask = !violated;
        runner.judge(program, &mut block, requested, 0);
        for unit in units.iter_mut().filter(|_| i < RATING_BLOCKS) {
            let mut centers = block.centers[unit.ball];
            (0..WIDTH).filter(|lane| violated >> lane & 1 != 0).for_each(|lane| centers[0].0[lane] = FAR_M);
            unit.samples.push(centers);
        }
    }
    block.decided
}
