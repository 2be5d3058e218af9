//! The force-field law of the original MoBeE: how a body part moves that is drawn by an attractor and pushed by its limits, its
//! constraints, the fields of its shapes and a force from outside.
//!
//! ```text
//! a = attractor + limits + constraints + field + outside  (- damping, while something pushes)
//! v' = weight (v + a T)
//! ```
//! In encoder units (degrees; millimeters for joints that slide) and seconds, as the original: a "force" is an acceleration, deg/s^2. Pure, and the same for whoever streams
//! what follows from it.

use crate::{HalfSpace, Part};

/// Nearer to its attractor (deg) and slower (deg/s) than this, with nothing pushing, a joint is at rest.
const REST: (f64, f64) = (0.2, 1.0);

/// What acts upon one joint, and how strongly. Zero switches a force off.
///
/// The names are those of the original's configuration files. A force here is an acceleration, deg/s^2.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JointLaw {
    /// Share of the computed velocity that is commanded; joints of weight 0 are not moved.
    pub weight: f64,
    /// Strength of the attractor near it, 1/s^2.
    pub spring_const: f64,
    /// The greatest pull of the attractor, deg/s^2, however far it is.
    pub max_spring_force: f64,
    /// Damping while something pushes, 1/s.
    pub damping_const: f64,
    /// How far from a limit its push begins, at the lower and at the upper one, deg.
    pub limit_const: (f64, f64),
    /// The push at a limit, deg/s^2; it falls off linearly to zero where it begins.
    pub max_limit_force: f64,
    /// The greatest push of the constraints, deg/s^2.
    pub max_constraint_force: f64,
    /// How quickly a field's push reaches its greatest effect.
    pub field_const: f64,
    /// The greatest push of a field, deg/s^2.
    pub max_field_force: f64,
    /// How quickly a force from outside reaches its greatest effect.
    pub rpc_force_const: f64,
    /// The greatest effect of a force from outside, deg/s^2.
    pub max_rpc_force: f64,
    /// The joint's limits, deg.
    pub limits: (f64, f64),
}

/// What acts on a part from outside of its law in one cycle, one number per joint; empty lists count as zeros.
#[derive(Clone, Copy, Debug, Default)]
pub struct Influences<'a> {
    /// Where the attractor is, deg.
    pub to: &'a [f64],
    /// The torques of the fields, as the model gives them: meters of depth times meters of lever.
    pub field: &'a [f64],
    /// The force from outside, as whoever pushes gives it: the law makes an acceleration of it.
    pub outside: &'a [f64],
}

/// A constraint's spring: pushes while no member's value is above `len`.
#[derive(Clone, Debug, PartialEq)]
struct Spring {
    /// How far above zero the push begins, deg.
    len: f64,
    /// Coefficients per joint, their norm, and the constant.
    members: Vec<(Vec<f64>, f64, f64)>,
}

impl Spring {
    /// Each member's `a.q + b`, deg.
    fn values<'a>(&'a self, q: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        self.members.iter().map(move |(a, _, b)| a.iter().zip(q).map(|(a, q)| a * q).sum::<f64>() + b)
    }
}

/// The law of one part: what its joints' velocities are to be, given where they are and what acts on them.
///
/// Holds no state: where the joints are and how fast they go is given anew in each cycle, so that whoever streams can be
/// stopped and go on elsewhere.
#[derive(Clone, Debug, PartialEq)]
pub struct ForceLaw {
    /// One per motor of the part.
    joints: Vec<JointLaw>,
    /// One per clause of the part.
    springs: Vec<Spring>,
}

impl ForceLaw {
    /// The law of a part.
    ///
    /// # Arguments
    /// * `joints`: one entry per motor of the part, in its order.
    /// * `part`: whose constraints push.
    /// * `constraint_len`: how far above zero a clause's value may be for it to push, deg; at least 20 are taken.
    pub fn new(joints: Vec<JointLaw>, part: &Part, constraint_len: f64) -> ForceLaw {
        let n = joints.len();
        let member = |half: &HalfSpace| {
            let mut a = vec![0.0; n];
            for (motor, value) in &half.terms {
                if let Some(slot) = motor.checked_sub(part.motors.start).and_then(|m| a.get_mut(m)) {
                    *slot += value;
                }
            }
            let norm = a.iter().map(|x| x * x).sum::<f64>().sqrt();
            (a, norm, half.b)
        };
        let len = constraint_len.max(20.0);
        let springs = part.clauses.iter().map(|c| Spring { len, members: c.0.iter().map(member).collect() }).collect();
        ForceLaw { joints, springs }
    }

    /// The joints' part of the law.
    pub fn joints(&self) -> &[JointLaw] {
        &self.joints
    }

    /// The same law for a motion to `to` (deg) of the joints that move: the others have no weight, and springs of limits and
    /// constraints that would push at the target are shortened until they don't, so that the target is at rest.
    #[must_use]
    pub fn aimed(&self, to: &[f64], moves: &[bool]) -> ForceLaw {
        let mut law = self.clone();
        for (i, joint) in law.joints.iter_mut().enumerate() {
            let (x, (min, max)) = (at(to, i), joint.limits);
            joint.limit_const.0 = joint.limit_const.0.min(x - min).max(0.0);
            joint.limit_const.1 = joint.limit_const.1.min(max - x).max(0.0);
            if moves.get(i) != Some(&true) {
                joint.weight = 0.0;
            }
        }
        for spring in &mut law.springs {
            // A clause holds as well as its best member does: a spring of that length is just slack at the target.
            let best = spring.values(to).fold(f64::NEG_INFINITY, f64::max);
            spring.len = spring.len.min(best);
        }
        law
    }

    /// One cycle of the law.
    ///
    /// # Arguments
    /// * `q`, `speed`: where the part's joints are, deg, and how fast they go, deg/s.
    /// * `influences`: what else acts on them.
    /// * `secs`: how long the cycle is; the velocities hold for so long.
    ///
    /// # Returns
    /// The velocities to command, deg/s, 0 for joints of no weight. `None` while there is nothing to do: nothing pushes, and all
    /// joints are at rest at the attractor.
    pub fn velocities(&self, q: &[f64], speed: &[f64], influences: Influences<'_>, secs: f64) -> Option<Vec<f64>> {
        // the original's sharpening: soft at the field's edge, quickly hard within
        let field: Vec<f64> = influences.field.iter().map(|t| (1000.0 * t).abs() * 1000.0 * t).collect();
        let (inside, outside) = (norm(&field), norm(influences.outside));
        let constraint = self.constraint(q);
        let pushes = |i: usize, j: &JointLaw| {
            let pushed_by = [squashed(j.max_field_force, j.field_const, at(&field, i), inside), limit(j, at(q, i))];
            pushed_by.into_iter().sum::<f64>() + at(&constraint, i) * j.max_constraint_force
        };
        let weighty = || self.joints.iter().enumerate().filter(|(_, j)| j.weight > 0.0);
        let way = |i: usize| at(influences.to, i) - at(q, i);
        let pushed = weighty().any(|(i, j)| pushes(i, j) != 0.0);
        let astray = |(i, _): (usize, &JointLaw)| way(i).abs() > REST.0 || at(speed, i).abs() > REST.1;
        if !(pushed || outside > 0.0 || weighty().any(astray)) {
            return None;
        }
        // Forces are accelerations here: one Euler step from the measured speed, of which `weight` comes through.
        let velocity = |(i, j): (usize, &JointLaw)| {
            if j.weight <= 0.0 {
                return 0.0;
            }
            let pull = squashed(j.max_spring_force, j.spring_const, way(i), way(i).abs());
            let mut a =
                pull + pushes(i, j) + squashed(j.max_rpc_force, j.rpc_force_const, at(influences.outside, i), outside);
            if pushed {
                a -= j.damping_const * at(speed, i);
            }
            j.weight * (at(speed, i) + a * secs)
        };
        Some(self.joints.iter().enumerate().map(velocity).collect())
    }

    /// The push of clauses that are violated or nearly so, from -1 to 1 per joint.
    fn constraint(&self, q: &[f64]) -> Vec<f64> {
        let mut sum = vec![0.0; self.joints.len()];
        for spring in self.springs.iter().filter(|s| s.len > 0.0) {
            // One member that holds with room is enough: a clause is a disjunction.
            if spring.values(q).any(|v| v > spring.len) {
                continue;
            }
            for ((a, norm, _), value) in
                spring.members.iter().zip(spring.values(q)).filter(|((_, norm, _), _)| *norm > 0.0)
            {
                for (slot, a) in sum.iter_mut().zip(a) {
                    *slot += (spring.len - value) / spring.len * a / norm;
                }
            }
        }
        sum.iter().map(|s| s.clamp(-1.0, 1.0)).collect()
    }
}

/// The push of a joint's limits.
fn limit(joint: &JointLaw, q: f64) -> f64 {
    let ((min, max), (low, high), most) = (joint.limits, joint.limit_const, joint.max_limit_force);
    if most <= 0.0 {
        0.0
    } else if low > 0.0 && q < min + low {
        most * (min + low - q) / low
    } else if high > 0.0 && q > max - high {
        -most * (q - (max - high)) / high
    } else {
        0.0
    }
}

/// One component of a force of this strength, of which no more than `most` comes through.
fn squashed(most: f64, k: f64, component: f64, strength: f64) -> f64 {
    if most > 0.0 && k > 0.0 { most * component / (most / k + strength) } else { 0.0 }
}

/// Euclidean length.
fn norm(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// An element; zero beyond the end, since lists that nobody fills are left empty.
fn at(list: &[f64], i: usize) -> f64 {
    list.get(i).copied().unwrap_or_default()
}
