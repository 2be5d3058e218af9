//! Straight lines in joint space: queries for planners and offline checks.
//!
//! A line is checked at samples so dense that no point of the robot moves farther than the step between two of them.
//! The scene bounds the approach speed of each pair; the engine skips the samples at which the pair is irrelevant.

use super::travel::Term;
use super::{Pair, Scene};
use crate::engine::{Engine, LineQuery, SweptPair};

/// Distance beyond the requested clearance up to which [`Scene::line`] measures, meters: a comparison of two checkers
/// of a line needs the reserve by which it was free.
const MEASURED_BEYOND_M: f64 = 0.005;
/// Maximum number of steps of a line of any length: a step size of zero must terminate, too.
const MAX_STEPS: f64 = 1e6;

/// Result of checking a straight line in joint space.
///
/// A line that violates a constraint or ends in an obstacle is measured nevertheless, so that two checkers can be
/// compared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineVerdict {
    /// True if every reflex pair stays farther apart than the clearance and no constraint is violated.
    pub free: bool,
    /// The smallest distance of a reflex pair at any sample, at most the clearance plus 5 mm.
    pub min_distance: f64,
    /// First position along the line (0 to 1) that is not free.
    pub at: Option<f64>,
    /// The pair of `min_distance`, unless that is at its upper bound.
    pub pair: Option<Pair>,
    /// The first constraint that is violated: part and clause.
    pub constraint: Option<(usize, usize)>,
    /// Number of steps of the check; there is one sample more, since both ends are included.
    pub steps: u32,
}

/// A constraint that a line violates.
#[derive(Clone, Copy, Debug, PartialEq)]
struct LineViolation {
    /// Start of the violation along the line, 0 to 1.
    at: f64,
    /// Index into the robot's parts.
    part: usize,
    /// Index into the part's clauses.
    clause: usize,
}

impl<E: Engine> Scene<E> {
    /// Linear sweep: checks the straight line of one robot's motors from `from` to `to`, ends included, while the other
    /// robots stay at `poses`. Contacts among the other robots are ignored.
    ///
    /// # Arguments
    /// * `robot`: its index in [`Scene::robots`].
    /// * `poses`: configurations of all robots, rad of encoder; the robot's own entry is not read.
    /// * `from`, `to`: the robot's motors, rad of encoder.
    /// * `step`: maximum displacement, meters, of any point of the robot between two samples.
    /// * `clearance`: a distance of this or less, meters, is not free.
    ///
    /// # Returns
    /// The result of testing every reflex pair of the robot at every sample. The complete line is measured even if it
    /// is not free, so that borderline cases can be identified.
    ///
    /// # Performance
    /// For a yes-or-no query use [`Scene::line_free`], which stops as soon as the result is certain.
    pub fn line<P: AsRef<[f64]>>(
        &self,
        robot: usize,
        poses: &[P],
        from: &[f64],
        to: &[f64],
        step: f64,
        clearance: f64,
    ) -> LineVerdict {
        self.check_line(robot, poses, (from, to), step, clearance, true)
    }

    /// Linear sweep, yes or no: `free` of [`Scene::line`].
    ///
    /// # Performance
    /// Tests constraints first, then the end, then the line up to the first sample that is not free.
    pub fn line_free<P: AsRef<[f64]>>(
        &self,
        robot: usize,
        poses: &[P],
        from: &[f64],
        to: &[f64],
        step: f64,
        clearance: f64,
    ) -> bool {
        // Most lines that are not free end in a contact: one sample decides these.
        let mut end: Vec<&[f64]> = poses.iter().map(AsRef::as_ref).collect();
        if let Some(q) = end.get_mut(robot) {
            *q = to;
        }
        self.violation(robot, from, to).is_none()
            && self.robot_free(robot, &end, clearance)
            && self.check_line(robot, poses, (from, to), step, clearance, false).free
    }

    /// Implements both line queries: `whole` continues past contacts and measures beyond the clearance.
    fn check_line<P: AsRef<[f64]>>(
        &self,
        robot: usize,
        poses: &[P],
        (from, to): (&[f64], &[f64]),
        step: f64,
        clearance: f64,
        whole: bool,
    ) -> LineVerdict {
        let steps = self.steps(robot, from, to, step);
        let change = difference(from, to);
        let pairs = self.swept_pairs(robot, &change, steps);
        let cap = if whole { clearance + MEASURED_BEYOND_M } else { clearance };
        let mut at: Vec<Vec<f64>> = poses.iter().map(|p| p.as_ref().to_vec()).collect();
        at.resize_with(at.len().max(robot + 1), Vec::new);
        let query = LineQuery { pairs: &pairs, steps, clearance, cap, whole };
        let result = self.world().engine.line(&query, |k, frames| {
            let t = f64::from(k) / f64::from(steps);
            at[robot].clear();
            at[robot].extend(from.iter().zip(&change).map(|(q, d)| q + d * t));
            self.bodies().place(&at, frames);
        });

        let violation = self.violation(robot, from, to);
        let solids = &self.world().solids;
        let hit = result.hit.map(|k| f64::from(k) / f64::from(steps));
        LineVerdict {
            free: violation.is_none() && hit.is_none(),
            min_distance: result.min_distance,
            at: violation.map(|v| v.at).into_iter().chain(hit).reduce(f64::min),
            pair: result.pair.map(|(i, j)| (solids[i as usize].id, solids[j as usize].id)),
            constraint: violation.map(|v| (v.part, v.clause)),
            steps,
        }
    }

    /// The reflex pairs of a robot, each with the maximum approach speed if the robot's motors change by `change` in
    /// `steps` steps and no other robot moves.
    fn swept_pairs(&self, robot: usize, change: &[f64], steps: u32) -> Vec<SweptPair> {
        let first_motor = self.bodies().first_motor.get(robot).copied().unwrap_or(0);
        let moved = |term: &Term| {
            let local = (term.motor as usize).checked_sub(first_motor);
            term.reach * local.and_then(|m| change.get(m)).map_or(0.0, |d| d.abs())
        };
        let mut pairs = Vec::with_capacity(self.world().lists.pairs.len());
        for group in &self.world().lists.groups {
            let speed = group.travel.iter().map(moved).sum::<f64>() / f64::from(steps);
            let own = group.pairs.iter().filter(|pair| self.is_of(robot, **pair));
            pairs.extend(own.map(|pair| SweptPair { pair: *pair, speed, own: self.world().own_clearance(*pair) }));
        }
        pairs
    }

    /// Number of steps for checking a line, so that no point of the robot moves farther than `step` meters in one.
    fn steps(&self, robot: usize, from: &[f64], to: &[f64], step: f64) -> u32 {
        let change = difference(from, to);
        let reach = self.bodies().reach.get(robot);
        let (Some(reach), Some(skeleton)) = (reach, self.bodies().skeletons.get(robot)) else {
            return 1;
        };
        let longest = (0..skeleton.frames())
            .map(|f| {
                let terms = reach.between(skeleton, 0, f, 0);
                terms.iter().map(|t| t.reach * change.get(t.motor as usize).map_or(0.0, |d| d.abs())).sum::<f64>()
            })
            .fold(0.0, f64::max);
        (longest / step).ceil().clamp(1.0, MAX_STEPS) as u32
    }

    /// The first violated constraint on a line. Exact: half-spaces are linear, so each clause is violated on one
    /// interval.
    fn violation(&self, robot: usize, from: &[f64], to: &[f64]) -> Option<LineViolation> {
        let model = self.robots().get(robot)?;
        let value = |terms: &[(usize, f64)], b: f64, q: &[f64]| {
            let home = |m: usize| model.motors.get(m).map_or(0.0, |m| m.home);
            terms.iter().map(|(m, a)| a * q.get(*m).copied().unwrap_or_else(|| home(*m)).to_degrees()).sum::<f64>() + b
        };
        let mut first: Option<LineViolation> = None;
        for (part, of_part) in model.parts.iter().enumerate() {
            for (clause, members) in of_part.clauses.iter().enumerate() {
                // A clause is violated where all of its members are: the intersection of their intervals.
                let mut enter = 0.0_f64;
                let mut leave = 1.0_f64;
                for half_space in &members.0 {
                    let v0 = value(&half_space.terms, half_space.b, from);
                    let v1 = value(&half_space.terms, half_space.b, to);
                    match (v0 > 0.0, v1 > 0.0) {
                        (true, true) => leave = -1.0,
                        (true, false) => enter = enter.max(v0 / (v0 - v1)),
                        (false, true) => leave = leave.min(v0 / (v0 - v1)),
                        (false, false) => {}
                    }
                }
                if enter <= leave && first.is_none_or(|v: LineViolation| enter < v.at) {
                    first = Some(LineViolation { at: enter, part, clause });
                }
            }
        }
        first
    }
}

/// Change of each motor, rad of encoder.
fn difference(from: &[f64], to: &[f64]) -> Vec<f64> {
    from.iter().zip(to).map(|(a, b)| b - a).collect()
}
