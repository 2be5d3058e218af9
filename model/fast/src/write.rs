//! Writes the steps of two units: from the coarsest test to pairs of shapes.

use crate::program::{Program, Step};
use crate::steps::{StepLayout, Unit};
use std::cmp::Reverse;
use std::collections::BTreeMap;

/// Number of shapes on the other side from which the first side is tested shape by shape; with fewer all pairs are
/// tested directly.
const MIN_SHAPES_FOR_BALLS: usize = 3;

/// State of writing steps.
pub(crate) struct StepWriter<'a> {
    layout: &'a StepLayout,
    /// Per pair: its solids.
    pairs: Vec<[usize; 2]>,
    /// Number of lanes that each pair decided; empty if unknown.
    decided: &'a [u32],
    /// Per solid: its group.
    group: Vec<usize>,
    /// Number of balls; solids are numbered after them.
    balls: usize,
    pub steps: Vec<Step>,
}

impl<'a> StepWriter<'a> {
    pub fn new(layout: &'a StepLayout, program: &Program, decided: &'a [u32]) -> Self {
        let mut group = vec![0; program.solids.len()];
        for (g, range) in layout.groups.iter().enumerate() {
            group[range.clone()].fill(g);
        }
        let pairs = program.robots.pairs.iter().map(|pair| [pair.a as usize, pair.b as usize]).collect();
        StepWriter { layout, pairs, decided, group, balls: program.balls.len(), steps: Vec::new() }
    }

    /// Number of lanes that any of these pairs decided.
    pub fn decided(&self, pairs: &[usize]) -> u32 {
        pairs.iter().map(|p| self.decided.get(*p).copied().unwrap_or(0)).sum()
    }

    /// Groups pairs by a common key, the most decisive group first.
    pub fn by<K: Ord>(&self, pairs: Vec<usize>, key: impl Fn(&Self, usize) -> K) -> Vec<(K, Vec<usize>)> {
        let mut all = BTreeMap::<K, Vec<usize>>::new();
        for p in pairs {
            all.entry(key(self, p)).or_default().push(p);
        }
        let mut all: Vec<_> = all.into_iter().collect();
        all.sort_by_key(|(_, pairs)| Reverse(self.decided(pairs)));
        all
    }

    /// The two units of a pair, in order.
    pub fn units(&self, pair: usize) -> (Unit, Unit) {
        let [u, v] = self.pairs[pair].map(|solid| self.layout.unit(self.group[solid]));
        (u.min(v), u.max(v))
    }

    /// The solids of a pair: first that of the first unit, then the other.
    fn sides(&self, pair: usize) -> [usize; 2] {
        let [a, b] = self.pairs[pair];
        if self.layout.unit(self.group[a]) == self.units(pair).0 { [a, b] } else { [b, a] }
    }

    /// The groups of a pair.
    fn groups(&self, pair: usize) -> [usize; 2] {
        self.sides(pair).map(|solid| self.group[solid])
    }

    /// The balls around the fingers, or other parts of a unit, that contain a pair's solids.
    fn parts(&self, pair: usize) -> [usize; 2] {
        self.groups(pair).map(|group| self.layout.part_ball(group))
    }

    /// Writes all pairs of two units with balls near each other.
    pub fn two_units(&mut self, (u, v): (Unit, Unit), pairs: Vec<usize>) {
        match (u, v) {
            // These groups are the units; their balls were tested already.
            (Unit::Group(g), Unit::Group(h)) => self.pairs_of((g, h), pairs),
            (_, Unit::Group(h)) => {
                self.steps.push(Step::Group(h));
                let hand = self.layout.unit_ball(u);
                for (solid, pairs) in self.by(pairs, |w, p| w.sides(p)[1]) {
                    self.within(|w| w.beside(hand, solid), |w| w.hand_and_solid(solid, pairs));
                }
            }
            _ => {
                let other = self.layout.unit_ball(v);
                for (finger, pairs) in self.by(pairs, |w, p| w.parts(p)[0]) {
                    self.within(|w| w.near(finger, other), |w| w.finger_and_hand(finger, pairs));
                }
            }
        }
    }

    fn hand_and_solid(&mut self, solid: usize, pairs: Vec<usize>) {
        for (finger, pairs) in self.by(pairs, |w, p| w.parts(p)[0]) {
            let one = |w: &mut Self| {
                for (group, pairs) in w.by(pairs, |w, p| w.groups(p)[0]) {
                    let pairs_of = |w: &mut Self| {
                        w.place([group, group]);
                        w.steps.extend(pairs.into_iter().map(Step::Pair));
                    };
                    if group == finger {
                        pairs_of(w);
                    } else {
                        w.region(group);
                        w.within(|w| w.beside(group, solid), pairs_of);
                    }
                }
            };
            self.within(|w| w.beside(finger, solid), one);
        }
    }

    fn finger_and_hand(&mut self, finger: usize, pairs: Vec<usize>) {
        for (other, pairs) in self.by(pairs, |w, p| w.parts(p)[1]) {
            let both = |w: &mut Self| {
                for ([g, h], pairs) in w.by(pairs, |w, p| w.groups(p)) {
                    w.region(g);
                    w.region(h);
                    w.within(|w| w.near(g, h), |w| w.pairs_of((g, h), pairs));
                }
            };
            self.within(|w| w.near(finger, other), both);
        }
    }

    /// Writes all pairs of two groups. If there are many, each shape of the first is tested against the second's ball.
    /// A box that is alone in its group is first compared with the other's ball, since the ball around a board contains
    /// much that is not near the board.
    fn pairs_of(&mut self, (g, h): (usize, usize), pairs: Vec<usize>) {
        let size = |group: usize| self.layout.groups[group].len();
        let (one, other) = if size(g) <= size(h) { (g, h) } else { (h, g) };
        let pairs: Vec<usize> = self.by(pairs, |_, p| p).into_iter().map(|(p, _)| p).collect();
        let solid = self.layout.groups[one].start;
        if size(one) == 1 && self.layout.solids[solid].turn.is_some() {
            self.place([one, one]);
            let rest = |w: &mut Self| {
                w.place([other, other]);
                w.steps.extend(pairs.into_iter().map(Step::Pair));
            };
            self.within(|w| w.beside(other, solid), rest);
            return;
        }
        self.place([g, h]);
        if size(other) < MIN_SHAPES_FOR_BALLS {
            self.steps.extend(pairs.into_iter().map(Step::Pair));
            return;
        }
        let mine = |w: &Self, p: usize| w.pairs[p].into_iter().find(|solid| w.group[*solid] == one).unwrap_or_default();
        let mut solids: Vec<(usize, Vec<usize>)> = Vec::new();
        for p in pairs {
            let solid = mine(self, p);
            match solids.iter_mut().find(|(known, _)| *known == solid) {
                Some((_, of)) => of.push(p),
                None => solids.push((solid, vec![p])),
            }
        }
        for (solid, pairs) in solids {
            self.within(|w| w.near(w.balls + solid, other), |w| w.steps.extend(pairs.into_iter().map(Step::Pair)));
        }
    }

    fn place(&mut self, [one, other]: [usize; 2]) {
        self.steps.push(Step::Group(one));
        if other != one {
            self.steps.push(Step::Group(other));
        }
    }

    /// Places the branch of a group, unless it is always placed.
    fn region(&mut self, group: usize) {
        let branch = self.layout.branch(group);
        self.steps.extend(branch.map(|branch| Step::Region(branch + 1)));
    }

    /// Writes a test, and the steps to execute if it is positive in any lane.
    fn within(&mut self, test: impl Fn(&Self) -> Step, steps: impl FnOnce(&mut Self)) {
        let first = self.steps.len();
        self.steps.push(test(self));
        steps(self);
        let end = self.steps.len() as u32;
        if let Some(Step::Near { skip, .. } | Step::Beside { skip, .. }) = self.steps.get_mut(first) {
            *skip = end;
        }
    }

    /// Test if two balls (or solids, numbered after them) are near; its end is not set yet.
    fn near(&self, a: usize, b: usize) -> Step {
        Step::Near { a: a as u32, b: b as u32, within_squared: self.layout.within_squared(a, b), skip: 0 }
    }

    /// Test if a ball is near the bounding capsule of a solid; its end is not set yet.
    fn beside(&self, ball: usize, of: usize) -> Step {
        let solid = &self.layout.solids[of];
        let within_squared = self.layout.beside_squared(self.layout.ball(ball), solid);
        let half = solid.half as f32;
        Step::Beside { ball: ball as u32, of: of as u32, half, within_squared, skip: 0 }
    }
}
