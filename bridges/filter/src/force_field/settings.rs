//! Settings of the force-field controller, which the original stores in `P.ini`.

use mobee_contract::{Axis, KindError};
use mobee_model::JointLaw;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Settings of a part's force-field controller, as in the original's `.ini` files: lists with one number per
/// joint, in the order of the part's board; accelerations in deg/s^2, other quantities per degree or second.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ForceFieldSettings {
    /// Share of the computed velocity that is commanded; joints of weight 0 are not moved.
    pub weight: Vec<f64>,
    /// Strength of the attractor near it, 1/s^2.
    pub spring_const: Vec<f64>,
    /// Damping while a force acts, 1/s.
    pub damping_const: Vec<f64>,
    /// Distance from a limit at which its repulsion begins, deg.
    pub limit_const: Vec<f64>,
    /// Rate at which a force over the network reaches its greatest effect.
    pub rpc_force_const: Vec<f64>,
    /// Greatest attraction of the attractor.
    pub max_spring_force: Vec<f64>,
    /// Repulsion at a limit.
    pub max_limit_force: Vec<f64>,
    /// Greatest repulsion of the constraints.
    pub max_constraint_force: Vec<f64>,
    /// Greatest effect of a force over the network.
    pub max_rpc_force: Vec<f64>,
    /// Value of a constraint at which its repulsion begins; at least 20.
    #[serde(default)]
    pub constraint_len: f64,
}

impl ForceFieldSettings {
    fn lists(&self) -> [(&'static str, &Vec<f64>); 9] {
        [
            ("weight", &self.weight),
            ("spring_const", &self.spring_const),
            ("damping_const", &self.damping_const),
            ("limit_const", &self.limit_const),
            ("rpc_force_const", &self.rpc_force_const),
            ("max_spring_force", &self.max_spring_force),
            ("max_limit_force", &self.max_limit_force),
            ("max_constraint_force", &self.max_constraint_force),
            ("max_rpc_force", &self.max_rpc_force),
        ]
    }

    /// Checks every number; `path` is the location of the settings.
    ///
    /// # Errors
    /// The first invalid number, with the valid range.
    pub fn validate(&self, path: &str) -> Result<(), KindError> {
        let n = self.weight.len();
        for (name, list) in self.lists() {
            let path = format!("{path}.{name}");
            if list.len() != n {
                let what = format!("there are {} numbers here and {n} in `weight`", list.len());
                return Err(KindError::new(path, what, "give one number per joint of the part"));
            }
            if let Some(wrong) = list.iter().find(|x| !(x.is_finite() && **x >= 0.0)) {
                return Err(KindError::new(
                    path,
                    format!("{wrong} is not a usable value"),
                    "give numbers of 0 or more",
                ));
            }
        }
        if let Some(wrong) = self.weight.iter().find(|w| **w > 1.0) {
            let what = format!("a weight of {wrong} would add to every motion");
            return Err(KindError::new(format!("{path}.weight"), what, "give weights from 0 to 1"));
        }
        if !self.constraint_len.is_finite() {
            let path = format!("{path}.constraint_len");
            return Err(KindError::new(path, "this is not a finite number", "give a number of 20 or more, or none"));
        }
        Ok(())
    }

    /// Law of each joint, for lists that were checked against these axes.
    pub(super) fn joints(&self, axes: &[Axis]) -> Vec<JointLaw> {
        let at = |list: &[f64], i: usize| list.get(i).copied().unwrap_or_default();
        let joint = |(i, axis): (usize, &Axis)| JointLaw {
            weight: at(&self.weight, i),
            spring_const: at(&self.spring_const, i),
            max_spring_force: at(&self.max_spring_force, i),
            damping_const: at(&self.damping_const, i),
            limit_const: (at(&self.limit_const, i), at(&self.limit_const, i)),
            max_limit_force: at(&self.max_limit_force, i),
            max_constraint_force: at(&self.max_constraint_force, i),
            rpc_force_const: at(&self.rpc_force_const, i),
            max_rpc_force: at(&self.max_rpc_force, i),
            limits: (axis.min.to_degrees(), axis.max.to_degrees()),
            ..JointLaw::default()
        };
        axes.iter().enumerate().map(joint).collect()
    }

    /// Checks that every list has one number per joint.
    pub fn check_joints(&self, n: usize) -> Result<(), String> {
        match self.lists().iter().find(|(_, list)| list.len() != n) {
            Some((name, list)) => Err(format!("`{name}` has {} numbers for {n} joints", list.len())),
            None => Ok(()),
        }
    }
}
