//! The order of tests: from balls around whole hands to single shapes, and what decides most often first.
//!
//! ```text
//! hand near arm?            no: on to the next two
//!   place the hand
//!   finger near forearm?    no: on
//!     place their solids
//!     solid near forearm?   no: on
//!       test each pair of shapes
//! ```

use crate::bound::TESTS;
use crate::levers::Movers;
use crate::program::{Program, Relative, Step, UnitTest};
use std::collections::BTreeMap;
use std::ops::Range;

/// Fewer shapes than this on the other side are tested at once.
const MANY: usize = 3;

/// Pairs of units after which a block may stop. A matter of speed alone.
const CUTS: [usize; 3] = [0, 32, 96];

/// What is tested as one at first: a whole region, or one group.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Unit {
    Region(usize),
    Group(usize),
}

/// What steps are made of.
#[derive(Clone, Debug)]
pub(crate) struct Layout {
    clearance: f64,
    /// Per group: its region, if it is in one.
    region: Vec<Option<usize>>,
    groups: Vec<Range<usize>>,
    /// Per branch of a region, and group: whether it is in it.
    branches: Vec<Vec<bool>>,
    /// Radius and error of each ball: groups, then regions, then branches.
    balls: Vec<(f64, f64)>,
    /// The same of each solid.
    pub solids: Vec<(f64, f64)>,
}

/// Pairs of one group with another: their indices, and in how many lanes they decided.
#[derive(Default)]
struct Between {
    pairs: Vec<usize>,
    decided: u32,
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
            Step::Near { a, b, .. } => movers.between(a, b),
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

    /// The branch of a region that a group is in, by its ball.
    fn branch(&self, group: usize) -> Option<usize> {
        let first = self.balls.len() - self.branches.len();
        self.branches.iter().position(|has| has[group]).map(|b| first + b)
    }

    /// Writes the program's tests of units and their steps, given in how many lanes each pair decided.
    pub fn write(&self, program: &mut Program, decided: &[u32]) {
        let mut of_solid = vec![0; program.solids.len()];
        for (g, range) in self.groups.iter().enumerate() {
            of_solid[range.clone()].fill(g);
        }
        let mut units = BTreeMap::<(Unit, Unit), BTreeMap<(usize, usize), Between>>::new();
        for (p, pair) in program.pairs.iter().enumerate() {
            let (g, h) = (of_solid[pair.a], of_solid[pair.b]);
            let (g, h) = if self.unit(g) <= self.unit(h) { (g, h) } else { (h, g) };
            let between = units.entry((self.unit(g), self.unit(h))).or_default().entry((g, h)).or_default();
            between.pairs.push(p);
            between.decided += decided.get(p).copied().unwrap_or(0);
        }
        let mut units: Vec<_> = units.into_iter().collect();
        // For what they cost: a few pairs tell as much as many for less.
        let telling = |groups: &BTreeMap<_, Between>| {
            let (decided, pairs) = groups.values().fold((0, 0), |(d, n), b| (d + b.decided, n + b.pairs.len()));
            decided * 1000 / (4 + pairs as u32)
        };
        units.sort_by_key(|(_, groups)| std::cmp::Reverse(telling(groups)));
        let (mut tests, mut steps) = (Vec::new(), Vec::new());
        for ((u, v), groups) in units {
            let first = steps.len();
            self.two_units(program, (u, v), groups, decided, &mut steps);
            let (a, b) = (self.unit_ball(u), self.unit_ball(v));
            tests.push(UnitTest { a, b, within_squared: self.within_squared(a, b), steps: first..steps.len() });
        }
        program.cuts = CUTS.iter().copied().take_while(|cut| *cut < tests.len()).chain([tests.len()]).collect();
        (program.units, program.steps) = (tests, steps);
    }

    fn unit(&self, group: usize) -> Unit {
        self.region[group].map_or(Unit::Group(group), Unit::Region)
    }

    fn two_units(
        &self,
        program: &Program,
        (u, v): (Unit, Unit),
        groups: BTreeMap<(usize, usize), Between>,
        decided: &[u32],
        steps: &mut Vec<Step>,
    ) {
        for unit in [u, v] {
            if let Unit::Region(r) = unit {
                steps.push(Step::Region(r + 1));
            }
        }
        let single = matches!((u, v), (Unit::Group(_), Unit::Group(_)));
        // A finger against the whole of the other one, before each of its shapes.
        let mut crowds = BTreeMap::<Option<usize>, Vec<((usize, usize), Between)>>::new();
        for (both, between) in groups {
            crowds.entry(self.branch(both.0)).or_default().push((both, between));
        }
        let mut crowds: Vec<_> = crowds.into_iter().collect();
        crowds.sort_by_key(|(_, crowd)| std::cmp::Reverse(crowd.iter().map(|(_, b)| b.decided).sum::<u32>()));
        for (branch, mut crowd) in crowds {
            let outer = steps.len();
            let branch = branch.filter(|_| crowd.len() > 1);
            steps.extend(branch.map(|b| self.near(b, self.unit_ball(v))));
            crowd.sort_by_key(|(_, between)| std::cmp::Reverse(between.decided));
            for ((g, h), between) in crowd {
                let inner = steps.len();
                // Two single groups are the units, and were asked already.
                if !single {
                    steps.push(self.near(g, h));
                }
                steps.extend([Step::Group(g), Step::Group(h)]);
                self.pairs(program, (g, h), between.pairs, decided, steps);
                if !single {
                    close(steps, inner);
                }
            }
            if branch.is_some() {
                close(steps, outer);
            }
        }
    }

    /// All pairs of two groups; where there are many, shape by shape of the first against the second's ball.
    fn pairs(
        &self,
        program: &Program,
        (g, h): (usize, usize),
        mut pairs: Vec<usize>,
        decided: &[u32],
        steps: &mut Vec<Step>,
    ) {
        pairs.sort_by_key(|p| std::cmp::Reverse(decided.get(*p).copied().unwrap_or(0)));
        let (one, other) = if self.groups[g].len() <= self.groups[h].len() { (g, h) } else { (h, g) };
        if self.groups[other].len() < MANY {
            steps.extend(pairs.into_iter().map(Step::Pair));
            return;
        }
        let mine = |p: &usize| {
            let pair = &program.pairs[*p];
            if self.groups[one].contains(&pair.a) { pair.a } else { pair.b }
        };
        let mut solids: Vec<usize> = Vec::new();
        for p in &pairs {
            if !solids.contains(&mine(p)) {
                solids.push(mine(p));
            }
        }
        for solid in solids {
            let first = steps.len();
            steps.push(self.near(program.balls.len() + solid, other));
            steps.extend(pairs.iter().filter(|p| mine(p) == solid).map(|p| Step::Pair(*p)));
            close(steps, first);
        }
    }

    fn unit_ball(&self, unit: Unit) -> usize {
        match unit {
            Unit::Group(g) => g,
            Unit::Region(r) => self.groups.len() + r,
        }
    }

    /// A test of two centers, its end still open.
    fn near(&self, a: usize, b: usize) -> Step {
        Step::Near { a, b, within_squared: self.within_squared(a, b), skip: 0 }
    }

    /// Centers of balls (or solids, after them) that are farther apart have nothing between them.
    fn within_squared(&self, a: usize, b: usize) -> f32 {
        let size = |i: usize| match i.checked_sub(self.balls.len()) {
            Some(solid) => self.solids[solid],
            None => self.balls[i],
        };
        let ((r, e), (s, f)) = (size(a), size(b));
        let within = (r + s + self.clearance) * (1.0 + TESTS) + e + f;
        (within * within * (1.0 + TESTS)) as f32
    }
}

/// Lets the step at `first` skip all that came after it.
fn close(steps: &mut [Step], first: usize) {
    let end = steps.len();
    if let Some(Step::Near { skip, .. }) = steps.get_mut(first) {
        *skip = end;
    }
}
