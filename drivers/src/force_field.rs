//! The force-field controller of a part: drawn by an attractor, pushed by limits, constraints and forces from outside.
//!
//! The law is the original MoBeE's, in degrees: a joint's acceleration is the sum of an attractor's pull, the push of its
//! limits, the push of the part's constraints and a force given over the network, damped when something pushes; what is
//! commanded is a velocity. The force fields of shapes are absent: the model finds which of them overlap, but gives no
//! repulsion. Its commands go through the filter as a stream; the reflex stands behind it as behind any agent.

mod settings;
#[cfg(test)]
mod tests;
mod wish;

pub use settings::ForceFieldSettings;
pub use wish::Wish;

use mobee_contract::Axis;
use mobee_model::{Part, Robot};
use nalgebra::Vector3;

/// Nearer to its attractor (deg) and slower (deg/s) than this, with nothing pushing, the controller is at rest.
const REST: (f64, f64) = (0.2, 1.0);

/// The pure core: one part's joints, its attractor and the force upon it.
pub struct ForceField {
    settings: ForceFieldSettings,
    /// Limits of each joint, deg.
    limits: Vec<(f64, f64)>,
    /// Members of each clause: coefficients per joint, their norm, and the constant.
    clauses: Vec<Vec<(Vec<f64>, f64, f64)>>,
    attractor: Vec<f64>,
    force: Vec<f64>,
    last: Option<Vec<f64>>,
}

impl ForceField {
    /// A controller for a part of a robot, drawn to where the part stands (`q`, deg).
    ///
    /// # Errors
    /// If a list of the settings does not have one number per joint.
    pub fn new(settings: ForceFieldSettings, part: &Part, axes: &[Axis], q: &[f64]) -> Result<ForceField, String> {
        let n = part.motors.len();
        settings.check_joints(n)?;
        let limits: Vec<_> = axes
            .get(part.motors.clone())
            .unwrap_or_default()
            .iter()
            .map(|a| (a.min.to_degrees(), a.max.to_degrees()))
            .collect();
        if limits.len() != n || q.len() != n {
            return Err(format!("part {} has {n} motors, and its board another number", part.name));
        }
        let member = |half: &mobee_model::HalfSpace| {
            let mut a = vec![0.0; n];
            for (motor, value) in &half.terms {
                if let Some(slot) = motor.checked_sub(part.motors.start).and_then(|m| a.get_mut(m)) {
                    *slot += value;
                }
            }
            let norm = a.iter().map(|x| x * x).sum::<f64>().sqrt();
            (a, norm, half.b)
        };
        let clauses = part.clauses.iter().map(|c| c.0.iter().map(member).collect()).collect();
        Ok(ForceField { settings, limits, clauses, attractor: q.to_vec(), force: vec![0.0; n], last: None })
    }

    /// Takes a wish from the network; `robot`, `part` and the robot's whole pose are for forces at a marker.
    ///
    /// # Errors
    /// What is wrong with it; nothing has changed then.
    pub fn wish(&mut self, wish: &Wish, robot: &Robot, part: usize, q: &[f64]) -> Result<(), String> {
        match wish {
            Wish::Attractor(fractions) => {
                for ((x, fraction), (min, max)) in self.attractor.iter_mut().zip(fractions).zip(&self.limits) {
                    *x = min + fraction.clamp(0.0, 1.0) * (max - min);
                }
            }
            Wish::Force(forces) => {
                for (slot, force) in self.force.iter_mut().zip(forces) {
                    *slot = *force;
                }
            }
            Wish::Wrench { marker, force, torque } => {
                let (force, torque) = (Vector3::from(*force), Vector3::from(*torque));
                self.force = wish::joint_forces(robot, part, q, marker, &force, &torque)?;
            }
        }
        Ok(())
    }

    /// Gives up what it was drawn to: after a reflex it stays where the robot then rests (`q`, deg) until told otherwise.
    pub fn settle(&mut self, q: &[f64]) {
        for (slot, q) in self.attractor.iter_mut().zip(q) {
            *slot = *q;
        }
        self.force.fill(0.0);
        self.last = None;
    }

    /// One cycle: velocities (deg/s) for the part standing at `q` (deg), `secs` after the last cycle; `None` while there is
    /// nothing to do. Joints of no weight have velocity 0.
    pub fn step(&mut self, q: &[f64], secs: f64) -> Option<Vec<f64>> {
        let last = self.last.replace(q.to_vec())?;
        // a cycle that came late would be taken for a great acceleration
        if q.len() != self.limits.len() || last.len() != q.len() || !(secs > 1e-4 && secs < 0.5) {
            return None;
        }
        let s = &self.settings;
        let speed: Vec<f64> = q.iter().zip(&last).map(|(q, p)| (q - p) / secs).collect();
        let pull: Vec<f64> = (0..q.len())
            .map(|i| squashed(at(&s.max_spring_force, i), at(&s.spring_const, i), at(&self.attractor, i) - at(q, i)))
            .collect();
        let limit: Vec<f64> = (0..q.len()).map(|i| self.limit(i, at(q, i))).collect();
        let constraint = self.constraint(q);
        let strength = self.force.iter().map(|f| f * f).sum::<f64>().sqrt();
        let rpc = |i: usize| {
            let (most, k) = (at(&s.max_rpc_force, i), at(&s.rpc_force_const, i));
            if most > 0.0 && k > 0.0 { most / (most / k + strength) * at(&self.force, i) } else { 0.0 }
        };
        let weighty = |i: &usize| at(&s.weight, *i) > 0.0;
        let pushed = (0..q.len()).filter(weighty).any(|i| at(&limit, i) != 0.0 || at(&constraint, i) != 0.0);
        let active = pushed
            || strength > 0.0
            || (0..q.len())
                .filter(weighty)
                .any(|i| (at(&self.attractor, i) - at(q, i)).abs() > REST.0 || at(&speed, i).abs() > REST.1);
        if !active {
            return None;
        }
        let velocity = |i: usize| {
            if !weighty(&i) {
                return 0.0;
            }
            let mut a = at(&pull, i) + at(&limit, i) + at(&constraint, i) + rpc(i);
            if pushed {
                a -= at(&s.damping_const, i) * at(&speed, i);
            }
            at(&s.weight, i) * (at(&speed, i) + a * secs)
        };
        Some((0..q.len()).map(velocity).collect())
    }

    /// The joints that it moves, as indices within the part.
    pub fn joints(&self) -> impl Iterator<Item = usize> + '_ {
        self.settings.weight.iter().enumerate().filter(|(_, w)| **w > 0.0).map(|(i, _)| i)
    }

    /// The push of a joint's limits.
    fn limit(&self, i: usize, q: f64) -> f64 {
        let (near, most) = (at(&self.settings.limit_const, i), at(&self.settings.max_limit_force, i));
        let (min, max) = self.limits.get(i).copied().unwrap_or_default();
        if near <= 0.0 || most <= 0.0 {
            0.0
        } else if q < min + near {
            most * (min + near - q) / near
        } else if q > max - near {
            -most * (q - (max - near)) / near
        } else {
            0.0
        }
    }

    /// The push of clauses that are violated or nearly so.
    fn constraint(&self, q: &[f64]) -> Vec<f64> {
        let len = self.settings.constraint_len.max(20.0);
        let mut sum = vec![0.0; q.len()];
        for clause in &self.clauses {
            let values: Vec<f64> =
                clause.iter().map(|(a, _, b)| a.iter().zip(q).map(|(a, q)| a * q).sum::<f64>() + b).collect();
            if values.iter().any(|v| *v > len) {
                continue;
            }
            for ((a, norm, _), value) in clause.iter().zip(values).filter(|((_, norm, _), _)| *norm > 0.0) {
                for (slot, a) in sum.iter_mut().zip(a) {
                    *slot += (len - value) / len * a / norm;
                }
            }
        }
        sum.iter().enumerate().map(|(i, s)| s.clamp(-1.0, 1.0) * at(&self.settings.max_constraint_force, i)).collect()
    }
}

/// A spring that never pulls with more than `most`.
fn squashed(most: f64, k: f64, way: f64) -> f64 {
    if most > 0.0 && k > 0.0 { most * way / (most / k + way.abs()) } else { 0.0 }
}

fn at(list: &[f64], i: usize) -> f64 {
    list.get(i).copied().unwrap_or_default()
}
