//! The order of tests: from balls around whole hands to single shapes, and what decides most often first.
//!
//! ```text
//! hand near arm?             no: on to the next two
//!   hand beside its tube?    no: on to the arm's next shape
//!     finger beside it?      no: on
//!       place the finger
//!       tip beside it?       no: on
//!         test each pair of shapes
//! ```
//! *Near* compares two balls; *beside* a ball and the axis of the capsule that holds a shape, which tells a hand from the
//! forearm that carries it.

use crate::bound::TESTS;
use crate::levers::Movers;
use crate::program::{Program, Relative, Step, UnitTest};
use crate::write::Writer;
use std::ops::Range;

/// Pairs of units after which a block may stop. A matter of speed alone.
const CUTS: [usize; 3] = [0, 32, 96];

/// What is tested as one at first: a whole region, or one group.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Unit {
    Region(usize),
    Group(usize),
}

/// What steps are made of.
#[derive(Clone, Debug)]
pub(crate) struct Layout {
    clearance: f64,
    /// Per group: its region, if it is in one.
    region: Vec<Option<usize>>,
    pub groups: Vec<Range<usize>>,
    /// Per branch of a region, and group: whether it is in it.
    branches: Vec<Vec<bool>>,
    /// Radius and error of each ball: groups, then regions, then branches.
    balls: Vec<(f64, f64)>,
    pub solids: Vec<Size>,
}

/// What a solid is held by, meters.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Size {
    /// The ball's radius.
    pub ball: f64,
    /// The capsule's half length and radius.
    pub half: f64,
    pub radius: f64,
    /// How far rounding displaces any of its points.
    pub error: f64,
    /// Of a box: by how much rounding can be wrong about its axes (spectral norm).
    pub turn: Option<f64>,
}

impl Layout {
    pub fn new(groups: &[Range<usize>], clearance: f64) -> Self {
        Layout {
            clearance,
            region: Vec::new(),
            groups: groups.to_vec(),
            branches: Vec::new(),
            balls: Vec::new(),
            solids: Vec::new(),
        }
    }

    /// Balls come in the program's order; those of groups with the region that the group is in, if any.
    pub fn add_ball(&mut self, radius: f64, error: f64, region: Option<Option<usize>>) {
        self.balls.push((radius, error));
        self.region.extend(region);
    }

    /// Writes how far the two of each test move against each other, once tests have their order.
    pub fn write_motions(&self, program: &mut Program, movers: &mut Movers) {
        let solid = |s: usize| self.balls.len() + s;
        program.unit_motions = program.units.iter().map(|unit| movers.between(unit.a, unit.b)).collect();
        let of_step = |step: &Step| match *step {
            Step::Near { a, b, .. } => movers.between(a as usize, b as usize),
            Step::Beside { ball, of, .. } => movers.between(ball as usize, solid(of as usize)),
            Step::Pair(p) => movers.between(solid(program.pairs[p].a), solid(program.pairs[p].b)),
            Step::Region(_) | Step::Group(_) => Relative::default(),
        };
        program.step_motions = program.steps.iter().map(of_step).collect();
        (program.sums, program.levers) = (movers.sums.clone(), movers.levers.clone());
        let motors = program.limits.len();
        program.reach = vec![0.0; motors];
        let mut both = vec![0.0; motors];
        for between in program.unit_motions.iter().chain(&program.step_motions) {
            let levers = between.sums.iter().flat_map(|sum| &program.levers[program.sums[*sum as usize].clone()]);
            levers.clone().for_each(|lever| both[lever.motor] += f64::from(lever.reach));
            for lever in levers {
                let reach = &mut program.reach[lever.motor];
                *reach = reach.max(std::mem::take(&mut both[lever.motor]));
            }
        }
        program.slips = vec![0.0; motors];
        let slip = movers.slip();
        program.joints.iter().for_each(|j| program.slips[j.motor] += (slip * j.gain.abs()) as f32);
    }

    /// The groups of a branch, whose ball was the last to be added.
    pub fn add_branch(&mut self, has: impl Iterator<Item = bool>) {
        self.branches.push(has.collect());
    }

    /// The branch of a region that a group is in.
    pub fn branch(&self, group: usize) -> Option<usize> {
        self.branches.iter().position(|has| has[group])
    }

    /// The ball of the branch that a group is in, or its own where it is in none.
    pub fn part_ball(&self, group: usize) -> usize {
        let first = self.balls.len() - self.branches.len();
        self.branch(group).map_or(group, |branch| first + branch)
    }

    /// Writes the program's tests of units and their steps, given in how many lanes each pair decided.
    pub fn write(&self, program: &mut Program, decided: &[u32]) {
        let mut writer = Writer::new(self, program, decided);
        let mut units = writer.by((0..program.pairs.len()).collect(), |w, p| w.units(p));
        // For what they cost: a few pairs tell as much as many for less.
        units.sort_by_key(|(_, pairs)| std::cmp::Reverse(writer.decided(pairs) * 1000 / (4 + pairs.len() as u32)));
        let mut tests = Vec::new();
        for ((u, v), pairs) in units {
            let first = writer.steps.len();
            writer.two_units((u, v), pairs);
            let (a, b) = (self.unit_ball(u), self.unit_ball(v));
            let steps = first..writer.steps.len();
            tests.push(UnitTest { a, b, within_squared: self.within_squared(a, b), steps });
        }
        let steps = writer.steps;
        program.cuts = CUTS.iter().copied().take_while(|cut| *cut < tests.len()).chain([tests.len()]).collect();
        (program.units, program.steps) = (tests, steps);
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

    /// Centers of balls (or solids, after them) that are farther apart have nothing between them.
    pub fn within_squared(&self, a: usize, b: usize) -> f32 {
        let size = |i: usize| match i.checked_sub(self.balls.len()) {
            Some(solid) => (self.solids[solid].ball, self.solids[solid].error),
            None => self.balls[i],
        };
        let ((r, e), (s, f)) = (size(a), size(b));
        let within = (r + s + self.clearance) * (1.0 + TESTS) + e + f;
        (within * within * (1.0 + TESTS)) as f32
    }

    /// A ball's center that is farther from the axis of a solid's capsule, or from a box itself, has nothing of the solid near
    /// it.
    ///
    /// The solid's error counts twice: for where its axis is, and for where on it the nearest point is looked for. Of a box
    /// the center may be farther away than the box is large, so its axes' error counts along all of that way.
    pub fn beside_squared(&self, ball: usize, of: usize) -> f32 {
        let ((r, e), solid) = (self.balls[ball], self.solids[of]);
        let (radius, beyond, share) =
            solid.turn.map_or((solid.radius, solid.half, TESTS), |turn| (0.0, solid.ball, TESTS + turn));
        let within = r + radius + self.clearance;
        let within = within + (within + beyond) * share + e + 2.0 * solid.error;
        (within * within * (1.0 + TESTS)) as f32
    }
}
