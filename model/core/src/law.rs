//! Force-field law of the original MoBeE: the motion of a body part that is pulled by an attractor and pushed by its
//! limits, its constraints, the fields of its shapes and an external force.
//!
//! ```text
//! a = attractor + limits + constraints + field + external  (- damping, while something pushes)
//! v' = weight (v + a T)
//! ```
//! In encoder units (degrees; millimeters for prismatic joints) and seconds, as in the original: a "force" is an
//! acceleration, deg/s^2. Pure functions, the same for every streaming client.

use crate::{HalfSpace, Part};

/// A joint nearer to its attractor (deg) and slower (deg/s) than this, with nothing pushing, is at rest.
const REST: (f64, f64) = (0.2, 1.0);

/// Strengths of the forces on one joint. Zero disables a force.
///
/// The names are those of the original's configuration files. A force is an acceleration, deg/s^2.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JointLaw {
    /// Share of the computed velocity that is commanded; joints of weight 0 do not move.
    pub weight: f64,
    /// Stiffness of the attractor near it, 1/s^2.
    pub spring_const: f64,
    /// Maximum pull of the attractor at any distance, deg/s^2.
    pub max_spring_force: f64,
    /// Damping while something pushes, 1/s.
    pub damping_const: f64,
    /// Distance from the lower and from the upper limit at which the limit's push begins, deg.
    pub limit_const: (f64, f64),
    /// Push at a limit, deg/s^2; decreases linearly to zero at the distance `limit_const`.
    pub max_limit_force: f64,
    /// Maximum push of the constraints, deg/s^2.
    pub max_constraint_force: f64,
    /// Gain with which a field's push approaches its maximum.
    pub field_const: f64,
    /// Maximum push of a field, deg/s^2.
    pub max_field_force: f64,
    /// Gain with which an external force approaches its maximum effect.
    pub rpc_force_const: f64,
    /// Maximum effect of an external force, deg/s^2.
    pub max_rpc_force: f64,
    /// The joint's limits, deg.
    pub limits: (f64, f64),
}

/// External influences on a part in one cycle, one number per joint; empty lists count as zeros.
#[derive(Clone, Copy, Debug, Default)]
pub struct Influences<'a> {
    /// Position of the attractor, deg.
    pub to: &'a [f64],
    /// The torques of the fields from the model, m^2 (depth times lever).
    pub field: &'a [f64],
    /// The external force in the caller's unit: the law converts it to an acceleration.
    pub outside: &'a [f64],
}

/// The spring of a constraint: pushes while no member's value exceeds `len`.
#[derive(Clone, Debug, PartialEq)]
struct Spring {
    /// Value of the clause below which the spring pushes, deg.
    len: f64,
    /// Coefficients per joint, their norm, and the constant, per member.
    members: Vec<(Vec<f64>, f64, f64)>,
}

impl Spring {
    /// Value `a.q + b` of each member, deg.
    fn values<'a>(&'a self, q: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        self.members.iter().map(move |(a, _, b)| a.iter().zip(q).map(|(a, q)| a * q).sum::<f64>() + b)
    }
}

/// The law of one part: computes its joints' velocities from their state and the influences on them.
///
/// Stateless: positions and speeds are passed in each cycle, so that a stream can be stopped and resumed from another
/// state.
#[derive(Clone, Debug, PartialEq)]
pub struct ForceLaw {
    /// One per motor of the part.
    joints: Vec<JointLaw>,
    /// One per clause of the part.
    springs: Vec<Spring>,
}

impl ForceLaw {
    /// Creates the law of a part.
    ///
    /// # Arguments
    /// * `joints`: one entry per motor of the part, in its order.
    /// * `part`: its clauses are the constraints that push.
    /// * `constraint_len`: value of a clause below which it pushes, deg; at least 20 is used.
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

    /// The law for a motion to `to` (deg) of the joints that move. All other joints get weight 0. Springs of limits and
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
            // A clause holds as well as its best member: a spring of that length is just slack at the target.
            let best = spring.values(to).fold(f64::NEG_INFINITY, f64::max);
            spring.len = spring.len.min(best);
        }
        law
    }

    /// Computes one cycle of the law.
    ///
    /// # Arguments
    /// * `q`, `speed`: positions, deg, and speeds, deg/s, of the part's joints.
    /// * `influences`: the other influences on them.
    /// * `secs`: duration of the cycle, s; the velocities apply for this duration.
    ///
    /// # Returns
    /// The velocities to command, deg/s, 0 for joints of weight 0. `None` if there is nothing to do: nothing pushes,
    /// and all joints are at rest at the attractor.
    pub fn velocities(&self, q: &[f64], speed: &[f64], influences: Influences<'_>, secs: f64) -> Option<Vec<f64>> {
        // The original's sharpening: soft at the field's edge, quickly hard inside.
        let field: Vec<f64> = influences.field.iter().map(|t| (1000.0 * t).abs() * 1000.0 * t).collect();
        let inside = norm(&field);
        let outside = norm(influences.outside);
        let constraint = self.constraint(q);
        let pushes = |i: usize, j: &JointLaw| {
            let pushed_by = [saturated(j.max_field_force, j.field_const, at(&field, i), inside), limit(j, at(q, i))];
            pushed_by.into_iter().sum::<f64>() + at(&constraint, i) * j.max_constraint_force
        };
        let weighted = || self.joints.iter().enumerate().filter(|(_, j)| j.weight > 0.0);
        let offset = |i: usize| at(influences.to, i) - at(q, i);
        let pushed = weighted().any(|(i, j)| pushes(i, j) != 0.0);
        let is_off_target = |(i, _): (usize, &JointLaw)| offset(i).abs() > REST.0 || at(speed, i).abs() > REST.1;
        if !(pushed || outside > 0.0 || weighted().any(is_off_target)) {
            return None;
        }
        // Forces are accelerations here: one Euler step from the measured speed, scaled by `weight`.
        let velocity = |(i, j): (usize, &JointLaw)| {
            if j.weight <= 0.0 {
                return 0.0;
            }
            let pull = saturated(j.max_spring_force, j.spring_const, offset(i), offset(i).abs());
            let mut a =
                pull + pushes(i, j) + saturated(j.max_rpc_force, j.rpc_force_const, at(influences.outside, i), outside);
            if pushed {
                a -= j.damping_const * at(speed, i);
            }
            j.weight * (at(speed, i) + a * secs)
        };
        Some(self.joints.iter().enumerate().map(velocity).collect())
    }

    /// The push of clauses that are violated or nearly violated, from -1 to 1 per joint.
    fn constraint(&self, q: &[f64]) -> Vec<f64> {
        let mut sum = vec![0.0; self.joints.len()];
        for spring in self.springs.iter().filter(|s| s.len > 0.0) {
            // One member that holds with sufficient reserve is enough: a clause is a disjunction.
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

/// The push of a joint's limits, deg/s^2.
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

/// One component of a force of magnitude `strength`, saturated at `most`.
fn saturated(most: f64, k: f64, component: f64, strength: f64) -> f64 {
    if most > 0.0 && k > 0.0 { most * component / (most / k + strength) } else { 0.0 }
}

/// Euclidean norm.
fn norm(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Element `i` of a list; zero beyond the end, since unused lists are empty.
fn at(list: &[f64], i: usize) -> f64 {
    list.get(i).copied().unwrap_or_default()
}
