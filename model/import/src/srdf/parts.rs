//! Body parts from groups. Groups may overlap; each motor belongs to one part.

use super::{LinkTree, Srdf};
use mobee_model::{Robot, RobotParts};
use std::collections::BTreeSet;

impl Srdf {
    /// The groups that become parts: in file order, each that shares no motor with those before it (files usually list
    /// an arm and a hand before the arm with its hand). A group that is exactly the union of smaller ones is skipped,
    /// regardless of its position. The motors without a group form a part with the robot's name.
    pub fn parts(&self, tree: &LinkTree, robot: &Robot) -> RobotParts {
        let groups = self.groups.iter().map(|g| (g.name.as_str(), self.motors_of(&g.name, tree, robot)));
        let groups: Vec<(&str, BTreeSet<usize>)> = groups.map(|(name, m)| (name, m.into_iter().collect())).collect();
        let is_collection = |of: &BTreeSet<usize>| {
            let smaller = groups.iter().map(|(_, m)| m).filter(|m| m.len() < of.len() && m.is_subset(of));
            smaller.flatten().copied().collect::<BTreeSet<usize>>() == *of
        };
        let mut free: BTreeSet<usize> = (0..robot.motors.len()).collect();
        let mut parts = RobotParts::default();
        for (name, motors) in groups.iter().filter(|(_, m)| !m.is_empty()) {
            if motors.is_subset(&free) && !is_collection(motors) {
                free.retain(|m| !motors.contains(m));
                parts.parts.push(((*name).to_owned(), motors.iter().copied().collect()));
            } else {
                parts.passed_over.push((*name).to_owned());
            }
        }
        if !free.is_empty() {
            let taken = parts.parts.iter().any(|(name, _)| *name == robot.name);
            let name = if taken { format!("{}_rest", robot.name) } else { robot.name.clone() };
            parts.parts.push((name, free.into_iter().collect()));
        }
        parts
    }
}
