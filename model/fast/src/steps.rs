//! The order of tests: from balls around whole hands to single shapes, and the most decisive tests first.
//!
//! ```text
//! hand near arm?             no: next two units
//!   hand beside its tube?    no: next shape of the arm
//!     finger beside it?      no: next finger
//!       place the finger
//!       tip beside it?       no: next
//!         test each pair of shapes
//! ```
//! *Near* compares two balls; *beside* a ball and the axis of the capsule around a shape, which distinguishes a hand
//! from the forearm that carries it.

use crate::bound::TESTS;
use crate::levers::Movers;
use crate::program::{Program, Relative, Step, UnitKey, UnitTest};
use crate::write::StepWriter;
use std::cmp::Reverse;
use std::ops::Range;
use std::sync::Arc;

/// Numbers of unit tests after which a block may stop. They affect only speed.
const CUTS: [usize; 3] = [0, 32, 96];

/// Positions of cuts among this number of units.
pub(crate) fn cuts(units: usize) -> Vec<usize> {
    CUTS.iter().copied().take_while(|cut| *cut < units).chain([units]).collect()
}

/// Score of a unit with this number of decided lanes and of pairs: relative to its cost, since a few pairs may decide as
/// often as many.
pub(crate) fn score(decided: u32, pairs: usize) -> Reverse<u32> {
    Reverse(decided * 1000 / (4 + pairs as u32))
}

/// The largest things that are tested as one: a region, or a group outside all regions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Unit {
    Region(usize),
    Group(usize),
}

/// Input for writing the steps.
#[derive(Clone, Debug)]
pub(crate) struct StepLayout {
    clearance: f64,
    /// Per group: its region, if it belongs to one.
    region: Vec<Option<usize>>,
    pub groups: Vec<Range<usize>>,
    /// Per branch of a region, and group: true if the group belongs to it.
    branches: Vec<Vec<bool>>,
    /// Radius and error of each ball: groups, then regions, then branches.
    balls: Vec<(f64, f64)>,
    pub solids: Vec<BoundSizes>,
}

/// Sizes of a solid's bounds, meters.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BoundSizes {
    /// Radius of the bounding ball.
    pub ball: f64,
    /// Half length and radius of the bounding capsule.
    pub half: f64,
    pub radius: f64,
    /// Bound of the displacement of any of its points by rounding.
    pub error: f64,
    /// For a box: error bound of its axes (spectral norm).
    pub turn: Option<f64>,
}

impl StepLayout {
    pub fn new(groups: &[Range<usize>], clearance: f64) -> Self {
        StepLayout {
            clearance,
            region: Vec::new(),
            groups: groups.to_vec(),
            branches: Vec::new(),
            balls: Vec::new(),
            solids: Vec::new(),
        }
    }

    /// The general clearance, meters.
    pub fn clearance(&self) -> f64 {
        self.clearance
    }

    /// Adds a ball, in the program's order; that of a group comes with the group's region, if any.
    pub fn add_ball(&mut self, radius: f64, error: f64, region: Option<Option<usize>>) {
        self.balls.push((radius, error));
        self.region.extend(region);
    }

    /// Computes the relative motions for all tests, after these have been ordered; and for objects those of every mover
    /// relative to the world, which are returned.
    pub fn write_motions(&self, program: &mut Program, movers: &mut Movers, has_objects: bool) -> Vec<Relative> {
        let solid = |s: u32| self.balls.len() + s as usize;
        program.unit_motions = program.units.iter().map(|unit| movers.between(unit.a, unit.b)).collect();
        let code = Arc::make_mut(&mut program.robots);
        let of_step = |step: &Step| match *step {
            Step::Near { a, b, .. } => movers.between(a as usize, b as usize),
            Step::Beside { ball, of, .. } => movers.between(ball as usize, solid(of)),
            Step::Pair(p) => movers.between(solid(code.pairs[p].a), solid(code.pairs[p].b)),
            Step::Region(_) | Step::Group(_) => Relative::default(),
        };
        code.motions = code.steps.iter().map(of_step).collect();
        let count = if has_objects { movers.movers.len() } else { 0 };
        let in_world: Vec<Relative> = (0..count).map(|mover| movers.in_world(mover)).collect();
        program.sums = movers.sums.clone();
        program.levers = movers.levers.clone();
        let motors = program.limits.len();
        program.reach = vec![0.0; motors];
        let mut both = vec![0.0; motors];
        for between in program.unit_motions.iter().chain(&code.motions).chain(&in_world) {
            let levers = between.sums.iter().flat_map(|sum| &program.levers[program.sums[*sum as usize].clone()]);
            levers.clone().for_each(|lever| both[lever.motor] += f64::from(lever.reach));
            for lever in levers {
                let reach = &mut program.reach[lever.motor];
                *reach = reach.max(std::mem::take(&mut both[lever.motor]));
            }
        }
        in_world
    }

    /// Adds the groups of a branch; its ball must have been added last.
    pub fn add_branch(&mut self, has: impl Iterator<Item = bool>) {
        self.branches.push(has.collect());
    }

    /// The branch of a region to which a group belongs.
    pub fn branch(&self, group: usize) -> Option<usize> {
        self.branches.iter().position(|has| has[group])
    }

    /// The ball of a group's branch, or the group's own ball if it has none.
    pub fn part_ball(&self, group: usize) -> usize {
        let first = self.balls.len() - self.branches.len();
        self.branch(group).map_or(group, |branch| first + branch)
    }

    /// Writes the program's unit tests and their steps, given the number of lanes that each pair decided.
    pub fn write(&self, program: &mut Program, decided: &[u32]) {
        let mut writer = StepWriter::new(self, program, decided);
        let mut units = writer.by((0..program.robots.pairs.len()).collect(), |w, p| w.units(p));
        units.sort_by_key(|(_, pairs)| score(writer.decided(pairs), pairs.len()));
        let (mut tests, mut keys) = (Vec::new(), Vec::new());
        for (number, ((u, v), pairs)) in (0..).zip(units) {
            let first = writer.steps.len();
            keys.push(UnitKey { score: score(writer.decided(&pairs), pairs.len()), object: None, number });
            writer.two_units((u, v), pairs);
            let a = self.unit_ball(u);
            let b = self.unit_ball(v);
            let steps = first..writer.steps.len();
            tests.push(UnitTest { a, b, within_squared: self.within_squared(a, b), is_object: false, steps });
        }
        let steps = writer.steps;
        program.cuts = cuts(tests.len());
        program.units = tests;
        program.unit_keys = keys;
        Arc::make_mut(&mut program.robots).steps = steps;
    }

    pub fn unit(&self, group: usize) -> Unit {
        self.region[group].map_or(Unit::Group(group), Unit::Region)
    }

    pub fn unit_ball(&self, unit: Unit) -> usize {
        match unit {
            Unit::Group(g) => g,
            Unit::Region(r) => self.groups.len() + r,
        }
    }

    /// Squared distance of centers of balls (or solids, numbered after them) above which nothing of the two can touch.
    pub fn within_squared(&self, a: usize, b: usize) -> f32 {
        self.near_squared(a, self.ball(b))
    }

    /// Radius and error of a ball, or of that around a solid.
    pub fn ball(&self, i: usize) -> (f64, f64) {
        match i.checked_sub(self.balls.len()) {
            Some(solid) => (self.solids[solid].ball, self.solids[solid].error),
            None => self.balls[i],
        }
    }

    /// As [`StepLayout::within_squared`], for another ball, given by its radius and error.
    pub fn near_squared(&self, a: usize, (s, f): (f64, f64)) -> f32 {
        let (r, e) = self.ball(a);
        let within = (r + s + self.clearance) * (1.0 + TESTS) + e + f;
        (within * within * (1.0 + TESTS)) as f32
    }

    /// Squared distance of a ball's center (given its radius and error) from the axis of a solid's capsule, or from a box itself, above which
    /// nothing of the two can touch.
    ///
    /// The solid's error counts twice: for the position of its axis, and for the search of the nearest point on it. For
    /// a box the center may be farther away than the box's own size, so the error of its axes counts along this
    /// complete distance.
    pub fn beside_squared(&self, (r, e): (f64, f64), solid: &BoundSizes) -> f32 {
        let (radius, beyond, share) =
            solid.turn.map_or((solid.radius, solid.half, TESTS), |turn| (0.0, solid.ball, TESTS + turn));
        let within = r + radius + self.clearance;
        let within = within + (within + beyond) * share + e + 2.0 * solid.error;
        (within * within * (1.0 + TESTS)) as f32
    }
}
