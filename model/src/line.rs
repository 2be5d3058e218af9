//! Straight lines in joint space: what an offline judge and a planner ask.
//!
//! A line is judged at samples so close that no point of the robot moves farther than the step between two of them. Samples
//! where a pair can't matter are skipped by its Lipschitz bound (conservative advancement), which changes no answer.

use crate::collision::{Placement, bound, measure};
use crate::scene::{Pair, Scene};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// How far beyond the asked clearance [`Scene::line`] still measures, metres.
const BEYOND: f64 = 0.005;
/// Most samples of a line, whatever its length.
const MOST_SAMPLES: f64 = 1e6;

/// What came of a straight line in joint space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineVerdict {
    /// Whether every reflex pair stays farther apart than the clearance and no constraint is violated.
    pub free: bool,
    /// The smallest distance of a reflex pair at any sample, at most the clearance plus 5 mm.
    pub min_distance: f64,
    /// Where along the line (0 to 1) it first is not free.
    pub at: Option<f64>,
    /// The pair of `min_distance`, unless that is at its upper bound.
    pub pair: Option<Pair>,
    /// The first constraint that is violated: part and clause.
    pub constraint: Option<(usize, usize)>,
    /// In how many steps the line was judged.
    pub steps: u32,
}

impl Scene {
    /// Judges the straight line of one robot's motors from `from` to `to`, ends included, while the others stay at
    /// `poses`; what they touch themselves does not matter. `step` is the longest way, in metres, that any point of the robot goes
    /// between two samples.
    ///
    /// The whole line is measured even where it is not free, so that borderline cases can be told.
    pub fn line<P: AsRef<[f64]>>(
        &self,
        robot: usize,
        poses: &[P],
        from: &[f64],
        to: &[f64],
        step: f64,
        clearance: f64,
    ) -> LineVerdict {
        self.judge(robot, poses, (from, to), step, clearance, true)
    }

    /// As [`Scene::line`], only whether it is free; stops at the first place that is not.
    pub fn line_free<P: AsRef<[f64]>>(
        &self,
        robot: usize,
        poses: &[P],
        from: &[f64],
        to: &[f64],
        step: f64,
        clearance: f64,
    ) -> bool {
        // Most lines that are not free end badly.
        let mut end: Vec<&[f64]> = poses.iter().map(AsRef::as_ref).collect();
        if let Some(q) = end.get_mut(robot) {
            *q = to;
        }
        self.violation(robot, from, to).is_none()
            && self.robot_free(robot, &end, clearance)
            && self.judge(robot, poses, (from, to), step, clearance, false).free
    }

    fn judge<P: AsRef<[f64]>>(
        &self,
        robot: usize,
        poses: &[P],
        (from, to): (&[f64], &[f64]),
        step: f64,
        clearance: f64,
        whole: bool,
    ) -> LineVerdict {
        let violation = self.violation(robot, from, to);
        let mut verdict = LineVerdict {
            free: violation.is_none(),
            min_distance: if whole { clearance + BEYOND } else { clearance },
            at: violation.map(|(t, ..)| t),
            pair: None,
            constraint: violation.map(|(_, part, clause)| (part, clause)),
            steps: self.steps(robot, from, to, step),
        };
        let steps = f64::from(verdict.steps);
        let (first_motor, change) = (self.bodies().first_motor.get(robot).copied().unwrap_or(0), difference(from, to));
        // Metres per step that each group moves at most.
        let speed = |travel: &[(u32, f64)]| {
            let moved = travel.iter().map(|(m, r)| {
                let local = (*m as usize).checked_sub(first_motor);
                r * local.and_then(|m| change.get(m)).map_or(0.0, |d| d.abs())
            });
            moved.sum::<f64>() / steps
        };
        let world = self.world();
        // Pairs by the step at which they must be looked at next.
        let mut pending: BinaryHeap<Reverse<(u32, u32)>> = BinaryHeap::with_capacity(world.pairs.len());
        let mut pairs: Vec<(f64, (u32, u32))> = Vec::with_capacity(world.pairs.len());
        for group in &world.groups {
            let speed = speed(&group.travel);
            let own = group.pairs.iter().filter(|&&(i, j)| self.is_of(robot, i, j));
            pairs.extend(own.map(|pair| (speed, *pair)));
        }
        pending.extend((0..pairs.len() as u32).map(|p| Reverse((0, p))));
        let mut placement = Placement::default();
        placement.solids_unplaced(&world.solids);
        let mut at: Vec<Vec<f64>> = poses.iter().map(|p| p.as_ref().to_vec()).collect();
        at.resize_with(at.len().max(robot + 1), Vec::new);
        let mut now = None;
        while let Some(Reverse((k, p))) = pending.pop() {
            let t = f64::from(k) / steps;
            if now != Some(k) {
                if !whole && !verdict.free {
                    break;
                }
                now = Some(k);
                at[robot].clear();
                at[robot].extend(from.iter().zip(&change).map(|(q, d)| q + d * t));
                self.bodies().place(&at, &mut placement.frames);
            }
            let (speed, (i, j)) = pairs[p as usize];
            placement.solid(&world.solids, i);
            placement.solid(&world.solids, j);
            let enough = verdict.min_distance;
            let mut distance = bound(&world.solids, &placement, i, j, enough);
            if distance <= enough {
                match measure(&world.solids, &placement, i, j, enough) {
                    Some(contact) => {
                        distance = contact.distance;
                        if distance < verdict.min_distance || verdict.pair.is_none() {
                            verdict.min_distance = distance;
                            verdict.pair = Some(contact.pair);
                        }
                        if distance <= clearance {
                            verdict.free = false;
                            verdict.at = Some(verdict.at.map_or(t, |at| at.min(t)));
                        }
                    }
                    None => distance = enough,
                }
            }
            // Until it can have come below the smallest distance so far, it does not matter.
            let idle = ((distance - verdict.min_distance) / speed).floor();
            if speed > 0.0 && idle < f64::from(verdict.steps - k) {
                pending.push(Reverse((k + (idle.max(0.0) as u32).max(1), p)));
            }
        }
        verdict
    }

    /// In how many steps to judge a line, so that no point of the robot moves farther than `step` metres in one.
    fn steps(&self, robot: usize, from: &[f64], to: &[f64], step: f64) -> u32 {
        let change = difference(from, to);
        let (Some(reach), Some(skeleton)) = (self.bodies().reach.get(robot), self.bodies().skeletons.get(robot)) else {
            return 1;
        };
        let longest = (0..skeleton.frames())
            .map(|f| {
                let terms = reach.between(skeleton, 0, f, 0);
                terms.iter().map(|(m, r)| r * change.get(*m as usize).map_or(0.0, |d| d.abs())).sum::<f64>()
            })
            .fold(0.0, f64::max);
        (longest / step).ceil().clamp(1.0, MOST_SAMPLES) as u32
    }

    /// The first violated constraint on a line: where, part, clause. Exact: half-spaces are linear, so each clause is
    /// violated on one interval.
    fn violation(&self, robot: usize, from: &[f64], to: &[f64]) -> Option<(f64, usize, usize)> {
        let model = self.robots().get(robot)?;
        let value = |terms: &[(usize, f64)], b: f64, q: &[f64]| {
            let home = |m: usize| model.motors.get(m).map_or(0.0, |m| m.home);
            terms.iter().map(|(m, a)| a * q.get(*m).copied().unwrap_or_else(|| home(*m)).to_degrees()).sum::<f64>() + b
        };
        let mut first: Option<(f64, usize, usize)> = None;
        for (p, part) in model.parts.iter().enumerate() {
            for (c, clause) in part.clauses.iter().enumerate() {
                let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
                for half_space in &clause.0 {
                    let v0 = value(&half_space.terms, half_space.b, from);
                    let v1 = value(&half_space.terms, half_space.b, to);
                    match (v0 > 0.0, v1 > 0.0) {
                        (true, true) => leave = -1.0,
                        (true, false) => enter = enter.max(v0 / (v0 - v1)),
                        (false, true) => leave = leave.min(v0 / (v0 - v1)),
                        (false, false) => {}
                    }
                }
                if enter <= leave && first.is_none_or(|(t, ..)| enter < t) {
                    first = Some((enter, p, c));
                }
            }
        }
        first
    }
}

fn difference(from: &[f64], to: &[f64]) -> Vec<f64> {
    from.iter().zip(to).map(|(a, b)| b - a).collect()
}
