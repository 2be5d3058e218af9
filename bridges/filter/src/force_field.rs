//! Force-field controller of a part: attracted to a target, repelled by limits, constraints and external
//! forces.
//!
//! The law is that of the original MoBeE, [`ForceLaw`]; the commands are velocities. Fields of shapes are not
//! included; they belong to the controller kind `fields`. Its commands pass the filter as a stream, under the
//! same reflex as those of any agent.

mod settings;
#[cfg(test)]
mod tests;
mod wish;

pub use settings::ForceFieldSettings;
pub use wish::Wish;

use mobee_contract::Axis;
use mobee_model::{ForceLaw, Influences, Part, Robot};
use nalgebra::Vector3;

/// Pure core: one part's joints, its attractor and the external force.
pub struct ForceField {
    law: ForceLaw,
    attractor: Vec<f64>,
    force: Vec<f64>,
    last: Option<Vec<f64>>,
}

impl ForceField {
    /// Creates a controller for a part, with its attractor at the present configuration (`q`, deg).
    ///
    /// # Errors
    /// A list of the settings does not have one number per joint.
    pub fn new(settings: ForceFieldSettings, part: &Part, axes: &[Axis], q: &[f64]) -> Result<ForceField, String> {
        let n = part.motors.len();
        settings.check_joints(n)?;
        let axes = axes.get(part.motors.clone()).unwrap_or_default();
        if axes.len() != n || q.len() != n {
            return Err(format!("part {} has {n} motors, and its board another number", part.name));
        }
        let law = ForceLaw::new(settings.joints(axes), part, settings.constraint_len);
        Ok(ForceField { law, attractor: q.to_vec(), force: vec![0.0; n], last: None })
    }

    /// Applies a request from the network. `robot`, `part` and the robot's configuration are used for forces
    /// at a marker.
    ///
    /// # Errors
    /// An invalid request; nothing has changed then.
    pub fn wish(&mut self, wish: &Wish, robot: &Robot, part: usize, q: &[f64]) -> Result<(), String> {
        match wish {
            Wish::Attractor(fractions) => {
                for ((x, fraction), joint) in self.attractor.iter_mut().zip(fractions).zip(self.law.joints()) {
                    let (min, max) = joint.limits;
                    *x = min + fraction.clamp(0.0, 1.0) * (max - min);
                }
            }
            Wish::Force(forces) => {
                for (slot, force) in self.force.iter_mut().zip(forces) {
                    *slot = *force;
                }
            }
            Wish::Wrench { marker, force, torque } => {
                let force = Vector3::from(*force);
                let torque = Vector3::from(*torque);
                self.force = wish::joint_forces(robot, part, q, marker, &force, &torque)?;
            }
        }
        Ok(())
    }

    /// Resets the attractor to the configuration at rest (`q`, deg) after a reflex, until the next request.
    pub fn settle(&mut self, q: &[f64]) {
        for (slot, q) in self.attractor.iter_mut().zip(q) {
            *slot = *q;
        }
        self.force.fill(0.0);
        self.last = None;
    }

    /// Computes one cycle: velocities (deg/s) for the part at `q` (deg), `secs` after the last cycle; `None`
    /// if there is nothing to do. Joints of weight 0 have velocity 0.
    pub fn step(&mut self, q: &[f64], secs: f64) -> Option<Vec<f64>> {
        let last = self.last.replace(q.to_vec())?;
        // a late cycle would look like a great acceleration
        if q.len() != self.attractor.len() || last.len() != q.len() || !(secs > 1e-4 && secs < 0.5) {
            return None;
        }
        let speed: Vec<f64> = q.iter().zip(&last).map(|(q, p)| (q - p) / secs).collect();
        let influences = Influences { to: &self.attractor, field: &[], outside: &self.force };
        self.law.velocities(q, &speed, influences, secs)
    }

    /// Joints that it moves, as indices within the part.
    pub fn joints(&self) -> impl Iterator<Item = usize> + '_ {
        self.law.joints().iter().enumerate().filter(|(_, j)| j.weight > 0.0).map(|(i, _)| i)
    }
}
